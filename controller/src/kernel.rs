//! The loops of inference, written so that they vectorise, and the choice of instruction set for them.
//!
//! A layer's weights lie in panels of [`PANEL`] outputs, input after input: the loop over a tile of outputs keeps its sums in
//! registers and reads the weights once, in order. Without the feature `std` the compiler's target decides what
//! registers there are; with it the processor is asked, and the same loops are compiled for AVX2 and AVX-512 as well.
//!
//! The only `unsafe` of the crate is here: calling a function compiled for an instruction set that was found present.
#![cfg_attr(all(feature = "std", target_arch = "x86_64"), allow(unsafe_code))]

use alloc::{vec, vec::Vec};

use crate::actor::Activation;

/// Outputs of a panel.
pub(crate) const PANEL: usize = 64;

/// The instruction set the loops run with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    /// What the crate was compiled for.
    Baseline,
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    Avx2,
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    Avx512,
}

impl Level {
    /// The best this processor has.
    pub(crate) fn detect() -> Self {
        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        {
            if std::is_x86_feature_detected!("avx512f") {
                return Self::Avx512;
            }
            if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
                return Self::Avx2;
            }
        }
        Self::Baseline
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            #[cfg(all(feature = "std", target_arch = "x86_64"))]
            Self::Avx2 => "avx2",
            #[cfg(all(feature = "std", target_arch = "x86_64"))]
            Self::Avx512 => "avx512",
        }
    }
}

/// A dense layer prepared for inference.
#[derive(Clone, Debug)]
pub(crate) struct Panels {
    inputs: usize,
    outputs: usize,
    /// Panels of `inputs x PANEL`, the last one filled up with zeros.
    weights: Vec<f32>,
    /// Filled up likewise.
    bias: Vec<f32>,
    activation: Option<Activation>,
}

impl Panels {
    /// From weights in rows of one output each.
    pub(crate) fn new(inputs: usize, weights: &[f32], bias: &[f32], activation: Option<Activation>) -> Self {
        let outputs = bias.len();
        let width = outputs.next_multiple_of(PANEL);
        let mut panels = vec![0.0; inputs * width];
        for (output, row) in weights.chunks_exact(inputs).enumerate() {
            let panel = &mut panels[output / PANEL * inputs * PANEL..];
            for (input, &weight) in row.iter().enumerate() {
                panel[input * PANEL + output % PANEL] = weight;
            }
        }
        let mut filled = bias.to_vec();
        filled.resize(width, 0.0);
        Self {
            inputs,
            outputs,
            weights: panels,
            bias: filled,
            activation,
        }
    }

    /// Length an output buffer must have.
    pub(crate) fn width(&self) -> usize {
        self.bias.len()
    }

    /// Applies the layer; entries of `output` beyond the layer's outputs are of no meaning.
    pub(crate) fn apply(&self, level: Level, input: &[f32], output: &mut [f32]) {
        let (input, output) = (&input[..self.inputs], &mut output[..self.width()]);
        match level {
            Level::Baseline => forward::<16, false>(self, input, output),
            // SAFETY: `Level::detect` found the instruction set.
            #[cfg(all(feature = "std", target_arch = "x86_64"))]
            Level::Avx2 => unsafe { forward_avx2(self, input, output) },
            // SAFETY: as above.
            #[cfg(all(feature = "std", target_arch = "x86_64"))]
            Level::Avx512 => unsafe { forward_avx512(self, input, output) },
        }
    }

    pub(crate) fn outputs(&self) -> usize {
        self.outputs
    }
}

#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx2,fma")]
fn forward_avx2(layer: &Panels, input: &[f32], output: &mut [f32]) {
    forward::<64, true>(layer, input, output);
}

#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx512f")]
fn forward_avx512(layer: &Panels, input: &[f32], output: &mut [f32]) {
    forward::<64, true>(layer, input, output);
}

/// The layer in tiles of `TILE` outputs, which divides [`PANEL`]: as many sums as fit the registers with room for the
/// operands (16 of 4 lanes in SSE and NEON; 64 in the wider sets, to cover the latency of the addition).
#[inline(always)]
fn forward<const TILE: usize, const FMA: bool>(layer: &Panels, input: &[f32], output: &mut [f32]) {
    for (tile, sums) in output.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
        let first = tile * TILE;
        let panel = &layer.weights[first / PANEL * layer.inputs * PANEL..];
        let within = first % PANEL;
        let mut acc = [0.0f32; TILE];
        acc.copy_from_slice(&layer.bias[first..first + TILE]);
        for (&x, row) in input.iter().zip(panel.as_chunks::<PANEL>().0) {
            let row = &row[within..within + TILE];
            for k in 0..TILE {
                acc[k] = multiply_add::<FMA>(x, row[k], acc[k]);
            }
        }
        match layer.activation {
            None => {}
            Some(Activation::Tanh) => acc.iter_mut().for_each(|x| *x = tanh::<FMA>(*x)),
            Some(Activation::Elu) => acc.iter_mut().for_each(|x| *x = elu::<FMA>(*x)),
            Some(Activation::Relu) => acc.iter_mut().for_each(|x| *x = if *x < 0.0 { 0.0 } else { *x }),
        }
        *sums = acc;
    }
}

/// `a b + c`, fused only where that is an instruction.
#[inline(always)]
fn multiply_add<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    #[cfg(feature = "std")]
    if FMA {
        return a.mul_add(b, c);
    }
    a * b + c
}

/// Hyperbolic tangent to 1e-6: a rational minimax function (odd of degree 13 over even of degree 6, Eigen's
/// coefficients) where it is not yet 1 in `f32`.
#[inline(always)]
fn tanh<const FMA: bool>(x: f32) -> f32 {
    let x = x.clamp(-7.905_311, 7.905_311);
    let square = x * x;
    let numerator = [
        2.000_188e-13,
        -8.604_671e-11,
        5.122_297e-8,
        1.485_722_4e-5,
        6.372_619_3e-4,
        4.893_524_6e-3,
    ]
    .iter()
    .fold(-2.760_768_4e-16, |sum, &c| multiply_add::<FMA>(sum, square, c));
    let denominator = [1.185_347_1e-4, 2.268_434_6e-3, 4.893_525e-3]
        .iter()
        .fold(1.198_258_4e-6, |sum, &c| multiply_add::<FMA>(sum, square, c));
    x * numerator / denominator
}

/// `x` above zero, `exp(x) - 1` below: `exp(x) = 2^n exp(r)` with |r| at most half of ln 2, by its Taylor series.
#[inline(always)]
fn elu<const FMA: bool>(x: f32) -> f32 {
    /// 1.5 * 2^23: a float this large has no fraction, so adding it rounds.
    const ROUND: f32 = 12_582_912.0;
    /// ln 2 in two parts, the first short enough that multiples of it are exact.
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    let negative = x.clamp(-87.0, 0.0);
    let shifted = multiply_add::<FMA>(negative, core::f32::consts::LOG2_E, ROUND);
    let power = shifted - ROUND;
    let r = multiply_add::<FMA>(power, -LN_2[1], multiply_add::<FMA>(power, -LN_2[0], negative));
    let series = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0]
        .iter()
        .fold(1.0 / 5040.0, |sum, &c| multiply_add::<FMA>(sum, r, c));
    let exponential = series * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23));
    if x < 0.0 { exponential - 1.0 } else { x }
}

/// All instruction sets this processor has.
#[cfg(test)]
pub(crate) fn levels() -> Vec<Level> {
    let mut levels = vec![Level::Baseline];
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    {
        if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
            levels.push(Level::Avx2);
        }
        if std::is_x86_feature_detected!("avx512f") {
            levels.push(Level::Avx512);
        }
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn activations_agree_with_the_library() {
        for i in -200_000..200_000 {
            let x = i as f32 * 1e-4;
            let exact = f64::from(x);
            assert!((f64::from(tanh::<false>(x)) - exact.tanh()).abs() < 1e-6, "tanh {x}");
            assert!((f64::from(tanh::<true>(x)) - exact.tanh()).abs() < 1e-6, "tanh {x}");
            let elu_exact = if exact < 0.0 { exact.exp_m1() } else { exact };
            assert!((f64::from(elu::<false>(x)) - elu_exact).abs() < 1e-6, "elu {x}");
        }
        assert!(tanh::<false>(f32::NAN).is_nan() && elu::<false>(f32::NAN).is_nan());
        assert!((tanh::<false>(f32::INFINITY) - 1.0).abs() < 1e-6);
        assert_eq!(elu::<false>(f32::NEG_INFINITY), -1.0);
    }

    #[test]
    fn every_instruction_set_agrees_with_a_sum_in_double_precision() {
        for (inputs, outputs) in [(1, 1), (49, 512), (512, 32), (130, 65)] {
            let value = |i: usize| ((i * 7919 % 1000) as f32 / 1000.0 - 0.5) / (inputs as f32).sqrt();
            let weights: Vec<f32> = (0..inputs * outputs).map(value).collect();
            let bias: Vec<f32> = (0..outputs).map(value).collect();
            let input: Vec<f32> = (0..inputs).map(|i| 10.0 * value(i + 3)).collect();
            for activation in [
                None,
                Some(Activation::Tanh),
                Some(Activation::Elu),
                Some(Activation::Relu),
            ] {
                let layer = Panels::new(inputs, &weights, &bias, activation);
                for level in levels() {
                    let mut output = vec![0.0; layer.width()];
                    layer.apply(level, &input, &mut output);
                    for (o, row) in weights.chunks_exact(inputs).enumerate() {
                        let products = row.iter().zip(&input).map(|(w, x)| f64::from(*w) * f64::from(*x));
                        let sum = f64::from(bias[o]) + products.sum::<f64>();
                        let expected = match activation {
                            None => sum,
                            Some(Activation::Tanh) => sum.tanh(),
                            Some(Activation::Elu) => {
                                if sum < 0.0 {
                                    sum.exp_m1()
                                } else {
                                    sum
                                }
                            }
                            Some(Activation::Relu) => sum.max(0.0),
                        };
                        assert!(
                            (f64::from(output[o]) - expected).abs() < 2e-6,
                            "{level:?} {activation:?}"
                        );
                    }
                }
            }
        }
    }
}
