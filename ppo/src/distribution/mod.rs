//! The distributions of an action given the network's outputs.
//!
//! A head has two parameters for each action dimension; the network's output row holds the first parameter of every
//! dimension, then the second of every dimension. Dimensions are independent. Everything is computed in `f64`: the
//! logarithm of the gamma function in `f32` is wrong in the third digit for concentrated policies.

mod beta;
mod gaussian;
mod head;

pub use beta::Beta;
pub use gaussian::Gaussian;
use serde::{Deserialize, Serialize};

pub(crate) use head::{HeadScratch, LossCoefficients, LossSums, Samples, loss, reference};

/// The distribution of the actions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Head {
    /// [`Beta`] on [0, 1].
    Beta,
    /// [`Gaussian`], unbounded, with [0, 1] as its nominal range.
    Gaussian,
}

impl Head {
    /// Samples an action of one dimension; not a number if the outputs are not.
    pub(crate) fn sample(self, first: f32, second: f32, random: &mut rand_chacha::ChaCha8Rng) -> f32 {
        match self {
            Head::Beta => Beta::from_outputs(first, second).sample(random),
            Head::Gaussian => Gaussian::from_outputs(first, second).sample(random),
        }
    }

    /// The most likely action of one dimension.
    pub(crate) fn mode(self, first: f32, second: f32) -> f32 {
        match self {
            Head::Beta => Beta::from_outputs(first, second).mode() as f32,
            Head::Gaussian => Gaussian::from_outputs(first, second).mode() as f32,
        }
    }
}

/// A quantity with its derivatives by the distribution's two parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Differentiated {
    /// The quantity.
    pub value: f64,
    /// Derivative by the first parameter (alpha, or the mean).
    pub by_first: f64,
    /// Derivative by the second parameter (beta, or the standard deviation).
    pub by_second: f64,
}

/// What the loss needs of one dimension of one sample; derivatives are by the network's outputs.
#[derive(Clone, Copy)]
pub(crate) struct Terms {
    pub log_probability: Differentiated,
    pub entropy: Differentiated,
    /// Squared distance of mode and mean.
    pub skew: Differentiated,
    pub kl: f64,
}
