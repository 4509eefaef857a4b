//! Golden vectors: inputs and outputs of a policy on the machine that wrote it, which every reader must reproduce.

use alloc::{vec, vec::Vec};

use libm::{fabsf, sinf};
use thiserror::Error;

use crate::{
    pipeline::Sensors,
    policy::{Policy, PolicyError, same},
    walker::Walker,
};

/// Largest difference from a golden number x, relative to `1 + |x|`: instruction sets round differently, by some 1e-6.
pub const GOLDEN_TOLERANCE: f32 = 1e-4;

/// Most vectors of a kind: what bounds the time a file takes to load.
pub const MAX_GOLDEN: usize = 256;

/// Inputs and outputs of the policy on the machine that wrote it.
#[derive(Clone, Debug, Default, PartialEq)]
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

/// Why a policy is not checked by its golden vectors.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum GoldenError {
    /// There is nothing to check the policy against, or too much.
    #[error("the policy has {found} golden {what}; 1 to {MAX_GOLDEN} are right")]
    Count {
        /// `actions` or `steps`.
        what: &'static str,
        /// How many.
        found: usize,
    },
    /// A phase that is none.
    #[error("the clock phase of the golden vectors is not a finite number")]
    Phase,
    /// The loop does not do here what it did where the policy was written.
    #[error(
        "golden {what} {index}, entry {entry}: {found} instead of {expected}; this program does not run the policy as it was trained"
    )]
    Differs {
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

impl Golden {
    /// Checks the lengths against those of observation and action.
    pub(crate) fn validate(&self, width: usize, joints: usize) -> Result<(), PolicyError> {
        for (what, found) in [("actions", self.actions.len()), ("steps", self.steps.len())] {
            if !(1..=MAX_GOLDEN).contains(&found) {
                return Err(GoldenError::Count { what, found }.into());
            }
        }
        if !self.clock_phase.is_finite() {
            return Err(GoldenError::Phase.into());
        }
        for vector in &self.actions {
            same("golden observation", width, vector.observation.len())?;
            same("golden action", joints, vector.action.len())?;
        }
        for step in &self.steps {
            same("golden position", joints, step.position.len())?;
            same("golden velocity", joints, step.velocity.len())?;
            same("golden observation", width, step.observation.len())?;
            same("golden targets", joints, step.targets.len())?;
        }
        Ok(())
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

impl Policy {
    /// Runs the golden vectors.
    ///
    /// # Errors
    /// [`GoldenError::Differs`] at the first number that is another.
    pub fn verify(&self) -> Result<(), PolicyError> {
        let mut walker = Walker::new(self)?;
        let mut action = vec![0.0; self.spec.action_len()];
        for (index, vector) in self.golden.actions.iter().enumerate() {
            walker.act(&vector.observation, &mut action);
            compare("action", index, &vector.action, &action)?;
        }
        walker.reset(self.golden.clock_phase);
        for (index, step) in self.golden.steps.iter().enumerate() {
            walker.step(&step.sensors(), step.desired, &mut action);
            compare("observation", index, &step.observation, walker.observation())?;
            compare("targets", index, &step.targets, &action)?;
        }
        Ok(())
    }

    /// Largest difference of an action from the golden actions of `reference`: what lower precision costs. Not a number if the
    /// two do not fit each other.
    pub fn golden_error(&self, reference: &Self) -> f32 {
        let fits = self.spec == reference.spec;
        let Some(mut walker) = Walker::new(self).ok().filter(|_| fits) else {
            return f32::NAN;
        };
        let mut action = vec![0.0; self.spec.action_len()];
        let mut largest = 0.0f32;
        for vector in &reference.golden.actions {
            walker.act(&vector.observation, &mut action);
            let misses = action.iter().zip(&vector.action).map(|(a, b)| fabsf(a - b));
            largest = misses.fold(largest, f32::max);
        }
        largest
    }

    /// Golden vectors: observations spread over what the normaliser expects, and a loop whose readings move by sines.
    pub(crate) fn record(&self) -> Result<Golden, PolicyError> {
        const ACTIONS: usize = 16;
        const STEPS: usize = 60;
        let mut walker = Walker::new(self)?;
        let actions = (0..ACTIONS)
            .map(|index| self.record_action(&mut walker, index))
            .collect();
        let clock_phase = 0.25;
        walker.reset(clock_phase);
        let steps = (0..STEPS).map(|k| self.record_step(&mut walker, k)).collect();
        Ok(Golden {
            actions,
            clock_phase,
            steps,
        })
    }

    fn record_action(&self, walker: &mut Walker, index: usize) -> GoldenAction {
        let entry = |(i, (mean, deviation)): (usize, (&f32, &f32))| {
            mean + 2.0 * deviation * sinf(1.7 * index as f32 + 0.9 * i as f32)
        };
        let statistics = self.actor.mean.iter().zip(&self.actor.deviation);
        let observation: Vec<f32> = statistics.enumerate().map(entry).collect();
        let mut action = vec![0.0; self.spec.action_len()];
        walker.act(&observation, &mut action);
        GoldenAction { observation, action }
    }

    fn record_step(&self, walker: &mut Walker, k: usize) -> GoldenStep {
        let spec = &self.spec;
        let time = k as f32 / spec.control_hz;
        let wave = |size: f32, rate: f32, shift: usize| size * sinf(rate * time + 0.7 * shift as f32);
        // Within half of what counts as upright.
        let tilt = |size: f32, axis: usize| size.min(0.5 * spec.upright[axis]);
        let position = spec.joints.iter().enumerate();
        let mut step = GoldenStep {
            position: position.map(|(i, joint)| joint.nominal + wave(0.1, 6.0, i)).collect(),
            velocity: (0..spec.action_len()).map(|i| wave(0.6, 6.0, i + 2)).collect(),
            attitude: [wave(tilt(0.06, 0), 5.0, 1), wave(tilt(0.1, 1), 4.0, 2)],
            gyro: [wave(0.3, 5.0, 3), wave(0.4, 4.0, 4), wave(0.5, 3.0, 5)],
            // Both sources of the velocity.
            base_velocity: (k % 20 >= 15).then(|| [wave(0.4, 2.0, 6), wave(0.2, 3.0, 7), wave(0.1, 9.0, 8)]),
            desired: [wave(0.8, 2.0, 1), wave(0.4, 1.0, 2), wave(0.6, 3.0, 3)],
            observation: Vec::new(),
            targets: vec![0.0; spec.action_len()],
        };
        let mut targets = core::mem::take(&mut step.targets);
        walker.step(&step.sensors(), step.desired, &mut targets);
        step.observation = walker.observation().to_vec();
        step.targets = targets;
        step
    }
}

fn compare(what: &'static str, index: usize, expected: &[f32], found: &[f32]) -> Result<(), GoldenError> {
    for (entry, (&expected, &found)) in expected.iter().zip(found).enumerate() {
        // Written so that a number that is none does not pass.
        let near = fabsf(found - expected) <= GOLDEN_TOLERANCE * (1.0 + fabsf(expected));
        if !near {
            return Err(GoldenError::Differs {
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
