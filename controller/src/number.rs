//! The numbers the loop computes with: one robot's, or those of a row of robots side by side.
//!
//! Every operation of a [`Row`] is that of an `f32` in each of its places, so a robot's bits do not depend on whether it is alone
//! or in a row, nor on its neighbours. Sine, cosine and exponential are polynomials without branches for that reason
//! (Moshier's Cephes, single precision; errors below 1e-7), and the same on every processor.

use core::ops::{Add, Div, Mul, Neg, Sub};

/// Robots in a row: as many `f32` as two SSE or NEON registers hold.
pub const ROW: usize = 8;

/// A number, or one for each robot of a row.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The same number for each robot.
    fn of(x: f32) -> Self;
    /// The smaller; the argument where either is not a number.
    fn min(self, other: Self) -> Self;
    /// Sine and cosine of an angle in rad; within [-1, 1] for every finite one, exact to 1e-7 up to 8000 rad.
    fn sin_cos(self) -> (Self, Self);
    /// The exponential of a number that is not positive.
    fn exp(self) -> Self;
}

impl Number for f32 {
    #[inline(always)]
    fn of(x: f32) -> Self {
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

/// One number for each robot of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub struct Row(pub [f32; ROW]);

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
    fn of(x: f32) -> Self {
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

/// Added to a number below 2^22 it leaves the nearest integer in the last bits of the mantissa.
const ROUND: f32 = 12_582_912.0;

#[inline(always)]
fn sin_cos(x: f32) -> (f32, f32) {
    let shifted = x * core::f32::consts::FRAC_2_PI + ROUND;
    let (quadrant, n) = (shifted.to_bits(), shifted - ROUND);
    // pi/2 in three parts whose products with n are exact for angles up to 8000 rad.
    let r = x - n * 1.570_312_5 - n * 4.837_513e-4 - n * 7.549_79e-8;
    // Beyond all angles the remainder is noise, but sine and cosine stay bounded; what is not a number stays that.
    let r = if r > 1.0 { 1.0 } else { r };
    let r = if r < -1.0 { -1.0 } else { r };
    let z = r * r;
    let s = r + r * z * (-0.166_666_55 + z * (8.332_161e-3 + z * -1.951_529_6e-4));
    let c = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    let odd = quadrant & 1 == 1;
    let (sin, cos) = if odd { (c, s) } else { (s, c) };
    let negate = |x: f32, bit: u32| f32::from_bits(x.to_bits() ^ (bit & 2) << 30);
    (negate(sin, quadrant), negate(cos, quadrant.wrapping_add(1)))
}

#[inline(always)]
fn exp(x: f32) -> f32 {
    // e^-87 is the smallest with a normal representation; nothing here can tell it from zero.
    let x = if x < -87.0 { -87.0 } else { x };
    let shifted = x * core::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * 0.693_359_4 - n * -2.121_944_4e-4;
    let p = 0.166_666_65 + r * (4.166_579_6e-2 + r * (8.333_452e-3 + r * (1.398_2e-3 + r * 1.987_569_1e-4)));
    let fraction = 1.0 + (r + r * r * (0.5 + r * p));
    let power = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    fraction * f32::from_bits(power)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn sine_cosine_and_exponential_are_those_of_double_precision(x in -8000.0f32..8000.0, small in -7.0f32..7.0) {
            for x in [x, small] {
                let (sin, cos) = sin_cos(x);
                prop_assert!((f64::from(sin) - f64::from(x).sin()).abs() < 1e-7, "{x}");
                prop_assert!((f64::from(cos) - f64::from(x).cos()).abs() < 1e-7, "{x}");
            }
            // A unit in the last place is 1.2e-7; the polynomial and its two roundings stay within two.
            let x = -0.01 * x.abs();
            let exact = f64::from(x).exp();
            prop_assert!((f64::from(exp(x)) - exact).abs() < 2.4e-7 * exact.max(1e-37), "{x}");
        }

        #[test]
        fn a_place_in_a_row_has_the_bits_of_a_number_alone(x in prop::array::uniform8(any::<f32>())) {
            let bits = |x: f32| if x.is_nan() { 0 } else { x.to_bits() };
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
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(sin_cos(x).0.is_nan() && sin_cos(x).1.is_nan());
        }
        assert!(exp(f32::NAN).is_nan());
        for x in [1e6f32, 1e12, f32::MAX] {
            let (sin, cos) = sin_cos(x);
            assert!(sin.abs() <= 1.0 && cos.abs() <= 1.0, "{x}: {sin} {cos}");
        }
    }
}
