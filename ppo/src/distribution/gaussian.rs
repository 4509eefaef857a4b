//! The Gaussian head, the usual alternative: `u` is normal with mean `output` and standard deviation
//! `0.01 + softplus(output)`, and the action is `(1 + u) / 2`, so that [-1, 1] in `u` is the nominal range [0, 1].
//!
//! Densities are over `u`; the constant factor of the map cancels in every ratio.

use rand_distr::{Distribution, StandardNormal};

use super::{Differentiated, Terms};
use crate::{
    simd::{self, Kernel, Simd},
    special::{ln, softplus},
};

/// Smallest standard deviation: the density stays bounded.
const FLOOR: f64 = 0.01;
const HALF_LN_TAU: f64 = 0.918_938_533_204_672_8;

/// A normal distribution of `u = 2 action - 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// Mean of `u`.
    pub mean: f64,
    /// Standard deviation of `u`.
    pub deviation: f64,
}

impl Gaussian {
    /// From the two network outputs.
    pub fn from_outputs(first: f32, second: f32) -> Self {
        Self {
            mean: f64::from(first),
            deviation: FLOOR + simd::dispatch(Deviation(second)),
        }
    }

    /// The most likely action.
    pub fn mode(&self) -> f64 {
        0.5 + 0.5 * self.mean
    }

    /// Logarithm of the density of `u`.
    pub fn log_probability(&self, u: f64) -> Differentiated {
        self.log_probability_with(u, self.deviation.ln())
    }

    /// Differential entropy of `u`.
    pub fn entropy(&self) -> Differentiated {
        self.entropy_with(self.deviation.ln())
    }

    /// Divergence from `old` to `self`, the mean of `ln(old density / own density)` over `old`; derivatives by the
    /// parameters of `self`.
    pub fn kl_from(&self, old: &Gaussian) -> Differentiated {
        let reference = [old.mean, old.deviation, old.deviation.ln()];
        let variance = self.deviation * self.deviation;
        let shift = self.mean - old.mean;
        Differentiated {
            value: self.kl_with(reference, self.deviation.ln()),
            by_first: shift / variance,
            by_second: (1.0 - (old.deviation * old.deviation + shift * shift) / variance) / self.deviation,
        }
    }

    pub(crate) fn sample(&self, random: &mut rand_chacha::ChaCha8Rng) -> f32 {
        let noise: f64 = StandardNormal.sample(random);
        (0.5 + 0.5 * (self.mean + self.deviation * noise)) as f32
    }

    #[inline(always)]
    fn log_probability_with(&self, u: f64, ln_deviation: f64) -> Differentiated {
        let z = (u - self.mean) / self.deviation;
        Differentiated {
            value: -0.5 * z * z - ln_deviation - HALF_LN_TAU,
            by_first: z / self.deviation,
            by_second: (z * z - 1.0) / self.deviation,
        }
    }

    #[inline(always)]
    fn entropy_with(&self, ln_deviation: f64) -> Differentiated {
        Differentiated {
            value: 0.5 + HALF_LN_TAU + ln_deviation,
            by_first: 0.0,
            by_second: 1.0 / self.deviation,
        }
    }

    #[inline(always)]
    fn kl_with(&self, [mean, deviation, ln_old]: [f64; 3], ln_deviation: f64) -> f64 {
        let shift = self.mean - mean;
        ln_deviation - ln_old + (deviation * deviation + shift * shift) / (2.0 * self.deviation * self.deviation) - 0.5
    }
}

struct Deviation(f32);

impl Kernel for Deviation {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self) -> f64 {
        softplus::<S>(f64::from(self.0)).0
    }
}

/// The terms of the loss for one dimension of one sample.
#[inline(always)]
pub(super) fn terms<S: Simd>(first: f32, second: f32, action: f32, reference: [f64; 3]) -> Terms {
    let (deviation, slope) = softplus::<S>(f64::from(second));
    let this = Gaussian {
        mean: f64::from(first),
        deviation: FLOOR + deviation,
    };
    let ln_deviation = ln::<S>(this.deviation);
    let by_outputs = |d: Differentiated| Differentiated {
        by_second: d.by_second * slope,
        ..d
    };
    Terms {
        log_probability: by_outputs(this.log_probability_with(2.0 * f64::from(action) - 1.0, ln_deviation)),
        entropy: by_outputs(this.entropy_with(ln_deviation)),
        skew: Differentiated {
            value: 0.0,
            by_first: 0.0,
            by_second: 0.0,
        },
        kl: this.kl_with(reference, ln_deviation),
    }
}

/// The old distribution's share of the divergence, for one dimension of one sample.
#[inline(always)]
pub(super) fn reference<S: Simd>(first: f32, second: f32) -> [f64; 3] {
    let deviation = FLOOR + softplus::<S>(f64::from(second)).0;
    [f64::from(first), deviation, ln::<S>(deviation)]
}
