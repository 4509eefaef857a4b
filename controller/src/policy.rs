//! A policy with everything it needs to run.

use alloc::{string::String, vec::Vec};

use thiserror::Error;

use crate::{
    actor::{Actor, ActorError},
    golden::{Golden, GoldenError},
    math::is_finite,
    spec::Spec,
    validate::SpecError,
    weights::Precision,
};

/// A policy as training leaves it.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// What observation and action mean.
    pub(crate) spec: Spec,
    pub(crate) actor: Actor,
    pub(crate) bounds: Bounds,
    pub(crate) identity: Identity,
    pub(crate) golden: Golden,
}

/// What training saw of each entry of the observation; observations are clipped to it (thesis 7.4). May be infinite.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest values, in the units of the observation.
    pub lower: Vec<f32>,
    /// Largest values.
    pub upper: Vec<f32>,
}

/// Where a policy comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Identity {
    /// SHA-256 of the run's effective configuration.
    pub config_hash: [u8; 32],
    /// Seed of the run.
    pub seed: u64,
    /// Policy steps it was trained for.
    pub steps: u64,
    /// Name and version of the program that trained it.
    pub program: String,
    /// Smallest and largest latency it was trained with, s.
    pub latency: [f32; 2],
    /// How far the curriculum had come.
    pub curriculum: Curriculum,
}

/// The state of the curriculum at the end of training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curriculum {
    /// Smallest desired velocity (m/s, m/s, rad/s) that was trained: what is asked is clipped to it.
    pub lower: [f32; 3],
    /// Largest one.
    pub upper: [f32; 3],
    /// C_v, the factor on the velocity reward (thesis 7.3.3).
    pub velocity_factor: f32,
    /// C_foot, the factor on the foot reward.
    pub foot_factor: f32,
}

/// Why parts do not make a policy.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PolicyError {
    /// The spec alone is wrong.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// The network alone is wrong.
    #[error(transparent)]
    Actor(#[from] ActorError),
    /// The policy does not do what it should, or nothing says what that is.
    #[error(transparent)]
    Golden(#[from] GoldenError),
    /// Two parts differ in a length.
    #[error("{what}: {found} instead of the spec's {expected}")]
    Length {
        /// Which one.
        what: &'static str,
        /// What the spec says.
        expected: usize,
        /// What it is.
        found: usize,
    },
    /// A bound is not a number or above its partner.
    #[error("observation bounds of entry {entry}: lower must not be above upper")]
    Bounds {
        /// Index into the observation.
        entry: usize,
    },
    /// A latency or a range that cannot be.
    #[error("{what} must be finite, the smaller one first")]
    Range {
        /// Which one.
        what: &'static str,
    },
}

impl Policy {
    /// Puts a policy together and records its golden vectors.
    ///
    /// # Errors
    /// What does not fit.
    pub fn new(spec: Spec, actor: Actor, bounds: Bounds, identity: Identity) -> Result<Self, PolicyError> {
        let mut policy = Self {
            spec,
            actor,
            bounds,
            identity,
            golden: Golden::default(),
        };
        policy.validate_parts()?;
        policy.golden = policy.record()?;
        policy.validate()?;
        Ok(policy)
    }

    /// The same policy with weights of another precision, and golden vectors of its own.
    ///
    /// # Errors
    /// When a weight has no finite value in `precision`.
    pub fn with_precision(&self, precision: Precision) -> Result<Self, PolicyError> {
        let actor = self.actor.with_precision(precision);
        Self::new(self.spec.clone(), actor, self.bounds.clone(), self.identity.clone())
    }

    /// What observation and action mean.
    pub fn spec(&self) -> &Spec {
        &self.spec
    }

    /// The network.
    pub fn actor(&self) -> &Actor {
        &self.actor
    }

    /// How the weights are stored: the lowest precision of its layers.
    pub fn precision(&self) -> Precision {
        let layers = self.actor.layers.iter().map(|layer| layer.weights.precision());
        layers.max().unwrap_or(Precision::F32)
    }

    /// What training saw.
    pub fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    /// Where it comes from.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The vectors it is checked against.
    pub fn golden(&self) -> &Golden {
        &self.golden
    }

    /// Checks that all parts are valid and fit each other.
    pub(crate) fn validate(&self) -> Result<(), PolicyError> {
        self.validate_parts()?;
        self.golden
            .validate(self.spec.observation_len(), self.spec.action_len())
    }

    fn validate_parts(&self) -> Result<(), PolicyError> {
        self.spec.validate()?;
        self.actor.validate()?;
        let width = self.spec.observation_len();
        same("the network's inputs", width, self.actor.observation_len())?;
        same("the network's actions", self.spec.action_len(), self.actor.action_len())?;
        same("lower observation bounds", width, self.bounds.lower.len())?;
        same("upper observation bounds", width, self.bounds.upper.len())?;
        let mut pairs = self.bounds.lower.iter().zip(&self.bounds.upper);
        if let Some(entry) = pairs.position(|(lower, upper)| lower.is_nan() || upper.is_nan() || lower > upper) {
            return Err(PolicyError::Bounds { entry });
        }
        let Identity {
            latency, curriculum, ..
        } = &self.identity;
        range("latency", latency[0] >= 0.0, &latency[..1], &latency[1..])?;
        let Curriculum { lower, upper, .. } = curriculum;
        let factors = is_finite(&[curriculum.velocity_factor, curriculum.foot_factor]);
        range("the curriculum", factors, lower, upper)
    }
}

fn range(what: &'static str, right: bool, lower: &[f32], upper: &[f32]) -> Result<(), PolicyError> {
    let ordered = lower.iter().zip(upper).all(|(lower, upper)| lower <= upper);
    if right && ordered && is_finite(lower) && is_finite(upper) {
        Ok(())
    } else {
        Err(PolicyError::Range { what })
    }
}

pub(crate) fn same(what: &'static str, expected: usize, found: usize) -> Result<(), PolicyError> {
    if expected == found {
        Ok(())
    } else {
        Err(PolicyError::Length { what, expected, found })
    }
}
