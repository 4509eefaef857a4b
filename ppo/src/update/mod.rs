//! The update: samples from a rollout, minibatches, gradients, steps.

mod chunk;
mod samples;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{
    adam::Step,
    config::{Config, Schedule},
    distribution::{LossCoefficients, LossSums},
    network::{Network, Tile},
    normaliser::Normaliser,
    rollout::{End, Mirror, Rollout},
};
use chunk::{ActorHead, Chunk, CriticHead, gradient, record};
use samples::Data;

/// What an update did. Means are over its minibatches, before each one's step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateStats {
    /// Mean clipped surrogate, negated.
    pub policy_loss: f64,
    /// Half the mean squared error of the value.
    pub value_loss: f64,
    /// Mean entropy of the action vector, nats.
    pub entropy: f64,
    /// Square root of the mean squared distance of mode and mean, over samples and dimensions, in ranges of an action.
    pub mode_distance: f64,
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

/// Sums over a minibatch.
#[derive(Clone, Copy, Default)]
pub(crate) struct MinibatchSums {
    pub policy: LossSums,
    pub squared_error: f64,
}

/// Buffers of the update.
pub(crate) struct Learner {
    data: Data,
    actor: Vec<Chunk<ActorHead>>,
    critic: Vec<Chunk<CriticHead>>,
}

impl Learner {
    pub(crate) fn new(actor: &Network, critic: &Network) -> Self {
        let width = actor.outputs() / 2;
        Self {
            data: Data::new(actor.widths[0], width),
            actor: chunk::chunks(actor, || ActorHead::new(width)),
            critic: chunk::chunks(critic, CriticHead::default),
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
        let minibatches = |samples: usize| ((samples + config.minibatch / 2) / config.minibatch).max(1);
        let mut stats = UpdateStats {
            learning_rate: *learned.learning_rate,
            ..UpdateStats::default()
        };
        let learnable = rollout.ends.iter().any(|&end| end != End::Lost);
        if !learnable || !rollout.is_finite() {
            let samples = rollout.samples() * if mirror.is_some() { 2 } else { 1 };
            stats.skipped = minibatches(samples) * config.epochs;
            return stats;
        }
        self.prepare(learned, rollout, mirror);
        let samples = self.data.order.len();
        let minibatches = minibatches(samples);
        stats.explained_variance = self.data.explained_variance(&rollout.values);
        let mut random = ChaCha8Rng::seed_from_u64(key);
        let (mut total, mut total_count) = (MinibatchSums::default(), 0);
        let (mut last_kl, mut last_count) = (0.0, 0);
        for epoch in 0..config.epochs {
            self.data.shuffle(&mut random);
            for minibatch in 0..minibatches {
                let indices = chunk::part(samples, minibatches, minibatch);
                let count = indices.len();
                let sums = self.gradient(config, learned.actor, learned.critic, indices);
                let norms = (norm(learned.actor), norm(learned.critic));
                let loss = sums.policy.policy_loss + sums.squared_error + sums.policy.kl + sums.policy.entropy;
                if !(loss.is_finite() && norms.0.is_finite() && norms.1.is_finite()) {
                    stats.skipped += 1;
                    continue;
                }
                if epoch + 1 == config.epochs {
                    last_kl += sums.policy.kl;
                    last_count += count;
                }
                step(learned, norms);
                stats.steps += 1;
                stats.policy_gradient_norm += norms.0;
                stats.value_gradient_norm += norms.1;
                total.add(sums);
                total_count += count;
            }
        }
        if last_count > 0 {
            let kl = last_kl / last_count as f64;
            *learned.learning_rate = adapt(config.schedule, *learned.steps, *learned.learning_rate, kl);
        }
        learned.normaliser.merge(&self.data.raw);
        let (steps, count) = (stats.steps.max(1) as f64, total_count.max(1) as f64);
        UpdateStats {
            policy_loss: total.policy.policy_loss / count,
            value_loss: 0.5 * total.squared_error / count,
            entropy: total.policy.entropy / count,
            mode_distance: (total.policy.skew / count / self.data.action_len as f64).sqrt(),
            kl: total.policy.kl / count,
            clip_fraction: total.policy.clipped / count,
            learning_rate: *learned.learning_rate,
            policy_gradient_norm: stats.policy_gradient_norm / steps,
            value_gradient_norm: stats.value_gradient_norm / steps,
            ..stats
        }
    }

    /// Turns a rollout into samples, and records the policy as it is.
    pub(crate) fn prepare(&mut self, learned: &Learned, rollout: &Rollout, mirror: Option<&Mirror>) {
        self.data.prepare(learned.config, learned.normaliser, rollout, mirror);
        record(learned.config.policy, learned.actor, &mut self.actor, &mut self.data);
    }

    /// Leaves the gradient of a minibatch's loss in the networks' tiles. The networks do not wait for each other.
    pub(crate) fn gradient(
        &mut self,
        config: &Config,
        actor: &mut Network,
        critic: &mut Network,
        indices: std::ops::Range<usize>,
    ) -> MinibatchSums {
        let coefficients = LossCoefficients {
            clip: config.clip,
            dual_clip: if config.dual_clip > 0.0 {
                config.dual_clip
            } else {
                f64::INFINITY
            },
            entropy_weight: config.entropy_weight,
            mode_weight: config.mode_weight,
            scale: 1.0 / indices.len() as f64,
        };
        let value_scale = config.value_weight / indices.len() as f64;
        let (mut policy, mut squared_error) = (LossSums::default(), 0.0);
        let (data, order) = (&self.data, &self.data.order[indices]);
        rayon::join(
            || {
                gradient(
                    actor,
                    &mut self.actor,
                    order,
                    |chunk, actor, part| chunk.run(config.policy, actor, data, part, coefficients),
                    |head| policy.add(head.sums),
                );
            },
            || {
                gradient(
                    critic,
                    &mut self.critic,
                    order,
                    |chunk, critic, part| chunk.run(critic, data, part, value_scale),
                    |head| squared_error += head.squared_error,
                );
            },
        );
        MinibatchSums { policy, squared_error }
    }
}

impl MinibatchSums {
    fn add(&mut self, other: Self) {
        self.policy.add(other.policy);
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

/// Most by which an update changes the learning rate.
const MAX_CHANGE: f64 = 1.5;

/// The learning rate after `steps` of the optimiser and an update that went to a divergence of `kl` with `rate`.
///
/// A divergence grows as the square of the steps that lead to it, so its root is what the rate is corrected by.
fn adapt(schedule: Schedule, steps: u64, rate: f64, kl: f64) -> f64 {
    let Schedule::Adaptive {
        kl_target,
        settle,
        minimum,
        maximum,
    } = schedule
    else {
        return rate;
    };
    let share = if settle > 0 { settle as f64 / steps as f64 } else { 1.0 };
    let target = kl_target * share.min(1.0).powi(2);
    let change = (target / kl.max(f64::MIN_POSITIVE)).sqrt();
    (rate * change.clamp(1.0 / MAX_CHANGE, MAX_CHANGE)).clamp(minimum, maximum)
}

#[cfg(test)]
impl Learner {
    /// Observation as the network sees it, action, advantage and return of every sample.
    pub(crate) fn samples(&self) -> Vec<(Vec<f64>, Vec<f64>, f64, f64)> {
        let wide = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();
        let sample = |index: usize| {
            let data = &self.data;
            let (advantage, value) = (data.advantage(index), data.target(index));
            (
                wide(data.observation(index)),
                wide(data.action(index)),
                f64::from(advantage),
                f64::from(value),
            )
        };
        (0..self.data.order.len()).map(sample).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_learning_rate_follows_a_target_that_falls_once_it_settles() {
        let adapt = |settle, steps, kl| {
            let schedule = Schedule::Adaptive {
                kl_target: 0.01,
                settle,
                minimum: 1e-4,
                maximum: 4e-4,
            };
            super::adapt(schedule, steps, 3e-4, kl)
        };
        let close = |rates: [f64; 4], expected: [f64; 4]| {
            for (rate, expected) in rates.into_iter().zip(expected) {
                assert!((rate / expected - 1.0).abs() < 1e-12, "{rate} for {expected}");
            }
        };
        for (settle, steps) in [(0, 1_000_000), (100, 1), (100, 100)] {
            close(
                [1.0, 0.0144, 0.01, 0.0].map(|kl| adapt(settle, steps, kl)),
                [2e-4, 2.5e-4, 3e-4, 4e-4],
            );
        }
        // Twice as many steps: a quarter of the target.
        close(
            [0.25, 0.0036, 0.0025, 0.0].map(|kl| adapt(100, 200, kl)),
            [2e-4, 2.5e-4, 3e-4, 4e-4],
        );
        assert_eq!(super::adapt(Schedule::Fixed {}, 5, 3e-4, 1.0), 3e-4);
    }
}
