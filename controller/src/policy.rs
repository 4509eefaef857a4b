//! A policy with everything it needs to run, and the loop that runs it.

use alloc::{string::String, vec, vec::Vec};

use libm::{fabsf, sinf};
use thiserror::Error;

use crate::{
    actor::{Actor, ActorError, Inference},
    math::is_finite,
    pipeline::{Pipeline, Sensors},
    spec::Spec,
    validate::SpecError,
};

/// Largest difference from a golden number x, relative to `1 + |x|`: instruction sets round differently, by some 1e-6.
pub const GOLDEN_TOLERANCE: f32 = 1e-4;

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
}

/// Inputs and outputs of the policy on the machine that wrote it.
#[derive(Clone, Debug, PartialEq)]
pub struct Golden {
    /// The network alone (bounds, normaliser, mode).
    pub actions: Vec<GoldenAction>,
    /// Clock phase at the reset before `steps`.
    pub clock_phase: f32,
    /// The whole loop, step after step.
    pub steps: Vec<GoldenStep>,
}

/// An observation and its action.
#[derive(Clone, Debug, PartialEq)]
pub struct GoldenAction {
    /// The observation.
    pub observation: Vec<f32>,
    /// The most likely action.
    pub action: Vec<f32>,
}

/// One step of the loop; fields as in [`Sensors`].
#[derive(Clone, Debug, PartialEq)]
pub struct GoldenStep {
    /// Joint positions, rad or m.
    pub position: Vec<f32>,
    /// Joint velocities, rad/s or m/s.
    pub velocity: Vec<f32>,
    /// Fused roll and pitch, rad.
    pub attitude: [f32; 2],
    /// Angular velocity of the base, rad/s.
    pub gyro: [f32; 3],
    /// Velocity of the base instead of the estimate, m/s.
    pub base_velocity: Option<[f32; 3]>,
    /// Desired velocity, m/s, m/s, rad/s.
    pub desired: [f32; 3],
    /// The observation that follows, before bounds.
    pub observation: Vec<f32>,
    /// The targets that follow, rad or m.
    pub targets: Vec<f32>,
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
    /// A latency, phase or reading that cannot be.
    #[error("{what} is not a finite number")]
    NotFinite {
        /// Which one.
        what: &'static str,
    },
    /// There is nothing to check the policy against.
    #[error("the policy has no golden vectors")]
    NoGolden,
    /// The loop does not do here what it did where the policy was written.
    #[error(
        "golden {what} {index}, entry {entry}: {found} instead of {expected}; this program does not run the policy as it was trained"
    )]
    Golden {
        /// `action`, `observation` or `targets`.
        what: &'static str,
        /// Which vector or step.
        index: usize,
        /// Entry within it.
        entry: usize,
        /// What the file says.
        expected: f32,
        /// What came out.
        found: f32,
    },
}

impl Policy {
    /// Puts a policy together and records its golden vectors.
    ///
    /// # Errors
    /// What does not fit.
    pub fn new(spec: Spec, actor: Actor, bounds: Bounds, identity: Identity) -> Result<Self, PolicyError> {
        let golden = Golden {
            actions: Vec::new(),
            clock_phase: 0.0,
            steps: Vec::new(),
        };
        let mut policy = Self {
            spec,
            actor,
            bounds,
            identity,
            golden,
        };
        policy.validate_parts()?;
        policy.golden = policy.record()?;
        policy.validate()?;
        Ok(policy)
    }

    /// What observation and action mean.
    pub fn spec(&self) -> &Spec {
        &self.spec
    }

    /// The network.
    pub fn actor(&self) -> &Actor {
        &self.actor
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
        let (width, joints) = (self.spec.observation_len(), self.spec.action_len());
        let golden = &self.golden;
        if golden.actions.is_empty() || golden.steps.is_empty() {
            return Err(PolicyError::NoGolden);
        }
        if !golden.clock_phase.is_finite() {
            return Err(PolicyError::NotFinite {
                what: "clock phase of the golden vectors",
            });
        }
        for vector in &golden.actions {
            same("golden observation", width, vector.observation.len())?;
            same("golden action", joints, vector.action.len())?;
        }
        for step in &golden.steps {
            same("golden position", joints, step.position.len())?;
            same("golden velocity", joints, step.velocity.len())?;
            same("golden observation", width, step.observation.len())?;
            same("golden targets", joints, step.targets.len())?;
        }
        Ok(())
    }

    fn validate_parts(&self) -> Result<(), PolicyError> {
        self.spec.validate()?;
        self.actor.validate()?;
        let width = self.spec.observation_len();
        same("the network's inputs", width, self.actor.observation_len())?;
        same("the network's actions", self.spec.action_len(), self.actor.action_len())?;
        same("lower observation bounds", width, self.bounds.lower.len())?;
        same("upper observation bounds", width, self.bounds.upper.len())?;
        let pairs = self.bounds.lower.iter().zip(&self.bounds.upper);
        match pairs
            .into_iter()
            .position(|(lower, upper)| lower.is_nan() || upper.is_nan() || lower > upper)
        {
            Some(entry) => Err(PolicyError::Bounds { entry }),
            None if !is_finite(&self.identity.latency) => Err(PolicyError::NotFinite { what: "latency" }),
            None => Ok(()),
        }
    }

    /// Runs the golden vectors.
    pub(crate) fn verify(&self) -> Result<(), PolicyError> {
        let mut controller = Controller::new(self)?;
        let mut action = vec![0.0; self.spec.action_len()];
        for (index, vector) in self.golden.actions.iter().enumerate() {
            controller.act(&vector.observation, &mut action);
            compare("action", index, &vector.action, &action)?;
        }
        controller.reset(self.golden.clock_phase);
        for (index, step) in self.golden.steps.iter().enumerate() {
            controller.step(&step.sensors(), step.desired, &mut action);
            compare("observation", index, &step.observation, controller.observation())?;
            compare("targets", index, &step.targets, &action)?;
        }
        Ok(())
    }

    /// Golden vectors: observations spread over what the normaliser expects, and a loop whose readings move by sines.
    fn record(&self) -> Result<Golden, PolicyError> {
        const ACTIONS: usize = 16;
        const STEPS: usize = 60;
        let mut controller = Controller::new(self)?;
        let joints = self.spec.action_len();
        let mut actions = Vec::new();
        for index in 0..ACTIONS {
            let entry = |(i, (mean, deviation)): (usize, (&f32, &f32))| {
                mean + 2.0 * deviation * sinf(1.7 * index as f32 + 0.9 * i as f32)
            };
            let statistics = self.actor.mean.iter().zip(&self.actor.deviation);
            let observation: Vec<f32> = statistics.enumerate().map(entry).collect();
            let mut action = vec![0.0; joints];
            controller.act(&observation, &mut action);
            actions.push(GoldenAction { observation, action });
        }
        let clock_phase = 0.25;
        controller.reset(clock_phase);
        let mut steps = Vec::new();
        for k in 0..STEPS {
            let time = k as f32 / self.spec.control_hz;
            let wave = |size: f32, rate: f32, shift: usize| size * sinf(rate * time + 0.7 * shift as f32);
            let mut step = GoldenStep {
                position: self
                    .spec
                    .joints
                    .iter()
                    .enumerate()
                    .map(|(i, j)| j.nominal + wave(0.1, 6.0, i))
                    .collect(),
                velocity: (0..joints).map(|i| wave(0.6, 6.0, i + 2)).collect(),
                attitude: [wave(0.06, 5.0, 1), wave(0.1, 4.0, 2)],
                gyro: [wave(0.3, 5.0, 3), wave(0.4, 4.0, 4), wave(0.5, 3.0, 5)],
                // Both sources of the velocity.
                base_velocity: (k % 20 >= 15).then(|| [wave(0.4, 2.0, 6), wave(0.2, 3.0, 7), wave(0.1, 9.0, 8)]),
                desired: [wave(0.8, 2.0, 1), wave(0.4, 1.0, 2), wave(0.6, 3.0, 3)],
                observation: Vec::new(),
                targets: vec![0.0; joints],
            };
            let mut targets = vec![0.0; joints];
            controller.step(&step.sensors(), step.desired, &mut targets);
            step.observation = controller.observation().to_vec();
            step.targets = targets;
            steps.push(step);
        }
        Ok(Golden {
            actions,
            clock_phase,
            steps,
        })
    }
}

impl GoldenStep {
    /// The readings.
    pub fn sensors(&self) -> Sensors<'_> {
        Sensors {
            position: &self.position,
            velocity: &self.velocity,
            attitude: self.attitude,
            gyro: self.gyro,
            base_velocity: self.base_velocity,
        }
    }
}

fn same(what: &'static str, expected: usize, found: usize) -> Result<(), PolicyError> {
    if expected == found {
        Ok(())
    } else {
        Err(PolicyError::Length { what, expected, found })
    }
}

fn compare(what: &'static str, index: usize, expected: &[f32], found: &[f32]) -> Result<(), PolicyError> {
    for (entry, (&expected, &found)) in expected.iter().zip(found).enumerate() {
        // Written so that a number that is none does not pass.
        let near = fabsf(found - expected) <= GOLDEN_TOLERANCE * (1.0 + fabsf(expected));
        if !near {
            return Err(PolicyError::Golden {
                what,
                index,
                entry,
                expected,
                found,
            });
        }
    }
    Ok(())
}

/// A policy in its loop: readings in, joint targets out. Nothing allocates after [`Controller::new`].
#[derive(Clone, Debug)]
pub struct Controller {
    spec: Spec,
    bounds: Bounds,
    pipeline: Pipeline,
    inference: Inference,
    observation: Vec<f32>,
    bounded: Vec<f32>,
    action: Vec<f32>,
}

impl Controller {
    /// A loop for `policy`, reset to clock phase 0.
    ///
    /// # Errors
    /// Those of [`Policy::new`]; none for a policy that was built or loaded.
    pub fn new(policy: &Policy) -> Result<Self, PolicyError> {
        let width = policy.spec.observation_len();
        Ok(Self {
            pipeline: Pipeline::new(&policy.spec)?,
            inference: Inference::new(&policy.actor)?,
            observation: vec![0.0; width],
            bounded: vec![0.0; width],
            action: vec![0.0; policy.spec.action_len()],
            spec: policy.spec.clone(),
            bounds: policy.bounds.clone(),
        })
    }

    /// Starts an episode, see [`Pipeline::reset`].
    pub fn reset(&mut self, clock_phase: f32) {
        self.pipeline.reset(&self.spec, clock_phase);
    }

    /// One step: writes the joint targets (rad or m, finite and within limits) that follow from the readings and the desired
    /// velocity (m/s, m/s, rad/s). Readings that are not finite hold the previous targets.
    ///
    /// # Panics
    /// When a length is not the spec's.
    pub fn step(&mut self, sensors: &Sensors, desired: [f32; 3], targets: &mut [f32]) {
        self.pipeline
            .observe(&self.spec, sensors, desired, &mut self.observation);
        bound(&self.bounds, &self.observation, &mut self.bounded);
        self.inference.action(&self.bounded, &mut self.action);
        self.pipeline.decode(&self.spec, &self.action, targets);
    }

    /// The action for an observation alone, without advancing the loop.
    ///
    /// # Panics
    /// When a length is not the spec's.
    pub fn act(&mut self, observation: &[f32], action: &mut [f32]) {
        bound(&self.bounds, observation, &mut self.bounded);
        self.inference.action(&self.bounded, action);
    }

    /// The observation of the last [`step`](Self::step), before bounds.
    pub fn observation(&self) -> &[f32] {
        &self.observation
    }

    /// The action of the last [`step`](Self::step).
    pub fn action(&self) -> &[f32] {
        &self.action
    }

    /// The loop's memory: commanded velocity, clock, estimated velocity.
    pub fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }
}

/// The observation within what training saw.
fn bound(bounds: &Bounds, observation: &[f32], bounded: &mut [f32]) {
    let limits = bounds.lower.iter().zip(&bounds.upper);
    for ((out, x), (&lower, &upper)) in bounded.iter_mut().zip(observation).zip(limits) {
        *out = x.clamp(lower, upper);
    }
}
