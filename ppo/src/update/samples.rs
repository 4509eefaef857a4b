//! The samples of an update.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{
    config::Config,
    gae,
    normaliser::Normaliser,
    rollout::{End, Mirror, Rollout},
};

/// The samples of an update: those of the rollout, then their mirror images.
#[derive(Default)]
pub(super) struct Data {
    /// As the environments gave them.
    pub raw: Vec<f32>,
    observations: Vec<f32>,
    actions: Vec<f32>,
    /// Of the rollout's samples; a mirror image shares them.
    advantages: Vec<f32>,
    returns: Vec<f32>,
    pub log_probabilities: Vec<f64>,
    pub references: Vec<[f64; 3]>,
    /// Indices of the samples to learn from, all but the lost ones, in the order in which minibatches take them.
    pub order: Vec<u32>,
    observation_len: usize,
    pub action_len: usize,
}

impl Data {
    /// Nothing yet.
    pub(super) fn new(observation_len: usize, action_len: usize) -> Self {
        Self {
            observation_len,
            action_len,
            ..Self::default()
        }
    }

    /// Turns a rollout into samples: advantages, mirror images, normalised observations.
    pub(super) fn prepare(
        &mut self,
        config: &Config,
        normaliser: &Normaliser,
        rollout: &Rollout,
        mirror: Option<&Mirror>,
    ) {
        let count = rollout.samples();
        let samples = count * if mirror.is_some() { 2 } else { 1 };
        let (observation_len, action_len) = (self.observation_len, self.action_len);
        self.advantages.resize(count, 0.0);
        self.returns.resize(count, 0.0);
        let (gamma, lambda) = (config.gamma, config.lambda);
        gae::estimate(rollout, gamma, lambda, &mut self.advantages, &mut self.returns);
        let lost = |index: usize| rollout.ends[index % count] == End::Lost;
        self.order.clear();
        self.order
            .extend((0..samples as u32).filter(|&index| !lost(index as usize)));
        standardise(&mut self.advantages, |index| !lost(index));
        self.raw.resize(samples * observation_len, 0.0);
        self.observations.resize(samples * observation_len, 0.0);
        self.actions.resize(samples * action_len, 0.0);
        self.references.resize(samples * action_len, [0.0; 3]);
        self.log_probabilities.resize(samples, 0.0);
        let (observations, images) = self.raw.split_at_mut(rollout.observations.len());
        observations.copy_from_slice(&rollout.observations);
        let (actions, action_images) = self.actions.split_at_mut(rollout.actions.len());
        actions.copy_from_slice(&rollout.actions);
        if let Some(mirror) = mirror {
            let rows = observations.chunks_exact(observation_len);
            rows.zip(images.chunks_exact_mut(observation_len))
                .for_each(|(from, to)| mirror.observation(from, to));
            let rows = actions.chunks_exact(action_len);
            rows.zip(action_images.chunks_exact_mut(action_len))
                .for_each(|(from, to)| mirror.action(from, to));
        }
        let rows = self.raw.par_chunks_exact(observation_len);
        rows.zip(self.observations.par_chunks_exact_mut(observation_len))
            .with_min_len(256)
            .for_each(|(from, to)| normaliser.apply(0, from, to));
    }

    /// A sample's observation as the networks see it.
    pub(super) fn observation(&self, index: usize) -> &[f32] {
        &self.observations[index * self.observation_len..][..self.observation_len]
    }

    /// A sample's action.
    pub(super) fn action(&self, index: usize) -> &[f32] {
        &self.actions[index * self.action_len..][..self.action_len]
    }

    /// The old distributions of a sample's action.
    pub(super) fn reference(&self, index: usize) -> &[[f64; 3]] {
        &self.references[index * self.action_len..][..self.action_len]
    }

    /// A sample's standardised advantage.
    pub(super) fn advantage(&self, index: usize) -> f32 {
        self.advantages[index % self.advantages.len()]
    }

    /// What the critic should say of a sample.
    pub(super) fn target(&self, index: usize) -> f32 {
        self.returns[index % self.returns.len()]
    }

    /// A new order of all samples (Fisher and Yates).
    pub(super) fn shuffle(&mut self, random: &mut ChaCha8Rng) {
        for i in (1..self.order.len()).rev() {
            self.order.swap(i, random.random_range(0..=i));
        }
    }

    /// Share of the returns' variance that the rollout's values explain; 0 if the returns do not vary.
    pub(super) fn explained_variance(&self, values: &[f32]) -> f64 {
        let returns = &self.returns;
        let (_, total) = moments(returns.iter().map(|&x| f64::from(x)), returns.len());
        let errors = values.iter().zip(returns).map(|(&v, &r)| f64::from(r) - f64::from(v));
        let (_, rest) = moments(errors, returns.len());
        if total > 0.0 { 1.0 - rest / total } else { 0.0 }
    }
}

/// Shifts and scales to mean 0 and standard deviation 1 over the values whose index `counts`.
fn standardise(values: &mut [f32], counts: impl Fn(usize) -> bool) {
    let counted = || (0..values.len()).filter(|&index| counts(index));
    let (mean, variance) = moments(counted().map(|index| f64::from(values[index])), counted().count());
    let scale = 1.0 / (variance.sqrt() + 1e-8);
    values
        .iter_mut()
        .for_each(|x| *x = ((f64::from(*x) - mean) * scale) as f32);
}

fn moments(values: impl Iterator<Item = f64> + Clone, count: usize) -> (f64, f64) {
    let count = count.max(1);
    let mean = values.clone().sum::<f64>() / count as f64;
    (
        mean,
        values.map(|x| (x - mean) * (x - mean)).sum::<f64>() / count as f64,
    )
}
