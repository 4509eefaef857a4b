//! The Beta distribution with `alpha, beta = 1 + softplus(output)`: bounded, unimodal (Chou et al. 2017).

use rand_distr::{Distribution, Gamma};

use super::{Differentiated, Terms};
use crate::{
    simd::{self, Kernel, Simd},
    special::{LogGamma, ln, log_gamma, softplus},
};

/// Samples keep this distance from 0 and 1, where the logarithm is infinite.
pub(crate) const MARGIN: f32 = 1e-6;

/// Where mode and mean are compared, `alpha + beta - 2` is at least this.
const SMALLEST: f64 = 1e-12;

/// A Beta distribution with both parameters at least 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beta {
    /// First shape parameter.
    pub alpha: f64,
    /// Second shape parameter.
    pub beta: f64,
}

/// The gamma family at alpha, beta and their sum.
struct Family {
    alpha: LogGamma,
    beta: LogGamma,
    sum: LogGamma,
}

impl Beta {
    /// From the two network outputs.
    pub fn from_outputs(first: f32, second: f32) -> Self {
        let (alpha, beta) = simd::dispatch(Shapes(first, second));
        Self {
            alpha: 1.0 + alpha,
            beta: 1.0 + beta,
        }
    }

    /// The most likely action; the mean if the distribution is uniform.
    pub fn mode(&self) -> f64 {
        let (a, b) = (self.alpha - 1.0, self.beta - 1.0);
        if a + b > 0.0 {
            a / (a + b)
        } else {
            self.alpha / (self.alpha + self.beta)
        }
    }

    /// Logarithm of the density at `x` in (0, 1).
    pub fn log_probability(&self, x: f64) -> Differentiated {
        simd::dispatch(Evaluate(*self, |family: &Family| {
            self.log_probability_with(family, x.ln(), (-x).ln_1p())
        }))
    }

    /// Differential entropy.
    pub fn entropy(&self) -> Differentiated {
        simd::dispatch(Evaluate(*self, |family: &Family| self.entropy_with(family)))
    }

    /// Squared distance of mode and mean, `(mode - mean) = (alpha - beta) / (s (s + 2))` with `s = alpha + beta - 2`.
    #[inline(always)]
    pub(crate) fn skew(&self) -> Differentiated {
        let sum = (self.alpha + self.beta - 2.0).max(SMALLEST);
        let divisor = sum * (sum + 2.0);
        let distance = (self.alpha - self.beta) / divisor;
        let common = distance * (2.0 * sum + 2.0);
        let scale = 2.0 * distance / divisor;
        Differentiated {
            value: distance * distance,
            by_first: scale * (1.0 - common),
            by_second: scale * (-1.0 - common),
        }
    }

    /// Divergence from `old` to `self`, the mean of `ln(old density / own density)` over `old`; derivatives by the
    /// parameters of `self`.
    pub fn kl_from(&self, old: &Beta) -> Differentiated {
        let reference = simd::dispatch(Evaluate(*old, |family: &Family| old.reference_with(family)));
        simd::dispatch(Evaluate(*self, |family: &Family| Differentiated {
            value: self.kl_with(family, reference),
            by_first: family.alpha.first - family.sum.first - reference[0],
            by_second: family.beta.first - family.sum.first - reference[1],
        }))
    }

    /// A sample as a quotient of two Gamma draws (Marsaglia and Tsang 2000).
    pub(crate) fn sample(&self, random: &mut rand_chacha::ChaCha8Rng) -> f32 {
        let (Ok(first), Ok(second)) = (Gamma::new(self.alpha, 1.0), Gamma::new(self.beta, 1.0)) else {
            return f32::NAN;
        };
        let (first, second): (f64, f64) = (first.sample(random), second.sample(random));
        ((first / (first + second)) as f32).clamp(MARGIN, 1.0 - MARGIN)
    }

    #[inline(always)]
    fn family<S: Simd>(&self) -> Family {
        Family {
            alpha: log_gamma::<S>(self.alpha),
            beta: log_gamma::<S>(self.beta),
            sum: log_gamma::<S>(self.alpha + self.beta),
        }
    }

    #[inline(always)]
    fn log_probability_with(&self, family: &Family, ln_x: f64, ln_rest: f64) -> Differentiated {
        Differentiated {
            value: (self.alpha - 1.0) * ln_x + (self.beta - 1.0) * ln_rest - log_beta(family),
            by_first: family.sum.first - family.alpha.first + ln_x,
            by_second: family.sum.first - family.beta.first + ln_rest,
        }
    }

    #[inline(always)]
    fn entropy_with(&self, family: &Family) -> Differentiated {
        let (a, b) = (self.alpha - 1.0, self.beta - 1.0);
        Differentiated {
            value: log_beta(family) - a * family.alpha.first - b * family.beta.first + (a + b) * family.sum.first,
            by_first: (a + b) * family.sum.second - a * family.alpha.second,
            by_second: (a + b) * family.sum.second - b * family.beta.second,
        }
    }

    /// What [`Self::kl_with`] needs of the old distribution: the means of `ln x` and `ln(1 - x)`, and the rest.
    #[inline(always)]
    fn reference_with(&self, family: &Family) -> [f64; 3] {
        let ln_x = family.alpha.first - family.sum.first;
        let ln_rest = family.beta.first - family.sum.first;
        [
            ln_x,
            ln_rest,
            self.alpha * ln_x + self.beta * ln_rest - log_beta(family),
        ]
    }

    #[inline(always)]
    fn kl_with(&self, family: &Family, [ln_x, ln_rest, rest]: [f64; 3]) -> f64 {
        rest + log_beta(family) - self.alpha * ln_x - self.beta * ln_rest
    }
}

#[inline(always)]
fn log_beta(family: &Family) -> f64 {
    family.alpha.value + family.beta.value - family.sum.value
}

struct Shapes(f32, f32);

impl Kernel for Shapes {
    type Output = (f64, f64);

    #[inline(always)]
    fn run<S: Simd>(self) -> (f64, f64) {
        (softplus::<S>(f64::from(self.0)).0, softplus::<S>(f64::from(self.1)).0)
    }
}

/// A computation on one distribution, given its gamma family.
struct Evaluate<F>(Beta, F);

impl<T, F: FnOnce(&Family) -> T> Kernel for Evaluate<F> {
    type Output = T;

    #[inline(always)]
    fn run<S: Simd>(self) -> T {
        (self.1)(&self.0.family::<S>())
    }
}

/// The terms of the loss for one dimension of one sample.
#[inline(always)]
pub(super) fn terms<S: Simd>(first: f32, second: f32, action: f32, reference: [f64; 3]) -> Terms {
    let (alpha, alpha_slope) = softplus::<S>(f64::from(first));
    let (beta, beta_slope) = softplus::<S>(f64::from(second));
    let this = Beta {
        alpha: 1.0 + alpha,
        beta: 1.0 + beta,
    };
    let family = this.family::<S>();
    let x = f64::from(action);
    let by_outputs = |d: Differentiated| Differentiated {
        value: d.value,
        by_first: d.by_first * alpha_slope,
        by_second: d.by_second * beta_slope,
    };
    Terms {
        log_probability: by_outputs(this.log_probability_with(&family, ln::<S>(x), ln::<S>(1.0 - x))),
        entropy: by_outputs(this.entropy_with(&family)),
        skew: by_outputs(this.skew()),
        kl: this.kl_with(&family, reference),
    }
}

/// The old distribution's share of the divergence, for one dimension of one sample.
#[inline(always)]
pub(super) fn reference<S: Simd>(first: f32, second: f32) -> [f64; 3] {
    let this = Beta {
        alpha: 1.0 + softplus::<S>(f64::from(first)).0,
        beta: 1.0 + softplus::<S>(f64::from(second)).0,
    };
    this.reference_with(&this.family::<S>())
}
