//! The update: samples from a rollout, minibatches, gradients, steps.
//!
//! A minibatch goes through in blocks of a few chunks. In each block the chunks pass through both networks and back, in
//! parallel; then the tiles of both networks add up their gradients over the chunks, in parallel. Buffers are of a
//! block's size whatever the minibatch's, and stay in the caches.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{
    adam::Step,
    config::{Config, Schedule},
    distribution::{self, HeadScratch, LossCoefficients, LossSums, Samples},
    gae,
    network::{Network, Pass, Tile},
    normaliser::Normaliser,
    rollout::{Mirror, Rollout},
};

/// Most samples of a chunk.
const CHUNK: usize = 120;
/// Chunks of a block.
const CHUNKS: usize = 4;

/// What an update did. Means are over its minibatches, before each one's step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateStats {
    /// Mean clipped surrogate, negated.
    pub policy_loss: f64,
    /// Half the mean squared error of the value.
    pub value_loss: f64,
    /// Mean entropy of the action vector, nats.
    pub entropy: f64,
    /// Mean divergence from the policy that collected the samples, nats.
    pub kl: f64,
    /// Share of samples whose probability ratio was outside the clip range.
    pub clip_fraction: f64,
    /// Learning rate after the update.
    pub learning_rate: f64,
    /// Mean norm of the actor's gradient before it was shortened.
    pub policy_gradient_norm: f64,
    /// Mean norm of the critic's gradient before it was shortened.
    pub value_gradient_norm: f64,
    /// Share of the returns' variance that the rollout's values explain; 0 if the returns do not vary.
    pub explained_variance: f64,
    /// Minibatches that took a step.
    pub steps: usize,
    /// Minibatches left out because a loss or a gradient was not finite; all of them if the rollout was not.
    pub skipped: usize,
}

/// The learning state that [`Learner::update`] changes.
pub(crate) struct Learned<'a> {
    pub config: &'a Config,
    pub actor: &'a mut Network,
    pub critic: &'a mut Network,
    pub normaliser: &'a mut Normaliser,
    pub learning_rate: &'a mut f64,
    /// Steps of Adam taken.
    pub steps: &'a mut u64,
}

/// The samples of an update: those of the rollout, then their mirror images.
#[derive(Default)]
struct Data {
    /// As the environments gave them.
    raw: Vec<f32>,
    observations: Vec<f32>,
    actions: Vec<f32>,
    /// Of the rollout's samples; a mirror image shares them.
    advantages: Vec<f32>,
    returns: Vec<f32>,
    log_probabilities: Vec<f64>,
    references: Vec<[f64; 3]>,
    /// Sample indices in the order in which minibatches take them.
    order: Vec<u32>,
}

/// Part of a block on its way through the actor.
struct ActorChunk {
    pass: Pass,
    scratch: HeadScratch,
    actions: Vec<f32>,
    advantages: Vec<f32>,
    log_probabilities: Vec<f64>,
    references: Vec<[f64; 3]>,
    sums: LossSums,
}

/// Part of a block on its way through the critic.
struct CriticChunk {
    pass: Pass,
    squared_error: f64,
}

/// Sums over a minibatch.
#[derive(Clone, Copy, Default)]
pub(crate) struct MinibatchSums {
    pub policy: LossSums,
    pub squared_error: f64,
}

/// Buffers of the update.
pub(crate) struct Learner {
    data: Data,
    actor: Vec<ActorChunk>,
    critic: Vec<CriticChunk>,
    action_len: usize,
    observation_len: usize,
}

impl Learner {
    pub(crate) fn new(actor: &Network, critic: &Network) -> Self {
        let action_len = actor.outputs() / 2;
        let actor_chunk = || ActorChunk {
            pass: Pass::new(actor, CHUNK, true),
            scratch: HeadScratch::new(CHUNK, action_len),
            actions: vec![0.0; CHUNK * action_len],
            advantages: vec![0.0; CHUNK],
            log_probabilities: vec![0.0; CHUNK],
            references: vec![[0.0; 3]; CHUNK * action_len],
            sums: LossSums::default(),
        };
        let critic_chunk = || CriticChunk {
            pass: Pass::new(critic, CHUNK, true),
            squared_error: 0.0,
        };
        Self {
            data: Data::default(),
            actor: std::iter::repeat_with(actor_chunk).take(CHUNKS).collect(),
            critic: std::iter::repeat_with(critic_chunk).take(CHUNKS).collect(),
            action_len,
            observation_len: actor.widths[0],
        }
    }

    /// A whole update.
    pub(crate) fn update(
        &mut self,
        learned: &mut Learned,
        rollout: &Rollout,
        mirror: Option<&Mirror>,
        key: u64,
    ) -> UpdateStats {
        let config = learned.config;
        let samples = rollout.samples() * if mirror.is_some() { 2 } else { 1 };
        let minibatches = ((samples + config.minibatch / 2) / config.minibatch).max(1);
        let mut stats = UpdateStats {
            learning_rate: *learned.learning_rate,
            ..UpdateStats::default()
        };
        if samples == 0 || !rollout.is_finite() {
            stats.skipped = minibatches * config.epochs;
            return stats;
        }
        self.prepare(learned, rollout, mirror);
        stats.explained_variance = explained_variance(&rollout.values, &self.data.returns);
        let mut random = ChaCha8Rng::seed_from_u64(key);
        let mut total = MinibatchSums::default();
        let mut total_count = 0;
        for epoch in 0..config.epochs {
            shuffle(&mut self.data.order, &mut random);
            for minibatch in 0..minibatches {
                let indices = part(samples, minibatches, minibatch);
                let count = indices.len();
                let sums = self.gradient(config, learned.actor, learned.critic, indices);
                let norms = (norm(learned.actor), norm(learned.critic));
                let loss = sums.policy.policy_loss + sums.squared_error + sums.policy.kl + sums.policy.entropy;
                if !(loss.is_finite() && norms.0.is_finite() && norms.1.is_finite()) {
                    stats.skipped += 1;
                    continue;
                }
                // Before the first step the divergence is zero and says nothing.
                if epoch + minibatch > 0 {
                    *learned.learning_rate =
                        adapt(config.schedule, *learned.learning_rate, sums.policy.kl / count as f64);
                }
                step(learned, norms);
                stats.steps += 1;
                stats.policy_gradient_norm += norms.0;
                stats.value_gradient_norm += norms.1;
                total.add(sums);
                total_count += count;
            }
        }
        learned.normaliser.merge(&self.data.raw);
        let (steps, count) = (stats.steps.max(1) as f64, total_count.max(1) as f64);
        UpdateStats {
            policy_loss: total.policy.policy_loss / count,
            value_loss: 0.5 * total.squared_error / count,
            entropy: total.policy.entropy / count,
            kl: total.policy.kl / count,
            clip_fraction: total.policy.clipped / count,
            learning_rate: *learned.learning_rate,
            policy_gradient_norm: stats.policy_gradient_norm / steps,
            value_gradient_norm: stats.value_gradient_norm / steps,
            ..stats
        }
    }

    /// Turns a rollout into samples: advantages, mirror images, normalised observations, old distributions.
    pub(crate) fn prepare(&mut self, learned: &Learned, rollout: &Rollout, mirror: Option<&Mirror>) {
        let count = rollout.samples();
        let samples = count * if mirror.is_some() { 2 } else { 1 };
        let data = &mut self.data;
        data.advantages.resize(count, 0.0);
        data.returns.resize(count, 0.0);
        gae::estimate(
            rollout,
            learned.config.gamma,
            learned.config.lambda,
            &mut data.advantages,
            &mut data.returns,
        );
        standardise(&mut data.advantages);
        data.raw.resize(samples * self.observation_len, 0.0);
        data.observations.resize(samples * self.observation_len, 0.0);
        data.actions.resize(samples * self.action_len, 0.0);
        data.raw[..rollout.observations.len()].copy_from_slice(&rollout.observations);
        data.actions[..rollout.actions.len()].copy_from_slice(&rollout.actions);
        if let Some(mirror) = mirror {
            let (from, to) = data.raw.split_at_mut(rollout.observations.len());
            let rows = from
                .chunks_exact(self.observation_len)
                .zip(to.chunks_exact_mut(self.observation_len));
            rows.for_each(|(from, to)| mirror.observation(from, to));
            let (from, to) = data.actions.split_at_mut(rollout.actions.len());
            let rows = from
                .chunks_exact(self.action_len)
                .zip(to.chunks_exact_mut(self.action_len));
            rows.for_each(|(from, to)| mirror.action(from, to));
        }
        let rows = data
            .raw
            .par_chunks_exact(self.observation_len)
            .zip(data.observations.par_chunks_exact_mut(self.observation_len));
        rows.with_min_len(256)
            .for_each(|(from, to)| learned.normaliser.apply(0, from, to));
        data.order.clear();
        data.order.extend(0..samples as u32);
        self.remember(learned, samples);
    }

    /// Records the distributions of the samples' actions under the policy as it is. Those of mirror images are not
    /// those of their originals: the policy is not symmetric.
    fn remember(&mut self, learned: &Learned, samples: usize) {
        let (width, head, actor) = (self.action_len, learned.config.policy, &*learned.actor);
        let data = &mut self.data;
        data.references.resize(samples * width, [0.0; 3]);
        data.log_probabilities.resize(samples, 0.0);
        let references = data.references.chunks_mut(CHUNKS * CHUNK * width);
        let log_probabilities = data.log_probabilities.chunks_mut(CHUNKS * CHUNK);
        for (block, (references, log_probabilities)) in references.zip(log_probabilities).enumerate() {
            let chunks = references
                .par_chunks_mut(CHUNK * width)
                .zip(log_probabilities.par_chunks_mut(CHUNK));
            let work = self.actor.par_iter_mut().zip(chunks).enumerate().with_max_len(1);
            work.for_each(|(index, (chunk, (references, log_probabilities)))| {
                let first = (block * CHUNKS + index) * CHUNK;
                let rows = log_probabilities.len();
                chunk.pass.rows = rows;
                for row in 0..rows {
                    let from = &data.observations[(first + row) * self.observation_len..][..self.observation_len];
                    chunk.pass.inputs_mut().set_row(row, from);
                }
                actor.forward(&mut chunk.pass);
                distribution::reference(
                    head,
                    chunk.pass.outputs(),
                    &data.actions[first * width..][..rows * width],
                    references,
                    log_probabilities,
                    &mut chunk.scratch,
                );
            });
        }
    }

    /// Leaves the gradient of a minibatch's loss in the networks' tiles.
    pub(crate) fn gradient(
        &mut self,
        config: &Config,
        actor: &mut Network,
        critic: &mut Network,
        indices: std::ops::Range<usize>,
    ) -> MinibatchSums {
        let coefficients = LossCoefficients {
            clip: config.clip,
            entropy_weight: config.entropy_weight,
            scale: 1.0 / indices.len() as f64,
        };
        let value_scale = config.value_weight / indices.len() as f64;
        let blocks = indices.len().div_ceil(CHUNKS * CHUNK);
        let mut sums = MinibatchSums::default();
        for block in 0..blocks {
            let range = part(indices.len(), blocks, block);
            let order = &self.data.order[indices.start + range.start..indices.start + range.end];
            let chunk_of = |index| &order[part(order.len(), CHUNKS, index)];
            let data = &self.data;
            let (actor_now, critic_now) = (&*actor, &*critic);
            rayon::join(
                || {
                    self.actor
                        .par_iter_mut()
                        .enumerate()
                        .with_max_len(1)
                        .for_each(|(index, chunk)| {
                            chunk.run(config, actor_now, data, chunk_of(index), coefficients);
                        });
                },
                || {
                    self.critic
                        .par_iter_mut()
                        .enumerate()
                        .with_max_len(1)
                        .for_each(|(index, chunk)| {
                            chunk.run(critic_now, data, chunk_of(index), value_scale);
                        });
                },
            );
            let (first, last) = (block == 0, block + 1 == blocks);
            let (actor_chunks, critic_chunks) = (&self.actor, &self.critic);
            let finish = |tile: &mut Tile| {
                if last {
                    tile.squared = tile.squared_gradient();
                }
            };
            rayon::join(
                || {
                    actor.tiles.par_iter_mut().with_max_len(1).for_each(|tile| {
                        tile.accumulate(actor_chunks.iter().map(|chunk| &chunk.pass), first);
                        finish(tile);
                    });
                },
                || {
                    critic.tiles.par_iter_mut().with_max_len(1).for_each(|tile| {
                        tile.accumulate(critic_chunks.iter().map(|chunk| &chunk.pass), first);
                        finish(tile);
                    });
                },
            );
            for (actor, critic) in self.actor.iter().zip(&self.critic) {
                sums.add(MinibatchSums {
                    policy: actor.sums,
                    squared_error: critic.squared_error,
                });
            }
        }
        sums
    }
}

#[cfg(test)]
impl Learner {
    /// Observation as the network sees it, action, advantage and return of every sample.
    pub(crate) fn samples(&self) -> Vec<(Vec<f64>, Vec<f64>, f64, f64)> {
        let data = &self.data;
        let wide = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();
        let rows = data
            .observations
            .chunks(self.observation_len)
            .zip(data.actions.chunks(self.action_len));
        let worth = data.advantages.iter().zip(&data.returns).cycle();
        rows.zip(worth)
            .map(|((o, a), (&advantage, &to))| (wide(o), wide(a), f64::from(advantage), f64::from(to)))
            .collect()
    }
}

impl ActorChunk {
    fn run(&mut self, config: &Config, actor: &Network, data: &Data, indices: &[u32], coefficients: LossCoefficients) {
        let (rows, width) = (indices.len(), self.actions.len() / CHUNK);
        self.pass.rows = rows;
        for (row, &index) in indices.iter().enumerate() {
            let index = index as usize;
            self.pass
                .inputs_mut()
                .set_row(row, data.observation(index, actor.widths[0]));
            let (to, from) = (row * width..(row + 1) * width, index * width..(index + 1) * width);
            self.actions[to.clone()].copy_from_slice(&data.actions[from.clone()]);
            self.references[to].copy_from_slice(&data.references[from]);
            self.advantages[row] = data.advantages[index % data.advantages.len()];
            self.log_probabilities[row] = data.log_probabilities[index];
        }
        actor.forward(&mut self.pass);
        let samples = Samples {
            actions: &self.actions[..rows * width],
            advantages: &self.advantages[..rows],
            log_probabilities: &self.log_probabilities[..rows],
            references: &self.references[..rows * width],
        };
        let (outputs, gradient) = self.pass.outputs_and_gradient();
        self.sums = distribution::loss(
            config.policy,
            outputs,
            gradient,
            samples,
            coefficients,
            &mut self.scratch,
        );
        actor.backward(&mut self.pass);
    }
}

impl CriticChunk {
    fn run(&mut self, critic: &Network, data: &Data, indices: &[u32], scale: f64) {
        self.pass.rows = indices.len();
        for (row, &index) in indices.iter().enumerate() {
            self.pass
                .inputs_mut()
                .set_row(row, data.observation(index as usize, critic.widths[0]));
        }
        critic.forward(&mut self.pass);
        self.squared_error = 0.0;
        let (outputs, gradient) = self.pass.outputs_and_gradient();
        for (row, &index) in indices.iter().enumerate() {
            let target = data.returns[index as usize % data.returns.len()];
            let error = f64::from(outputs.get(row, 0)) - f64::from(target);
            self.squared_error += error * error;
            gradient.set(row, 0, (scale * error) as f32);
        }
        critic.backward(&mut self.pass);
    }
}

impl Data {
    fn observation(&self, index: usize, width: usize) -> &[f32] {
        &self.observations[index * width..][..width]
    }
}

impl MinibatchSums {
    fn add(&mut self, other: Self) {
        self.policy.policy_loss += other.policy.policy_loss;
        self.policy.entropy += other.policy.entropy;
        self.policy.kl += other.policy.kl;
        self.policy.clipped += other.policy.clipped;
        self.squared_error += other.squared_error;
    }
}

/// One optimiser step on both networks.
fn step(learned: &mut Learned, norms: (f64, f64)) {
    *learned.steps += 1;
    // As in PyTorch, the small number guards a zero norm.
    let scale = |norm: f64| (learned.config.max_gradient_norm / (norm + 1e-6)).min(1.0);
    let step = |norm| Step::new(*learned.steps, *learned.learning_rate, scale(norm));
    let (actor, critic) = (step(norms.0), step(norms.1));
    let apply = |tiles: &mut [Tile], step: Step| {
        tiles.par_iter_mut().with_max_len(1).for_each(|tile| step.apply(tile));
    };
    rayon::join(
        || apply(&mut learned.actor.tiles, actor),
        || apply(&mut learned.critic.tiles, critic),
    );
}

/// Norm of a network's gradient.
fn norm(network: &Network) -> f64 {
    network.tiles.iter().map(|tile| tile.squared).sum::<f64>().sqrt()
}

/// The next learning rate.
fn adapt(schedule: Schedule, rate: f64, kl: f64) -> f64 {
    match schedule {
        Schedule::Fixed {} => rate,
        Schedule::Adaptive { kl_target, minimum, .. } if kl > 2.0 * kl_target => (rate / 1.5).max(minimum),
        Schedule::Adaptive { kl_target, maximum, .. } if kl < 0.5 * kl_target => (rate * 1.5).min(maximum),
        Schedule::Adaptive { .. } => rate,
    }
}

/// The `index`-th of `parts` nearly equal parts of `0..len`.
fn part(len: usize, parts: usize, index: usize) -> std::ops::Range<usize> {
    len * index / parts..len * (index + 1) / parts
}

/// Fisher and Yates.
fn shuffle(order: &mut [u32], random: &mut ChaCha8Rng) {
    for i in (1..order.len()).rev() {
        order.swap(i, random.random_range(0..=i));
    }
}

/// Shifts and scales to mean 0 and standard deviation 1.
fn standardise(values: &mut [f32]) {
    let (mean, variance) = moments(values.iter().map(|&x| f64::from(x)), values.len());
    let scale = 1.0 / (variance.sqrt() + 1e-8);
    values
        .iter_mut()
        .for_each(|x| *x = ((f64::from(*x) - mean) * scale) as f32);
}

fn moments(values: impl Iterator<Item = f64> + Clone, count: usize) -> (f64, f64) {
    let mean = values.clone().sum::<f64>() / count as f64;
    (
        mean,
        values.map(|x| (x - mean) * (x - mean)).sum::<f64>() / count as f64,
    )
}

fn explained_variance(values: &[f32], returns: &[f32]) -> f64 {
    let (_, total) = moments(returns.iter().map(|&x| f64::from(x)), returns.len());
    let errors = values.iter().zip(returns).map(|(&v, &r)| f64::from(r) - f64::from(v));
    let (_, rest) = moments(errors, returns.len());
    if total > 0.0 { 1.0 - rest / total } else { 0.0 }
}
