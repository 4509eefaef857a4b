//! The loops of inference, written so that they vectorise, and the choice of instruction set for them.
//!
//! A layer's weights lie in panels of [`PANEL`] outputs, input after input, and what is left in panels of [`NARROW`]: the loop over a
//! tile of outputs keeps its sums in registers and reads the weights once, in order. Without the feature `std` the compiler's target decides what
//! registers there are; with it the processor is asked, and the same loops are compiled for AVX2 and AVX-512 as well.
//!
//! The only `unsafe` of the crate is here: calling a function compiled for an instruction set that was found present, and asking
//! for memory ahead of its use.
#![cfg_attr(all(feature = "std", target_arch = "x86_64"), allow(unsafe_code))]

use alloc::{vec, vec::Vec};

use crate::actor::Activation;

/// Outputs of a panel.
pub(crate) const PANEL: usize = 64;

/// Outputs of a panel of what is left.
const NARROW: usize = 16;

/// Numbers in a line of the cache.
const LINE: usize = 16;

/// How far ahead weights are asked for, bytes: what is read while the second-level cache answers.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
const AHEAD: usize = 2048;

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

/// What is done to the sums of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Finish {
    /// Nothing.
    Linear,
    /// The non-linearity of a hidden layer.
    Activate(Activation),
    /// `ln(1 + exp(x))`.
    Softplus,
}

/// A dense layer prepared for inference.
#[derive(Clone, Debug)]
pub(crate) struct Panels {
    inputs: usize,
    outputs: usize,
    /// Panels of `inputs x PANEL`, then of `inputs x NARROW`, the last one filled up with zeros.
    weights: Vec<f32>,
    /// Where they begin: no register's load lies across two lines of the cache, unless the layer was cloned.
    start: usize,
    /// Filled up likewise.
    bias: Vec<f32>,
    finish: Finish,
}

impl Panels {
    /// From weights in rows of one output each.
    pub(crate) fn new(inputs: usize, weights: &[f32], bias: &[f32], finish: Finish) -> Self {
        let outputs = bias.len();
        let padded = outputs.next_multiple_of(NARROW);
        let wide = padded - padded % PANEL;
        let mut panels = vec![0.0; inputs * padded + LINE];
        let start = panels.as_ptr().align_offset(size_of::<f32>() * LINE).min(LINE);
        for (output, row) in weights.chunks_exact(inputs).enumerate() {
            let width = if output < wide { PANEL } else { NARROW };
            let first = output - output % width;
            let panel = &mut panels[start + first * inputs..];
            for (input, &weight) in row.iter().enumerate() {
                panel[input * width + output % width] = weight;
            }
        }
        let mut filled = bias.to_vec();
        filled.resize(padded, 0.0);
        Self {
            inputs,
            outputs,
            weights: panels,
            start,
            bias: filled,
            finish,
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
            Level::Baseline => forward::<16, 1, false>(self, input, output),
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
    forward::<64, 1, true>(layer, input, output);
}

#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx512f")]
fn forward_avx512(layer: &Panels, input: &[f32], output: &mut [f32]) {
    forward::<64, 2, true>(layer, input, output);
}

/// The layer in tiles of `TILE` outputs, which divides [`PANEL`]: as many sums as fit the registers with room for the
/// operands (16 of 4 lanes in SSE and NEON; 64 in the wider sets, to cover the latency of the addition). `PANELS` panels
/// are read at a time: weights come from the second-level cache, which answers two streams faster than one.
#[inline(always)]
fn forward<const TILE: usize, const PANELS: usize, const FMA: bool>(layer: &Panels, input: &[f32], output: &mut [f32]) {
    let wide = output.len() / PANEL;
    // Panel after panel of each stream follows in memory, so that what is asked for ahead is what comes.
    let stream = wide / PANELS;
    for panel in 0..stream {
        let together = core::array::from_fn(|p| (panel + p * stream) * PANEL);
        tiles::<PANEL, TILE, PANELS, FMA>(layer, together, input, output);
    }
    for panel in stream * PANELS..wide {
        tiles::<PANEL, TILE, 1, FMA>(layer, [panel * PANEL], input, output);
    }
    let left = |panel: usize| wide * PANEL + panel * NARROW;
    match (output.len() - left(0)) / NARROW {
        0 => {}
        1 => tiles::<NARROW, NARROW, 1, FMA>(layer, [left(0)], input, output),
        2 => tiles::<NARROW, NARROW, 2, FMA>(layer, [left(0), left(1)], input, output),
        _ => tiles::<NARROW, NARROW, 3, FMA>(layer, [left(0), left(1), left(2)], input, output),
    }
}

/// The outputs of some panels of `WIDTH`, given by the first of each.
#[inline(always)]
fn tiles<const WIDTH: usize, const TILE: usize, const PANELS: usize, const FMA: bool>(
    layer: &Panels,
    firsts: [usize; PANELS],
    input: &[f32],
    output: &mut [f32],
) {
    let weights = firsts.map(|first| {
        let panel = &layer.weights[layer.start + first * layer.inputs..][..WIDTH * layer.inputs];
        panel.as_chunks::<WIDTH>().0
    });
    for within in (0..WIDTH).step_by(TILE) {
        let mut sums = [[0.0f32; TILE]; PANELS];
        for (sums, first) in sums.iter_mut().zip(firsts) {
            sums.copy_from_slice(&layer.bias[first + within..][..TILE]);
        }
        for (i, &x) in input.iter().enumerate() {
            for (sums, weights) in sums.iter_mut().zip(&weights) {
                let row = &weights[i][within..within + TILE];
                ahead(row);
                for (sum, &weight) in sums.iter_mut().zip(row) {
                    *sum = multiply_add::<FMA>(x, weight, *sum);
                }
            }
        }
        for (mut sums, first) in sums.into_iter().zip(firsts) {
            finish::<TILE, FMA>(layer.finish, &mut sums);
            output[first + within..][..TILE].copy_from_slice(&sums);
        }
    }
}

#[inline(always)]
fn finish<const TILE: usize, const FMA: bool>(how: Finish, sums: &mut [f32; TILE]) {
    match how {
        Finish::Linear => {}
        Finish::Activate(Activation::Tanh) => sums.iter_mut().for_each(|x| *x = tanh::<FMA>(*x)),
        Finish::Activate(Activation::Elu) => sums.iter_mut().for_each(|x| *x = elu::<FMA>(*x)),
        Finish::Activate(Activation::Relu) => sums.iter_mut().for_each(|x| *x = if *x < 0.0 { 0.0 } else { *x }),
        Finish::Softplus => sums.iter_mut().for_each(|x| *x = softplus::<FMA>(*x)),
    }
}

/// Asks for the weights that come [`AHEAD`] after those in `row`.
#[inline(always)]
fn ahead(row: &[f32]) {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    for line in row.as_chunks::<LINE>().0 {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a hint reads nothing and no address is wrong for it.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast::<i8>().wrapping_add(AHEAD));
        }
    }
    #[cfg(not(all(feature = "std", target_arch = "x86_64")))]
    let _ = row;
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

/// `x` above zero, `exp(x) - 1` below.
#[inline(always)]
fn elu<const FMA: bool>(x: f32) -> f32 {
    let exponential = exp::<FMA>(x.clamp(-87.0, 0.0));
    if x < 0.0 { exponential - 1.0 } else { x }
}

/// `ln(1 + exp(x))`, which is `x` above zero and `ln(1 + exp(-|x|))`, by the series of `2 artanh(t / (2 + t))`, whose argument is at most a
/// third.
#[inline(always)]
pub(crate) fn softplus<const FMA: bool>(x: f32) -> f32 {
    let t = exp::<FMA>((if x > 0.0 { -x } else { x }).clamp(-87.0, 0.0));
    let s = t / (2.0 + t);
    let square = s * s;
    let series = [1.0 / 13.0, 1.0 / 11.0, 1.0 / 9.0, 1.0 / 7.0, 0.2, 1.0 / 3.0, 1.0]
        .iter()
        .fold(1.0 / 15.0, |sum, &c| multiply_add::<FMA>(sum, square, c));
    multiply_add::<FMA>(2.0 * s, series, x.clamp(0.0, f32::INFINITY))
}

/// `exp(x) = 2^n exp(r)` for `x` from -87 to 0, with |r| at most half of ln 2, by its Taylor series.
#[inline(always)]
fn exp<const FMA: bool>(x: f32) -> f32 {
    /// 1.5 * 2^23: a float this large has no fraction, so adding it rounds.
    const ROUND: f32 = 12_582_912.0;
    /// ln 2 in two parts, the first short enough that multiples of it are exact.
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    let shifted = multiply_add::<FMA>(x, core::f32::consts::LOG2_E, ROUND);
    let power = shifted - ROUND;
    let r = multiply_add::<FMA>(power, -LN_2[1], multiply_add::<FMA>(power, -LN_2[0], x));
    let series = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0]
        .iter()
        .fold(1.0 / 5040.0, |sum, &c| multiply_add::<FMA>(sum, r, c));
    series * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
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
        // An interpreter takes a thousandth of them.
        for i in (-200_000..200_000).step_by(if cfg!(miri) { 997 } else { 1 }) {
            let x = i as f32 * 1e-4;
            let exact = f64::from(x);
            assert!((f64::from(tanh::<false>(x)) - exact.tanh()).abs() < 1e-6, "tanh {x}");
            assert!((f64::from(tanh::<true>(x)) - exact.tanh()).abs() < 1e-6, "tanh {x}");
            let elu_exact = if exact < 0.0 { exact.exp_m1() } else { exact };
            assert!((f64::from(elu::<false>(x)) - elu_exact).abs() < 1e-6, "elu {x}");
            // A Beta distribution's mode is a ratio of two of these, however small they are.
            let softplus_exact = exact.exp().ln_1p();
            let relative = |found: f32| (f64::from(found) / softplus_exact - 1.0).abs();
            assert!(relative(softplus::<false>(x)) < 1e-6, "softplus {x}");
            assert!(relative(softplus::<true>(x)) < 1e-6, "softplus {x}");
        }
        assert!(
            [tanh::<false>, elu::<false>, softplus::<false>]
                .iter()
                .all(|f| f(f32::NAN).is_nan())
        );
        assert!((tanh::<false>(f32::INFINITY) - 1.0).abs() < 1e-6);
        assert_eq!(elu::<false>(f32::NEG_INFINITY), -1.0);
    }

    #[test]
    fn every_instruction_set_agrees_with_a_sum_in_double_precision() {
        let sizes = [(1, 1), (130, 65), (40, 110), (49, 512), (512, 32)];
        // An interpreter leaves the large ones out.
        for &(inputs, outputs) in &sizes[..if cfg!(miri) { 3 } else { 5 }] {
            let value = |i: usize| ((i * 7919 % 1000) as f32 / 1000.0 - 0.5) / (inputs as f32).sqrt();
            let weights: Vec<f32> = (0..inputs * outputs).map(value).collect();
            let bias: Vec<f32> = (0..outputs).map(value).collect();
            let input: Vec<f32> = (0..inputs).map(|i| 10.0 * value(i + 3)).collect();
            for finish in [
                Finish::Linear,
                Finish::Activate(Activation::Tanh),
                Finish::Activate(Activation::Elu),
                Finish::Activate(Activation::Relu),
                Finish::Softplus,
            ] {
                let layer = Panels::new(inputs, &weights, &bias, finish);
                for level in levels() {
                    let mut output = vec![0.0; layer.width()];
                    layer.apply(level, &input, &mut output);
                    for (o, row) in weights.chunks_exact(inputs).enumerate() {
                        let products = row.iter().zip(&input).map(|(w, x)| f64::from(*w) * f64::from(*x));
                        let sum = f64::from(bias[o]) + products.sum::<f64>();
                        let expected = match finish {
                            Finish::Linear => sum,
                            Finish::Activate(Activation::Tanh) => sum.tanh(),
                            Finish::Activate(Activation::Elu) if sum < 0.0 => sum.exp_m1(),
                            Finish::Activate(Activation::Elu) => sum,
                            Finish::Activate(Activation::Relu) => sum.max(0.0),
                            Finish::Softplus => sum.exp().ln_1p(),
                        };
                        assert!((f64::from(output[o]) - expected).abs() < 2e-6, "{level:?} {finish:?}");
                    }
                }
            }
        }
    }
}
