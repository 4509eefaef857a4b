//! Activations and the functions under them, written so that loops over them vectorise: no branch, no call.

use serde::{Deserialize, Serialize};

use crate::simd::{self, Kernel, PANEL, Simd};

/// Non-linearity of the hidden layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// Hyperbolic tangent.
    Tanh,
    /// `x` above zero, `exp(x) - 1` below.
    Elu,
    /// `x` above zero, 0 below.
    Relu,
}

/// Hyperbolic tangent: a rational function (odd 13, even 6) on the range where it is not 1 to `f32` precision, the
/// coefficients being those of Eigen.
#[inline(always)]
fn tanh<S: Simd>(x: f32) -> f32 {
    let x = x.clamp(-7.905_311, 7.905_311);
    let square = x * x;
    let mut p = -2.760_768_4e-16;
    for coefficient in [
        2.000_188e-13,
        -8.604_671e-11,
        5.122_297e-8,
        1.485_722_4e-5,
        6.372_619_3e-4,
        4.893_524_6e-3,
    ] {
        p = S::fma(p, square, coefficient);
    }
    let mut q = 1.198_258_4e-6;
    for coefficient in [1.185_347_1e-4, 2.268_434_6e-3, 4.893_525e-3] {
        q = S::fma(q, square, coefficient);
    }
    x * p / q
}

/// `exp(x)` for `x <= 0` in `f32`.
#[inline(always)]
fn exp<S: Simd>(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to an integer
    let x = x.max(-87.0);
    let shifted = S::fma(x, std::f32::consts::LOG2_E, ROUND);
    let power = shifted - ROUND;
    let r = S::fma(power, -0.693_359_4, x);
    let r = S::fma(power, 2.121_944_4e-4, r);
    let mut p = 1.987_569_2e-4;
    for coefficient in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 5e-1, 1.0, 1.0] {
        p = S::fma(p, r, coefficient);
    }
    p * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
}

struct Forward<'a> {
    values: &'a mut [f32],
    bias: &'a [f32],
    activation: Option<Activation>,
}

impl Forward<'_> {
    #[inline(always)]
    fn each(self, function: impl Fn(f32) -> f32) {
        // What fills up a panel is zero and remains so: every activation of zero is zero.
        let mut bias = [0.0; PANEL];
        bias[..self.bias.len()].copy_from_slice(self.bias);
        for row in self.values.chunks_exact_mut(PANEL) {
            row.iter_mut().zip(&bias).for_each(|(y, b)| *y = function(*y + b));
        }
    }
}

impl Kernel for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        match self.activation {
            None => self.each(|x| x),
            Some(Activation::Tanh) => self.each(|x| tanh::<S>(x)),
            // What is not a number stays so.
            Some(Activation::Relu) => self.each(|x| if x < 0.0 { 0.0 } else { x }),
            Some(Activation::Elu) => self.each(|x| if x < 0.0 { exp::<S>(x.min(0.0)) - 1.0 } else { x }),
        }
    }
}

/// Adds the bias to rows of values in a panel and applies the activation, if any.
pub(crate) fn activate(values: &mut [f32], bias: &[f32], activation: Option<Activation>) {
    simd::dispatch(Forward {
        values,
        bias,
        activation,
    });
}

struct Backward<'a> {
    gradient: &'a mut [f32],
    outputs: &'a [f32],
    activation: Activation,
}

impl Backward<'_> {
    #[inline(always)]
    fn each(self, function: impl Fn(f32, f32) -> f32) {
        let pairs = self.gradient.iter_mut().zip(self.outputs);
        pairs.for_each(|(gradient, &output)| *gradient = function(*gradient, output));
    }
}

impl Kernel for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        match self.activation {
            Activation::Tanh => self.each(|g, y| g * (1.0 - y * y)),
            Activation::Relu => self.each(|g, y| if y > 0.0 { g } else { 0.0 }),
            Activation::Elu => self.each(|g, y| if y > 0.0 { g } else { g * (y + 1.0) }),
        }
    }
}

/// Turns the gradient by an activation's output into that by its input, given the outputs, element by element.
pub(crate) fn differentiate(gradient: &mut [f32], outputs: &[f32], activation: Activation) {
    simd::dispatch(Backward {
        gradient,
        outputs,
        activation,
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply(activation: Activation, x: f32) -> f32 {
        let mut y = [x; PANEL];
        activate(&mut y, &[0.0; PANEL], Some(activation));
        y[0]
    }

    #[test]
    fn activations_agree_with_the_standard_library() {
        for i in -4000..=4000 {
            let x = i as f32 * 5e-3;
            let wide = f64::from(x);
            let tanh = f64::from(apply(Activation::Tanh, x));
            assert!(
                (tanh - wide.tanh()).abs() <= 4e-7 * wide.tanh().abs(),
                "tanh({x}) = {tanh}"
            );
            let elu = f64::from(apply(Activation::Elu, x));
            let expected = if x > 0.0 { wide } else { wide.exp_m1() };
            assert!(
                (elu - expected).abs() <= 2e-7 * expected.abs().max(1.0),
                "elu({x}) = {elu}"
            );
            assert_eq!(apply(Activation::Relu, x), x.max(0.0));
        }
    }

    #[test]
    fn nan_is_not_hidden() {
        for activation in [Activation::Tanh, Activation::Relu, Activation::Elu] {
            assert!(apply(activation, f32::NAN).is_nan(), "{activation:?}");
        }
    }
}
