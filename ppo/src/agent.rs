//! The agent: acts, judges, learns.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{
    config::{Config, InvalidConfig},
    distribution::Head,
    elementwise::Activation,
    network::{Network, Pass, Tile},
    normaliser::Normaliser,
    rollout::{Mirror, Rollout},
    simd::PANEL,
    update::{Learned, Learner, UpdateStats},
};

/// Most rows that pass through a network together when acting: few enough to stay in the cache.
const ROWS: usize = 32;

/// Actor and critic, their optimiser, the observation normaliser and the buffers of learning. Work is shared out in the current
/// rayon pool; its number of threads does not change any bit of the results.
pub struct Agent {
    pub(crate) config: Config,
    pub(crate) actor: Network,
    pub(crate) critic: Network,
    pub(crate) normaliser: Normaliser,
    pub(crate) learning_rate: f64,
    pub(crate) steps: u64,
    learner: Learner,
}

/// Buffers for the networks of one agent, or of others of the same shape. Each thread that acts by itself has its own; they
/// grow with the rows that are asked for.
#[derive(Default)]
pub struct Inference {
    actor: Vec<Pass>,
    critic: Vec<Pass>,
}

/// A layer of the policy network: `y = activation(weights x + bias)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Length of x.
    pub inputs: usize,
    /// Length of y.
    pub outputs: usize,
    /// Row-major, `outputs x inputs`.
    pub weights: Vec<f32>,
    /// `outputs`.
    pub bias: Vec<f32>,
}

/// All that is needed to compute the policy's action from an observation.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// Mean that is subtracted from an observation.
    pub mean: Vec<f32>,
    /// Standard deviation that the difference is divided by.
    pub deviation: Vec<f32>,
    /// The quotient is clamped to this magnitude.
    pub clip: f32,
    /// Smallest and largest value of each entry of an observation that was learned from. Infinite where that is not
    /// known, the smallest above the largest where there was none.
    pub range: [Vec<f32>; 2],
    /// The actor's layers; the last has no activation, and its outputs are the first parameter of each action
    /// dimension, then the second of each.
    pub layers: Vec<Layer>,
    /// Activation of all layers but the last.
    pub activation: Activation,
    /// What the outputs mean.
    pub head: Head,
}

impl Agent {
    /// A new agent with random weights; the policy starts close to the same broad distribution everywhere.
    ///
    /// # Errors
    /// If the configuration is not valid or a length is zero.
    pub fn new(config: Config, observation_len: usize, action_len: usize, seed: u64) -> Result<Self, InvalidConfig> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (hidden, activation) = (&config.hidden, config.activation);
        config.validate()?;
        check_lengths(observation_len, action_len)?;
        let actor = Network::orthogonal(observation_len, hidden, 2 * action_len, activation, 0.01, &mut random);
        let critic = Network::orthogonal(observation_len, hidden, 1, activation, 1.0, &mut random);
        Ok(Self::with_networks(config, actor, critic))
    }

    /// An agent with zero weights, to be filled from a saved state.
    pub(crate) fn zeroed(config: Config, observation_len: usize, action_len: usize) -> Result<Self, InvalidConfig> {
        config.validate()?;
        check_lengths(observation_len, action_len)?;
        let actor = Network::zeroed(observation_len, &config.hidden, 2 * action_len, config.activation);
        let critic = Network::zeroed(observation_len, &config.hidden, 1, config.activation);
        Ok(Self::with_networks(config, actor, critic))
    }

    fn with_networks(config: Config, actor: Network, critic: Network) -> Self {
        Self {
            normaliser: Normaliser::new(actor.widths[0], config.normalise_observations, config.observation_clip),
            learning_rate: config.learning_rate,
            steps: 0,
            learner: Learner::new(&actor, &critic),
            config,
            actor,
            critic,
        }
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Length of an observation.
    pub fn observation_len(&self) -> usize {
        self.actor.widths[0]
    }

    /// Length of an action.
    pub fn action_len(&self) -> usize {
        self.actor.outputs() / 2
    }

    /// The learning rate of the next step.
    pub fn learning_rate(&self) -> f64 {
        self.learning_rate
    }

    /// Whether every parameter of both networks is finite.
    pub fn is_finite(&self) -> bool {
        let mut tiles = self.actor.tiles.iter().chain(&self.critic.tiles);
        tiles.all(|tile| tile.parameters.iter().all(|x| x.is_finite()))
    }

    /// Samples an action for each observation and judges it, on the thread that calls alone: many may act at once. Row `i`
    /// depends on its observation and `keys[i]` alone.
    ///
    /// `observations` is `rows x observation length`, not normalised; `actions` `rows x action length`: in (0, 1) for a
    /// Beta policy, unbounded with [0, 1] as the nominal range for a Gaussian one, not a number where the observation
    /// is not; `values` `rows`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn act(
        &self,
        buffers: &mut Inference,
        observations: &[f32],
        keys: &[u64],
        actions: &mut [f32],
        values: &mut [f32],
    ) {
        assert_eq!(
            keys.len() * self.observation_len(),
            observations.len(),
            "one key for each observation"
        );
        self.assert_rows(observations, actions, self.action_len());
        let (head, width) = (self.config.policy, self.action_len());
        let Self { actor, normaliser, .. } = self;
        let chunks = observations
            .chunks(self.observation_len() * ROWS)
            .zip(actions.chunks_mut(width * ROWS));
        let pass = first(&mut buffers.actor, actor);
        for ((observations, actions), keys) in chunks.zip(keys.chunks(ROWS)) {
            infer(
                actor,
                normaliser,
                pass,
                observations,
                actions,
                width,
                |row, output, action| {
                    let mut random = ChaCha8Rng::seed_from_u64(keys[row]);
                    for (i, action) in action.iter_mut().enumerate() {
                        *action = head.sample(output(i), output(width + i), &mut random);
                    }
                },
            );
        }
        self.values(buffers, observations, values);
    }

    /// The most likely action for each observation.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn mode(&self, buffers: &mut Inference, observations: &[f32], actions: &mut [f32]) {
        let (head, len, width) = (self.config.policy, self.observation_len(), self.action_len());
        self.assert_rows(observations, actions, width);
        let (actor, normaliser, passes) = (&self.actor, &self.normaliser, &mut buffers.actor);
        while passes.len() * ROWS * len < observations.len() {
            passes.push(Pass::new(actor, ROWS, false));
        }
        let chunks = observations
            .par_chunks(len * ROWS)
            .zip(actions.par_chunks_mut(width * ROWS));
        passes
            .par_iter_mut()
            .zip(chunks)
            .with_max_len(1)
            .for_each(|(pass, (observations, actions))| {
                infer(
                    actor,
                    normaliser,
                    pass,
                    observations,
                    actions,
                    width,
                    |_, output, action| {
                        for (i, action) in action.iter_mut().enumerate() {
                            *action = head.mode(output(i), output(width + i));
                        }
                    },
                );
            });
    }

    /// The value of each observation: the expected discounted return from it. On the thread that calls alone.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn values(&self, buffers: &mut Inference, observations: &[f32], values: &mut [f32]) {
        self.assert_rows(observations, values, 1);
        let Self { critic, normaliser, .. } = self;
        let pass = first(&mut buffers.critic, critic);
        let chunks = observations.chunks(self.observation_len() * ROWS);
        for (observations, values) in chunks.zip(values.chunks_mut(ROWS)) {
            infer(critic, normaliser, pass, observations, values, 1, |_, output, value| {
                value[0] = output(0);
            });
        }
    }

    fn assert_rows(&self, observations: &[f32], results: &[f32], width: usize) {
        let len = self.observation_len();
        let rows = observations.len() / len;
        assert!(
            rows * len == observations.len() && rows * width == results.len(),
            "rows of observations and results"
        );
    }

    /// Learns from a rollout that this agent collected since the last update, and its mirror image if there is one.
    ///
    /// Observations are normalised as they were when the agent acted; then their statistics join the normaliser. `key`
    /// orders the minibatches. A minibatch with a loss or gradient that is not finite is left out, a rollout with
    /// anything that is not finite is left out altogether.
    ///
    /// # Panics
    /// If the rollout's or the mirror's lengths do not fit.
    pub fn update(&mut self, rollout: &Rollout, mirror: Option<&Mirror>, key: u64) -> UpdateStats {
        let (observation_len, action_len) = (self.observation_len(), self.action_len());
        assert!(
            rollout.fits(observation_len, action_len),
            "the rollout's lengths fit the agent"
        );
        assert!(
            mirror.is_none_or(|mirror| mirror.fits(observation_len, action_len)),
            "the mirror fits the agent"
        );
        let (learner, mut learned) = self.split();
        learner.update(&mut learned, rollout, mirror, key)
    }

    /// The buffers and what they change.
    pub(crate) fn split(&mut self) -> (&mut Learner, Learned<'_>) {
        let Self {
            config,
            actor,
            critic,
            normaliser,
            learning_rate,
            steps,
            learner,
            ..
        } = self;
        (
            learner,
            Learned {
                config,
                actor,
                critic,
                normaliser,
                learning_rate,
                steps,
            },
        )
    }

    /// The policy as plain numbers.
    pub fn policy(&self) -> Policy {
        let (mean, deviation) = self.normaliser.applied();
        let layer = |tiles: &[Tile]| {
            let (weights, bias): (Vec<_>, Vec<_>) = tiles.iter().map(|tile| tile.plain(&tile.parameters)).unzip();
            Layer {
                inputs: tiles[0].inputs,
                outputs: tiles.iter().map(|tile| tile.outputs).sum(),
                weights: weights.concat(),
                bias: bias.concat(),
            }
        };
        Policy {
            mean: mean.to_vec(),
            deviation: deviation.to_vec(),
            clip: self.normaliser.clip,
            range: self.normaliser.range.clone(),
            layers: self
                .actor
                .layers
                .iter()
                .map(|range| layer(&self.actor.tiles[range.clone()]))
                .collect(),
            activation: self.config.activation,
            head: self.config.policy,
        }
    }
}

fn check_lengths(observation_len: usize, action_len: usize) -> Result<(), InvalidConfig> {
    let check = |key, len: usize| {
        if (1..=1 << 14).contains(&len) {
            Ok(())
        } else {
            Err(InvalidConfig {
                key,
                message: "1 to 16384".to_owned(),
            })
        }
    };
    check("observation length", observation_len)?;
    check("action length", action_len)
}

/// The first of the buffers, made where there is none.
fn first<'a>(passes: &'a mut Vec<Pass>, network: &Network) -> &'a mut Pass {
    if passes.is_empty() {
        passes.push(Pass::new(network, ROWS, false));
    }
    &mut passes[0]
}

/// Passes at most [`ROWS`] observations through a network and hands each row's index and outputs to `finish`, with
/// its part of `results`.
fn infer(
    network: &Network,
    normaliser: &Normaliser,
    pass: &mut Pass,
    observations: &[f32],
    results: &mut [f32],
    width: usize,
    finish: impl Fn(usize, &dyn Fn(usize) -> f32, &mut [f32]),
) {
    let len = network.widths[0];
    pass.rows = observations.len() / len;
    for (row, from) in observations.chunks_exact(len).enumerate() {
        for (panel, from) in from.chunks(PANEL).enumerate() {
            normaliser.apply(panel * PANEL, from, pass.inputs_mut().piece_mut(row, panel));
        }
    }
    network.forward(pass);
    let outputs = pass.outputs();
    for (row, to) in results.chunks_exact_mut(width).enumerate() {
        finish(row, &|column| outputs.get(row, column), to);
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::finite_differences::config;

    #[test]
    fn a_weight_that_is_no_number_is_seen_wherever_it_is() {
        let mut agent = Agent::new(config(Head::Beta, Activation::Tanh), 4, 2, 1).unwrap();
        assert!(agent.is_finite());
        let mut chance = ChaCha8Rng::seed_from_u64(3);
        for round in 0..300 {
            let tiles = if round % 2 == 0 {
                &mut agent.actor.tiles
            } else {
                &mut agent.critic.tiles
            };
            let tile = chance.random_range(0..tiles.len());
            let place = chance.random_range(0..tiles[tile].parameters.len());
            let weight = &mut tiles[tile].parameters[place];
            let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][round % 3];
            let good = std::mem::replace(weight, bad);
            assert!(!agent.is_finite());
            let tiles = if round % 2 == 0 {
                &mut agent.actor.tiles
            } else {
                &mut agent.critic.tiles
            };
            tiles[tile].parameters[place] = good;
        }
        assert!(agent.is_finite());
    }
}
