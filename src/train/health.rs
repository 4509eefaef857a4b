//! Whether a run is going wrong: numbers that are not finite, and the three ways in which a learner comes apart.

use std::fmt::{self, Display};

use miette::Diagnostic;
use omniwalk_env::task::episode::Fault;
use thiserror::Error;

use super::metrics::Figure;
use super::trainer::{Report, Trainer};

/// Divergence of the policy in an update beyond which it has been torn from what it learned; 0.01 is usual.
const KL: f64 = 0.2;
/// Entropy of the action per joint, nats, below which nothing is tried any more: a deviation of 0.4 % of the range.
/// A finished walk has -0.9.
const ENTROPY: f64 = -4.0;
/// Explained variance below which the critic is worse than a constant, after the updates in which it finds its scale.
const EXPLAINED: f64 = -1.0;
const SETTLED: f64 = 50.0;

/// What is wrong with an update, in words, the gravest first; `None` if nothing is.
pub fn symptom(trainer: &Trainer, report: &Report, figures: &[Figure]) -> Option<String> {
    lost(trainer, report).or_else(|| {
        let figure = |name: &str| {
            figures
                .iter()
                .find(|(key, _)| *key == name)
                .map_or(f64::NAN, |(_, value)| *value)
        };
        Symptom::of(figure, trainer.spec().action_len()).map(|symptom| symptom.to_string())
    })
}

/// Why a run cannot go on.
#[derive(Debug, Error, Diagnostic)]
pub enum Dead {
    /// No step of an update could be computed.
    #[error(
        "every world went non-finite in every step of update {update}; the last checkpoint is as it was: {symptom}"
    )]
    #[diagnostic(help(
        "no step can be computed: look at masses, gains and armature with `omniwalk inspect ROBOT`, or raise engine.physics_hz"
    ))]
    Worlds {
        /// Updates done.
        update: u64,
        /// What was wrong with the first.
        symptom: String,
    },
    /// A weight is not finite.
    #[error("the networks' weights are not finite after update {update}; the last checkpoint is as it was")]
    #[diagnostic(help(
        "lower ppo.learning_rate and begin again, or look at reward.* and train.reward_scale for huge numbers"
    ))]
    Weights {
        /// Updates done.
        update: u64,
    },
}

/// Whether the run can go on, to be asked before anything of an update is kept.
///
/// # Errors
/// [`Dead`] if it cannot.
pub fn check(trainer: &Trainer, report: &Report, symptom: Option<&str>) -> Result<(), Dead> {
    let update = trainer.progress().update;
    if report.lost == report.samples as u64 {
        let symptom = symptom.unwrap_or_default().to_owned();
        return Err(Dead::Worlds { update, symptom });
    }
    if !trainer.agent().is_finite() {
        return Err(Dead::Weights { update });
    }
    Ok(())
}

/// A way in which a learner comes apart, with the figure that says so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Symptom {
    /// Minibatches whose loss or gradient was not finite.
    Skipped(f64),
    /// Divergence of the policy in one update.
    Torn(f64),
    /// Entropy of the action, nats a joint.
    Collapsed(f64),
    /// Explained variance of the critic.
    Blind(f64),
}

impl Symptom {
    /// What is wrong by the figures of an update of a policy of `joints` joints, as `metrics.csv` has them.
    pub fn of(figure: impl Fn(&str) -> f64, joints: usize) -> Option<Self> {
        let [skipped, kl, entropy, explained] =
            ["ppo/skipped", "ppo/kl", "ppo/entropy", "ppo/explained_variance"].map(&figure);
        if skipped > 0.0 {
            Some(Self::Skipped(skipped))
        } else if kl > KL {
            Some(Self::Torn(kl))
        } else if entropy < ENTROPY * joints as f64 {
            Some(Self::Collapsed(entropy / joints as f64))
        } else if explained < EXPLAINED && figure("update") > SETTLED {
            Some(Self::Blind(explained))
        } else {
            None
        }
    }

    /// Whether `other` says the same, however strongly.
    pub fn is_like(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }
}

impl Display for Symptom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Skipped(count) => write!(f, "{count} minibatches left out: a loss or gradient was not finite"),
            Self::Torn(kl) => write!(
                f,
                "diverging: the policy changed by a KL of {kl:.2} in one update; lower ppo.learning_rate"
            ),
            Self::Collapsed(each) => write!(
                f,
                "entropy collapsed to {each:.1} nats a joint: nothing is tried any more; raise ppo.entropy_weight"
            ),
            Self::Blind(explained) => write!(
                f,
                "diverging: the critic explains {explained:.1} of the returns' variance, less than a constant"
            ),
        }
    }
}

fn lost(trainer: &Trainer, report: &Report) -> Option<String> {
    let (environment, fault) = report.fault?;
    let what = match fault {
        Fault::Physics => "the physics".into(),
        Fault::Observation(entry) => {
            let name = trainer.spec().entry_name(entry).unwrap_or_default();
            format!("the observation's {name}")
        }
        Fault::Reward(term) => format!("the reward's term {term}"),
    };
    Some(format!(
        "{} episodes lost; the first in environment {environment}, where {what} was not finite",
        report.lost
    ))
}

#[cfg(test)]
mod tests {
    use super::Symptom;

    fn found(changes: &[(&str, f64)]) -> Option<String> {
        let sound = [
            ("update", 100.0),
            ("ppo/skipped", 0.0),
            ("ppo/kl", 0.015),
            ("ppo/entropy", -14.0),
            ("ppo/explained_variance", 0.8),
        ];
        let figure = |name: &str| {
            let known = changes.iter().chain(&sound).find(|(key, _)| *key == name);
            known.map_or(f64::NAN, |(_, value)| *value)
        };
        Symptom::of(figure, 16).map(|symptom| symptom.to_string())
    }

    #[test]
    fn a_run_that_learns_has_no_symptom() {
        assert_eq!(found(&[]), None);
        assert_eq!(found(&[("update", 1.0), ("ppo/explained_variance", -7.5)]), None);
    }

    #[test]
    fn each_way_of_coming_apart_is_named() {
        for (key, value, word) in [
            ("ppo/skipped", 3.0, "3 minibatches"),
            ("ppo/kl", 0.5, "KL of 0.50"),
            ("ppo/entropy", -80.0, "-5.0 nats"),
            ("ppo/explained_variance", -2.0, "critic"),
        ] {
            let symptom = found(&[(key, value)]).unwrap_or_default();
            assert!(symptom.contains(word), "{symptom}");
        }
    }
}
