//! A policy in its loop, as in training: readings in, joint targets out, whatever the readings are and whenever they come.

use alloc::{vec, vec::Vec};

use crate::{
    actor::Inference,
    pipeline::{Pipeline, Sensors},
    policy::{Bounds, Curriculum, Policy, PolicyError},
    spec::Spec,
};

/// An entry of the observation beyond what training saw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutOfRange {
    /// Index into the observation, see [`Spec::entry_name`]; of several entries, the one farthest out by its range.
    pub entry: usize,
    /// The value before it was clipped.
    pub value: f32,
    /// By how much it was beyond the nearer bound, positive.
    pub excess: f32,
    /// How many entries were out of range.
    pub entries: usize,
}

/// The loop alone. Nothing allocates after [`Walker::new`].
#[derive(Clone, Debug)]
pub(crate) struct Walker {
    spec: Spec,
    bounds: Bounds,
    trained: Curriculum,
    /// For symmetric policies: where each entry of the observation comes from when it is mirrored.
    mirror: Vec<(u32, f32)>,
    pipeline: Pipeline,
    inference: Inference,
    observation: Vec<f32>,
    bounded: Vec<f32>,
    action: Vec<f32>,
    out_of_range: Option<OutOfRange>,
}

impl Walker {
    pub(crate) fn new(policy: &Policy) -> Result<Self, PolicyError> {
        Self::with_inference(policy, Inference::new(&policy.actor)?)
    }

    pub(crate) fn with_inference(policy: &Policy, inference: Inference) -> Result<Self, PolicyError> {
        let width = policy.spec.observation_len();
        let symmetry = policy.spec.symmetry.as_deref();
        Ok(Self {
            pipeline: Pipeline::new(&policy.spec)?,
            inference,
            observation: vec![0.0; width],
            bounded: vec![0.0; width],
            action: vec![0.0; policy.spec.action_len()],
            mirror: symmetry.map_or_else(Vec::new, |joints| policy.spec.mirror_observation(joints)),
            spec: policy.spec.clone(),
            bounds: policy.bounds.clone(),
            trained: policy.identity.curriculum,
            out_of_range: None,
        })
    }

    pub(crate) fn reset(&mut self, clock_phase: f32) {
        self.pipeline.reset(&self.spec, clock_phase);
    }

    /// One step. A reading that is not finite holds the previous targets.
    pub(crate) fn step(&mut self, sensors: &Sensors, desired: [f32; 3], targets: &mut [f32]) {
        let Self { spec, pipeline, .. } = self;
        let (lower, upper) = (&self.trained.lower, &self.trained.upper);
        let desired = core::array::from_fn(|axis| desired[axis].clamp(lower[axis], upper[axis]));
        pipeline.observe(spec, sensors, desired, &mut self.observation);
        bound(&self.bounds, &self.observation, &mut self.bounded);
        self.out_of_range = self.judge();
        self.inference.action(&self.bounded, &mut self.action);
        self.pipeline.decode(&self.spec, &self.action, targets);
    }

    /// A step without readings: the previous targets, while clock and time go on.
    pub(crate) fn hold(&mut self, targets: &mut [f32]) {
        self.action.fill(f32::NAN);
        self.pipeline.decode(&self.spec, &self.action, targets);
    }

    pub(crate) fn act(&mut self, observation: &[f32], action: &mut [f32]) {
        bound(&self.bounds, observation, &mut self.bounded);
        self.inference.action(&self.bounded, action);
    }

    pub(crate) fn spec(&self) -> &Spec {
        &self.spec
    }

    pub(crate) fn trained(&self) -> &Curriculum {
        &self.trained
    }

    pub(crate) fn observation(&self) -> &[f32] {
        &self.observation
    }

    pub(crate) fn action(&self) -> &[f32] {
        &self.action
    }

    pub(crate) fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    pub(crate) fn instruction_set(&self) -> &'static str {
        self.inference.instruction_set()
    }

    /// What was out of range in the last [`Walker::step`].
    pub(crate) fn out_of_range(&self) -> Option<OutOfRange> {
        self.out_of_range
    }

    fn judge(&self) -> Option<OutOfRange> {
        let limits = self.bounds.lower.iter().zip(&self.bounds.upper);
        let (mut worst, mut most, mut entries) = (None, 0.0, 0);
        for (i, ((&raw, &bounded), (lower, upper))) in
            self.observation.iter().zip(&self.bounded).zip(limits).enumerate()
        {
            let excess = libm::fabsf(raw - bounded);
            if excess > 0.0 {
                entries += 1;
                // A range of a single value has no size to compare with.
                let share = excess / (upper - lower).max(f32::MIN_POSITIVE);
                if worst.is_none() || share > most {
                    (worst, most) = (Some((i, raw, excess)), share);
                }
            }
        }
        worst.map(|(i, raw, excess)| {
            let looks_in_mirror = self.pipeline.is_mirrored(&self.spec);
            let (entry, sign) = if looks_in_mirror {
                self.mirror[i]
            } else {
                (i as u32, 1.0)
            };
            OutOfRange {
                entry: entry as usize,
                value: sign * raw,
                excess,
                entries,
            }
        })
    }
}

/// The observation within what training saw.
fn bound(bounds: &Bounds, observation: &[f32], bounded: &mut [f32]) {
    let limits = bounds.lower.iter().zip(&bounds.upper);
    for ((out, x), (&lower, &upper)) in bounded.iter_mut().zip(observation).zip(limits) {
        *out = x.clamp(lower, upper);
    }
}
