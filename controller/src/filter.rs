//! Low-pass filters on the action. They start at rest at their first input, so the first output is the first
//! input and an episode does not begin with a transient from zero.

use alloc::{vec, vec::Vec};

use libm::tanf;
use serde::{Deserialize, Serialize};

use crate::spec::FilterSpec;

/// A second-order low-pass with gain 1 at standstill, one state per channel: transposed direct form II,
/// `y_k = b0 x_k + b1 x_{k-1} + b2 x_{k-2} - a1 y_{k-1} - a2 y_{k-2}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Filter {
    coefficients: Coefficients,
    /// The two delays of each channel; empty of meaning until `started`.
    state: Vec<[f32; 2]>,
    started: bool,
}

/// b0, b1, b2 and a1, a2.
type Coefficients = ([f32; 3], [f32; 2]);

impl FilterSpec {
    /// b0, b1, b2 and a1, a2 of `y_k = b0 x_k + b1 x_{k-1} + b2 x_{k-2} - a1 y_{k-1} - a2 y_{k-2}` at `rate_hz`.
    pub fn coefficients(self, rate_hz: f32) -> Coefficients {
        match self {
            Self::Exponential { gain } => ([gain, 0.0, 0.0], [gain - 1.0, 0.0]),
            Self::Butterworth { cutoff_hz } => {
                // s = (1 - 1/z) / (1 + 1/z) / k in 1 / (s^2 + sqrt(2) s + 1), with k prewarped so that the
                // cutoff stays where it is.
                let k = tanf(core::f32::consts::PI * cutoff_hz / rate_hz);
                let damping = core::f32::consts::SQRT_2 * k;
                let norm = 1.0 / (1.0 + damping + k * k);
                let b = k * k * norm;
                (
                    [b, 2.0 * b, b],
                    [2.0 * (k * k - 1.0) * norm, (1.0 - damping + k * k) * norm],
                )
            }
        }
    }
}

impl Filter {
    pub(crate) fn new(spec: FilterSpec, rate_hz: f32, channels: usize) -> Self {
        Self {
            coefficients: spec.coefficients(rate_hz),
            state: vec![[0.0; 2]; channels],
            started: false,
        }
    }

    pub(crate) fn channels(&self) -> usize {
        self.state.len()
    }

    pub(crate) fn reset(&mut self) {
        self.started = false;
        self.state.fill([0.0; 2]);
    }

    /// Filters one sample of every channel in place.
    pub(crate) fn apply(&mut self, values: &mut [f32]) {
        let (b, a) = self.coefficients;
        if !self.started {
            self.started = true;
            for (state, x) in self.state.iter_mut().zip(values.iter()) {
                *state = [(1.0 - b[0]) * x, (b[2] - a[1]) * x];
            }
        }
        for (state, value) in self.state.iter_mut().zip(values) {
            let x = *value;
            let y = b[0] * x + state[0];
            *state = [b[1] * x - a[0] * y + state[1], b[2] * x - a[1] * y];
            *value = y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUTTERWORTH: FilterSpec = FilterSpec::Butterworth { cutoff_hz: 10.0 };

    fn run(spec: FilterSpec, rate_hz: f32, input: &[f32]) -> Vec<f32> {
        let mut filter = Filter::new(spec, rate_hz, 1);
        input
            .iter()
            .map(|&x| {
                let mut value = [x];
                filter.apply(&mut value);
                value[0]
            })
            .collect()
    }

    /// Numbers from scipy 1.x: `b, a = scipy.signal.butter(2, fc, fs=fs)` (for the exponential `b, a = [0.3], [1, -0.7]`), then
    /// `scipy.signal.lfilter(b, a, x, zi=scipy.signal.lfilter_zi(b, a) * x[0])`.
    #[test]
    fn filters_agree_with_scipy() {
        let x = [0.2, -0.5, 0.9, 1.0, -1.0, 0.0, 0.3, 0.3];
        let cases: [(FilterSpec, f32, [f32; 8]); 3] = [
            (
                BUTTERWORTH,
                40.0,
                [
                    0.2,
                    -0.00502525,
                    -0.00502525,
                    0.6745166,
                    0.55735931,
                    -0.40862197,
                    -0.30065299,
                    0.33371234,
                ],
            ),
            (
                FilterSpec::Butterworth { cutoff_hz: 6.0 },
                50.0,
                [
                    0.2, 0.13607957, 0.07328377, 0.2347085, 0.37859908, 0.199023, -2.488e-05, 0.01296556,
                ],
            ),
            (
                FilterSpec::Exponential { gain: 0.3 },
                40.0,
                [0.2, -0.01, 0.263, 0.4841, 0.03887, 0.027209, 0.1090463, 0.16633241],
            ),
        ];
        for (spec, rate, expected) in cases {
            for (y, expected) in run(spec, rate, &x).iter().zip(expected) {
                assert!((y - expected).abs() < 1e-6, "{spec:?}: {y} {expected}");
            }
        }
    }

    #[test]
    fn the_first_output_is_the_first_input_and_a_constant_stays() {
        for spec in [BUTTERWORTH, FilterSpec::Exponential { gain: 0.3 }] {
            for y in run(spec, 40.0, &[0.7; 50]) {
                assert!((y - 0.7).abs() < 1e-6, "{spec:?} {y}");
            }
        }
    }

    /// Gain of the bilinear Butterworth is `1 / sqrt(1 + (tan(pi f / fs) / tan(pi fc / fs))^4)`.
    #[test]
    fn the_frequency_response_is_the_analytic_one() {
        for (cutoff, rate) in [(10.0f32, 40.0f32), (4.0, 40.0), (5.0, 100.0)] {
            for frequency in [0.5f32, 1.0, 2.0, 5.0, 9.0, 15.0] {
                let phase = |k: usize| 2.0 * core::f64::consts::PI * f64::from(frequency) * k as f64 / f64::from(rate);
                let input: Vec<f32> = (0..4000).map(|k| phase(k).sin() as f32).collect();
                let output = run(FilterSpec::Butterworth { cutoff_hz: cutoff }, rate, &input);
                // Projection on sine and cosine over whole periods after the transient.
                let (mut sine, mut cosine) = (0.0f64, 0.0f64);
                for (k, &y) in output.iter().enumerate().skip(2000) {
                    sine += f64::from(y) * phase(k).sin();
                    cosine += f64::from(y) * phase(k).cos();
                }
                let measured = (sine.hypot(cosine)) / 1000.0;
                let warp = |f: f32| (core::f64::consts::PI * f64::from(f) / f64::from(rate)).tan();
                let expected = 1.0 / (1.0 + (warp(frequency) / warp(cutoff)).powi(4)).sqrt();
                assert!(
                    (measured - expected).abs() < 1e-4,
                    "{cutoff} {frequency}: {measured} {expected}"
                );
            }
        }
    }
}
