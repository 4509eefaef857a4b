//! Weights as a file stores them: in single precision, in half, or in eight bits with a scale for each output.

use alloc::vec::Vec;
use core::fmt;

use libm::{fabsf, roundf};

use crate::math::is_finite;

/// How weights are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Precision {
    /// IEEE 754 single precision.
    F32,
    /// IEEE 754 half precision, rounded to nearest, ties to even.
    F16,
    /// Whole numbers from -127 to 127 times a scale for each output.
    Int8,
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
            Self::Int8 => "int8",
        })
    }
}

/// The weights of a layer, a row of its inputs for each output.
#[derive(Clone, Debug, PartialEq)]
pub enum Weights {
    /// As they are.
    F32(Vec<f32>),
    /// The bits of half-precision numbers.
    F16(Vec<u16>),
    /// `weight = scale[output] * value`.
    Int8 {
        /// One for each output.
        scale: Vec<f32>,
        /// One for each weight.
        values: Vec<i8>,
    },
}

impl Weights {
    /// Stores `weights`, rows of `inputs`, in `precision`; the largest of a row is exact to a rounding in `Int8`.
    pub fn new(weights: &[f32], inputs: usize, precision: Precision) -> Self {
        match precision {
            Precision::F32 => Self::F32(weights.to_vec()),
            Precision::F16 => Self::F16(weights.iter().map(|&x| to_half(x)).collect()),
            Precision::Int8 => {
                let rows = || weights.chunks(inputs.max(1));
                let largest = |row: &[f32]| row.iter().fold(0.0, |most: f32, x| most.max(fabsf(*x)));
                let scale: Vec<f32> = rows().map(|row| largest(row) / 127.0).collect();
                let value = |(row, &scale): (&[f32], &f32)| -> Vec<i8> {
                    // A row of zeros has no scale; the cast of what is no number is 0.
                    row.iter().map(|x| roundf(x / scale) as i8).collect()
                };
                let values = rows().zip(&scale).flat_map(value).collect();
                Self::Int8 { scale, values }
            }
        }
    }

    /// How they are stored.
    pub fn precision(&self) -> Precision {
        match self {
            Self::F32(_) => Precision::F32,
            Self::F16(_) => Precision::F16,
            Self::Int8 { .. } => Precision::Int8,
        }
    }

    /// Number of weights.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(weights) => weights.len(),
            Self::F16(weights) => weights.len(),
            Self::Int8 { values, .. } => values.len(),
        }
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The weights as numbers, rows of `inputs`.
    pub fn expand(&self, inputs: usize) -> Vec<f32> {
        match self {
            Self::F32(weights) => weights.clone(),
            Self::F16(weights) => weights.iter().map(|&bits| from_half(bits)).collect(),
            Self::Int8 { scale, values } => {
                let rows = values.chunks(inputs.max(1)).zip(scale);
                rows.flat_map(|(row, &scale)| row.iter().map(move |&value| scale * f32::from(value)))
                    .collect()
            }
        }
    }

    /// Whether all are finite, and there is a scale for each of `outputs` where scales are needed.
    pub(crate) fn are_finite(&self, outputs: usize) -> bool {
        match self {
            Self::F32(weights) => is_finite(weights),
            Self::F16(weights) => weights.iter().all(|bits| bits & 0x7C00 != 0x7C00),
            // 127 times the scale must be finite as well.
            Self::Int8 { scale, .. } => scale.len() == outputs && scale.iter().all(|x| (127.0 * x).is_finite()),
        }
    }
}

/// The half-precision number nearest to `x`, ties to even; infinite beyond 65,519.
fn to_half(x: f32) -> u16 {
    let (sign, magnitude) = ((x.to_bits() >> 16) as u16 & 0x8000, x.to_bits() & 0x7FFF_FFFF);
    if magnitude > 0x7F80_0000 {
        return sign | 0x7E00;
    }
    // Steps of the last place of the result: 2^-24 below the normal numbers, else 13 bits of the single's mantissa.
    let bits = if magnitude < 0x3880_0000 {
        // Adding 0.5 leaves multiples of 2^-24 in the mantissa, rounded by the addition itself.
        (f32::from_bits(magnitude) + 0.5).to_bits() - 0.5f32.to_bits()
    } else {
        let odd = magnitude >> 13 & 1;
        ((magnitude - (112 << 23) + 0xFFF + odd) >> 13).min(0x7C00)
    };
    sign | bits as u16
}

fn from_half(bits: u16) -> f32 {
    let (sign, magnitude) = (u32::from(bits & 0x8000) << 16, u32::from(bits & 0x7FFF));
    let value = match magnitude {
        // Below the normal numbers: multiples of 2^-24.
        0..0x0400 => (magnitude as f32 * (1.0 / 16_777_216.0)).to_bits(),
        0x0400..0x7C00 => (magnitude << 13) + (112 << 23),
        _ => 0x7F80_0000 | (magnitude & 0x3FF) << 13,
    };
    f32::from_bits(sign | value)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn every_half_number_survives_and_they_are_in_order() {
        let mut before = f32::NEG_INFINITY;
        for bits in 0..=u16::MAX {
            let value = from_half(bits);
            if value.is_nan() {
                assert!(from_half(to_half(value)).is_nan());
            } else {
                assert_eq!(to_half(value), bits, "{value}");
            }
            if (1..0x7C01).contains(&bits) {
                assert!(value > before, "{bits}");
            }
            before = value;
        }
        assert_eq!(from_half(0x3C00), 1.0);
        assert_eq!(from_half(0xC000), -2.0);
        assert_eq!(from_half(0x7BFF), 65_504.0);
        assert_eq!(from_half(0x0001), 5.960_464_5e-8);
        assert_eq!(to_half(65_519.9), 0x7BFF);
        assert_eq!(to_half(65_520.0), 0x7C00);
    }

    proptest! {
        #[test]
        fn a_number_is_rounded_to_the_nearest_half_number(x in prop_oneof![-1.0f32..1.0, -1e-5f32..1e-5, -6e4f32..6e4]) {
            let bits = to_half(x);
            let miss = |bits: u16| (f64::from(from_half(bits)) - f64::from(x)).abs();
            let neighbours = [bits.wrapping_add(1), bits.wrapping_sub(1)];
            for other in neighbours.into_iter().filter(|bits| from_half(*bits).is_finite()) {
                prop_assert!(miss(bits) <= miss(other));
                prop_assert!(miss(bits) < miss(other) || bits & 1 == 0, "ties to even");
            }
        }

        #[test]
        fn eight_bits_miss_by_at_most_half_a_step(weights in prop::collection::vec(-3.0f32..3.0, 12)) {
            let stored = Weights::new(&weights, 4, Precision::Int8);
            for (row, found) in weights.chunks(4).zip(stored.expand(4).chunks(4)) {
                let step = row.iter().fold(0.0f32, |most, x| most.max(x.abs())) / 127.0;
                for (x, found) in row.iter().zip(found) {
                    prop_assert!((x - found).abs() <= 0.5001 * step, "{x} {found} {step}");
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_stored_shows() {
        assert!(!Weights::new(&[1e6], 1, Precision::F16).are_finite(1));
        assert!(!Weights::new(&[f32::NAN], 1, Precision::F32).are_finite(1));
        assert!(!Weights::new(&[f32::INFINITY], 1, Precision::Int8).are_finite(1));
        let zeros = Weights::new(&[0.0; 4], 2, Precision::Int8);
        assert!(zeros.are_finite(2) && !zeros.are_finite(3));
        assert_eq!(zeros.expand(2), [0.0; 4]);
    }
}
