//! The numbers that legs and velocity estimate are computed with: one robot's, or those of a row of robots side by side.
//!
//! In double precision: the estimate weights corners of soles by their heights on a scale of millimetres, and in single precision a
//! height of a metre is known to a weight's fourth digit only. Every operation of a [`Row`] is that of an `f64` in each of its places, so
//! a robot's bits do not depend on whether it is alone or in a row, nor on its neighbours. Sine, cosine and exponential are functions
//! without branches for that reason (Moshier's Cephes, double precision), and the same on every processor.

use core::ops::{Add, Div, Mul, Neg, Sub};

/// Robots in a row: as many `f64` as four SSE or NEON registers hold.
pub const ROW: usize = 8;

/// A number, or one for each robot of a row.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The same number for each robot.
    fn of(x: f64) -> Self;
    /// The smaller; the argument where either is not a number.
    fn min(self, other: Self) -> Self;
    /// Sine and cosine of an angle in rad; within [-1, 1] for every finite one, exact to 1e-12 up to 8000 rad.
    fn sin_cos(self) -> (Self, Self);
    /// The exponential of a number that is not positive.
    fn exp(self) -> Self;
}

impl Number for f64 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        exp(self)
    }
}

/// Single precision, computed by way of double.
impl Number for f32 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as Self
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = sin_cos(f64::from(self));
        (sin as Self, cos as Self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        exp(f64::from(self)) as Self
    }
}

/// One number for each robot of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct Row(pub [f64; ROW]);

macro_rules! operator {
    ($trait:ident, $function:ident, $operator:tt) => {
        impl $trait for Row {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(core::array::from_fn(|i| self.0[i] $operator other.0[i]))
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl Neg for Row {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl Number for Row {
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self([x; ROW])
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(core::array::from_fn(|i| Number::min(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (mut sin, mut cos) = ([0.0; ROW], [0.0; ROW]);
        for i in 0..ROW {
            (sin[i], cos[i]) = sin_cos(self.0[i]);
        }
        (Self(sin), Self(cos))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        Self(self.0.map(exp))
    }
}

/// Added to a number below 2^51 it leaves the nearest integer in the last bits of the mantissa.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// `x` into the polynomial whose coefficients are `c`, the highest first.
#[inline(always)]
fn polynomial<const N: usize>(x: f64, c: [f64; N]) -> f64 {
    c.into_iter().fold(0.0, |sum, c| sum * x + c)
}

#[inline(always)]
fn sin_cos(x: f64) -> (f64, f64) {
    let shifted = x * core::f64::consts::FRAC_2_PI + ROUND;
    let (quadrant, n) = (shifted.to_bits(), shifted - ROUND);
    // pi/2 in three parts; the products of the first two with n are exact for angles up to 8000 rad.
    let r = x - n * 1.570_796_251_296_997 - n * 7.549_789_415_861_596e-8 - n * 5.390_302_858_158_119e-15;
    // Beyond all angles the remainder is noise, but sine and cosine stay bounded; what is not a number stays that.
    let r = if r > 1.0 { 1.0 } else { r };
    let r = if r < -1.0 { -1.0 } else { r };
    let z = r * r;
    let s = polynomial(
        z,
        [
            1.589_623_015_765_465_7e-10,
            -2.505_074_776_285_780_7e-8,
            2.755_731_362_138_572_2e-6,
            -1.984_126_982_958_954e-4,
            8.333_333_333_322_118e-3,
            -0.166_666_666_666_666_3,
        ],
    );
    let c = polynomial(
        z,
        [
            -1.135_853_652_138_768_2e-11,
            2.087_570_084_197_473e-9,
            -2.755_731_417_929_674e-7,
            2.480_158_728_885_170_5e-5,
            -1.388_888_888_887_305_6e-3,
            4.166_666_666_666_659e-2,
        ],
    );
    let (s, c) = (r + r * z * s, 1.0 - 0.5 * z + z * z * c);
    let odd = quadrant & 1 == 1;
    let (sin, cos) = if odd { (c, s) } else { (s, c) };
    let negate = |x: f64, bit: u64| f64::from_bits(x.to_bits() ^ (bit & 2) << 62);
    (negate(sin, quadrant), negate(cos, quadrant.wrapping_add(1)))
}

#[inline(always)]
fn exp(x: f64) -> f64 {
    // e^-700 has a normal representation; nothing here can tell it from zero.
    let x = if x < -700.0 { -700.0 } else { x };
    let shifted = x * core::f64::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * 0.693_145_751_953_125 - n * 1.428_606_820_309_417_2e-6;
    let z = r * r;
    let p = r * polynomial(z, [1.261_771_930_748_105_9e-4, 3.029_944_077_074_419_6e-2, 1.0]);
    let q = polynomial(
        z,
        [
            3.001_985_051_386_644_6e-6,
            2.524_483_403_496_841e-3,
            0.227_265_548_208_155_03,
            2.0,
        ],
    );
    let fraction = 1.0 + 2.0 * (p / (q - p));
    let power = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(1023) << 52;
    fraction * f64::from_bits(power)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn sine_cosine_and_exponential_are_those_of_the_standard_library(x in -8000.0f64..8000.0, small in -7.0f64..7.0) {
            for x in [x, small] {
                let (sin, cos) = sin_cos(x);
                // The angle's own last bit is 9e-13 at 8000 rad.
                prop_assert!((sin - x.sin()).abs() < 1e-12, "{x}");
                prop_assert!((cos - x.cos()).abs() < 1e-12, "{x}");
            }
            let x = -0.05 * x.abs();
            let exact = x.exp();
            prop_assert!((exp(x) - exact).abs() <= 4.0 * f64::EPSILON * exact, "{x}");
        }

        #[test]
        fn a_place_in_a_row_has_the_bits_of_a_number_alone(x in prop::array::uniform8(any::<f64>())) {
            let bits = |x: f64| if x.is_nan() { 0 } else { x.to_bits() };
            let (sin, cos) = Row(x).sin_cos();
            for i in 0..ROW {
                let alone = sin_cos(x[i]);
                prop_assert_eq!(bits(sin.0[i]), bits(alone.0));
                prop_assert_eq!(bits(cos.0[i]), bits(alone.1));
                prop_assert_eq!(bits(Row(x).exp().0[i]), bits(exp(x[i])));
            }
        }
    }

    #[test]
    fn what_is_no_number_stays_none_and_the_absurd_stays_bounded() {
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(sin_cos(x).0.is_nan() && sin_cos(x).1.is_nan());
        }
        assert!(exp(f64::NAN).is_nan());
        for x in [1e6f64, 1e12, f64::MAX] {
            let (sin, cos) = sin_cos(x);
            assert!(sin.abs() <= 1.0 && cos.abs() <= 1.0, "{x}: {sin} {cos}");
        }
    }
}
