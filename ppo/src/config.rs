//! Configuration of the learner. Every value is given by the caller; none has a default here.

use serde::{Deserialize, Serialize};

pub use crate::{distribution::Head, elementwise::Activation};

/// Configuration of an [`Agent`](crate::Agent).
#[derive(Serialize, Deserialize, Clone, Debug, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Widths of the hidden layers, of the actor and of the critic.
    pub hidden: Vec<usize>,
    /// Non-linearity of the hidden layers.
    pub activation: Activation,
    /// Distribution of the actions.
    pub policy: Head,
    /// Learning rate of Adam; the first one if it adapts.
    pub learning_rate: f64,
    /// How the learning rate changes.
    pub schedule: Schedule,
    /// Discount per step, 0 to 1.
    pub gamma: f64,
    /// Decay of generalized advantage estimation per step, 0 to 1.
    pub lambda: f64,
    /// Range of the probability ratio: `1 - clip` to `1 + clip`.
    pub clip: f64,
    /// Probability ratio beyond which a sample with a negative advantage teaches nothing more (dual clip, Ye et al. 2020);
    /// 0: none. The clipped surrogate leaves such ratios unbounded, and mirror images, which the policy may find very
    /// unlikely, reach thousands: one of them then outweighs a minibatch.
    pub dual_clip: f64,
    /// Passes over the samples in an update.
    pub epochs: usize,
    /// Samples of a minibatch, mirrored ones among them. An update's samples are divided as evenly as possible.
    pub minibatch: usize,
    /// Weight of the mean entropy (of the action vector) in the loss.
    pub entropy_weight: f64,
    /// Weight of the squared distance between the mode of an action, by which a policy is judged, and its mean, around which it learns
    /// (of the action vector, in ranges of an action) in the loss.
    #[serde(default)]
    pub mode_weight: f64,
    /// Weight of the value loss, half the mean squared error.
    pub value_weight: f64,
    /// Largest norm of a network's gradient; a longer one is shortened. Actor and critic are clipped on their own.
    pub max_gradient_norm: f64,
    /// Observations are shifted and scaled by their running mean and standard deviation.
    pub normalise_observations: bool,
    /// Normalised observations are clamped to this magnitude.
    pub observation_clip: f64,
}

/// How the learning rate changes.
#[derive(Serialize, Deserialize, Clone, Copy, Debug, PartialEq)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Schedule {
    /// It does not.
    Fixed {},
    /// After each update, by the divergence of its last epoch's policies from the one that collected the samples: the rate is multiplied by
    /// the root of the target's ratio to it, 1.5 at most and 1 / 1.5 at least.
    Adaptive {
        /// Wanted divergence, nats, of the action vector.
        kl_target: f64,
        /// Steps of the optimiser after which the target falls as the inverse square of their number, and the learning rate that keeps to it
        /// as the inverse: what a policy is left with is then the mean of many updates and not the noise of the last (Robbins and Monro 1951).
        /// 0: it does not.
        settle: u64,
        /// Smallest learning rate.
        minimum: f64,
        /// Largest learning rate.
        maximum: f64,
    },
}

/// A value that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key}: {message}")]
pub struct InvalidConfig {
    /// The key, as in [`Config`]; keys of the schedule are `schedule.name`.
    pub key: &'static str,
    /// What would be right.
    pub message: String,
}

/// Widest layer: 16 MB of weights between two of them.
const MAX_WIDTH: usize = 2048;
/// Most hidden layers.
const MAX_LAYERS: usize = 8;

impl Config {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is out of its range.
    pub fn validate(&self) -> Result<(), InvalidConfig> {
        let check = |ok: bool, key: &'static str, message: &str| {
            if ok {
                Ok(())
            } else {
                Err(InvalidConfig {
                    key,
                    message: message.to_owned(),
                })
            }
        };
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let unit = |x: f64| (0.0..=1.0).contains(&x);
        check(
            (1..=MAX_LAYERS).contains(&self.hidden.len()) && self.hidden.iter().all(|w| (1..=MAX_WIDTH).contains(w)),
            "hidden",
            &format!("1 to {MAX_LAYERS} widths, each 1 to {MAX_WIDTH}"),
        )?;
        check(
            positive(self.learning_rate) && self.learning_rate <= 1.0,
            "learning_rate",
            "above 0, at most 1",
        )?;
        if let Schedule::Adaptive {
            kl_target,
            minimum,
            maximum,
            ..
        } = self.schedule
        {
            check(positive(kl_target), "schedule.kl_target", "above 0")?;
            check(
                positive(minimum) && minimum <= self.learning_rate,
                "schedule.minimum",
                "above 0 and at most learning_rate",
            )?;
            check(
                maximum <= 1.0 && maximum >= self.learning_rate,
                "schedule.maximum",
                "at least learning_rate and at most 1",
            )?;
        }
        check(unit(self.gamma), "gamma", "0 to 1")?;
        check(unit(self.lambda), "lambda", "0 to 1")?;
        check(positive(self.clip) && self.clip < 1.0, "clip", "above 0, below 1")?;
        check(
            self.dual_clip == 0.0 || self.dual_clip.is_finite() && self.dual_clip > 1.0 + self.clip,
            "dual_clip",
            "0 for none, or above 1 + clip",
        )?;
        check((1..=1000).contains(&self.epochs), "epochs", "1 to 1000")?;
        check((1..=1 << 24).contains(&self.minibatch), "minibatch", "1 to 16777216")?;
        check(
            self.entropy_weight.is_finite() && self.entropy_weight >= 0.0,
            "entropy_weight",
            "at least 0",
        )?;
        check(
            self.mode_weight.is_finite() && self.mode_weight >= 0.0,
            "mode_weight",
            "at least 0",
        )?;
        check(positive(self.value_weight), "value_weight", "above 0")?;
        check(positive(self.max_gradient_norm), "max_gradient_norm", "above 0")?;
        check(positive(self.observation_clip), "observation_clip", "above 0")
    }
}
