//! Episodes at fixed commands, all at once, by the policy's mode.

use std::sync::Arc;

use omniwalk_env::robot::Robot;
use omniwalk_env::task::command::CommandRange;
use omniwalk_env::task::episode::{End, Episode};
use omniwalk_env::{Batch, EnvConfig};

/// What is asked of a policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Forward {
    /// Desired velocities (m/s, m/s, rad/s).
    pub commands: Vec<[f64; 3]>,
    /// Episodes for each.
    pub episodes: usize,
    /// Length of an episode, s.
    pub seconds: f64,
    /// Seed of the episodes' randomness.
    pub seed: u64,
    /// Without noise, latency and any randomisation.
    pub nominal: bool,
}

/// The episodes of one command.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Desired velocity (m/s, m/s, rad/s).
    pub command: [f64; 3],
    /// One record an episode.
    pub episodes: Vec<Episode>,
}

/// The configuration a suite runs in: episodes at full length, commands that stay, nothing that widens with training.
pub fn conditions(config: &EnvConfig, suite: &Forward) -> EnvConfig {
    let mut config = config.clone();
    config.task.episode_seconds = suite.seconds;
    config.task.random_first_length = false;
    config.task.overlap_margin = 0.0;
    config.command.resample_seconds = 0.0;
    config.push.enabled = false;
    if suite.nominal {
        nominal(&mut config);
        config.randomise.start_position = 0.0;
    }
    config
}

/// Switches noise, latency and the randomisation of the physics off. Joints start where they did.
pub fn nominal(config: &mut EnvConfig) {
    config.noise.enabled = false;
    config.latency.enabled = false;
    config.friction.enabled = false;
    config.randomise.pd_noise = 0.0;
    config.randomise.effects = false;
    config.randomise.mass = 0.0;
    config.randomise.centre_of_mass = 0.0;
}

/// Sees a suite as it is played.
pub trait Watch {
    /// The batch before the first step.
    ///
    /// # Errors
    /// What stops the evaluation.
    fn start(&mut self, batch: &Batch) -> miette::Result<()>;

    /// The batch after a step with `actions` on `observations`.
    ///
    /// # Errors
    /// What stops the evaluation.
    fn step(&mut self, batch: &Batch, observations: &[f32], actions: &[f32]) -> miette::Result<()>;
}

/// Plays `suite` with `policy` (observations to actions, row-major).
///
/// # Errors
/// When robot and configuration do not fit together, and whatever `watch` says.
pub fn play(
    robot: Arc<Robot>,
    config: &EnvConfig,
    suite: &Forward,
    mut policy: impl FnMut(&[f32], &mut [f32]),
    watch: &mut dyn Watch,
) -> miette::Result<Vec<Row>> {
    let config = conditions(config, suite);
    let n = suite.commands.len() * suite.episodes;
    let mut batch = Batch::new(robot, &config, n, suite.seed)?;
    for e in 0..n {
        batch.set_range_of(e, CommandRange::fixed(suite.commands[e / suite.episodes]));
    }
    batch.reset();
    let mut actions = vec![0.0; n * batch.shared().spec.action_len()];
    let mut observations = batch.observations().to_vec();
    watch.start(&batch)?;
    let mut finished: Vec<Option<Episode>> = vec![None; n];
    for _ in 0..config.episode_steps() {
        observations.copy_from_slice(batch.observations());
        policy(&observations, &mut actions);
        batch.step(&actions);
        watch.step(&batch, &observations, &actions)?;
        for episode in batch.take_episodes() {
            // Environments start again after a fall; only their first episode counts.
            let e = episode.environment;
            finished[e].get_or_insert(episode);
        }
    }
    let mut episodes = finished
        .into_iter()
        .map(|e| e.expect("every episode has ended by its full length"));
    Ok(suite
        .commands
        .iter()
        .map(|&command| Row {
            command,
            episodes: episodes.by_ref().take(suite.episodes).collect(),
        })
        .collect())
}

impl Row {
    /// Episodes that did not reach their full length.
    pub fn falls(&self) -> usize {
        self.episodes
            .iter()
            .filter(|episode| episode.end != End::TimeOut)
            .count()
    }

    /// Episodes that ended because the legs overlapped.
    pub fn overlaps(&self) -> usize {
        self.episodes
            .iter()
            .filter(|episode| episode.end == End::Overlap)
            .count()
    }

    /// Mean of `value` over the episodes that have one; NaN without any.
    pub fn mean(&self, value: impl Fn(&Episode) -> Option<f64>) -> f64 {
        let values: Vec<f64> = self.episodes.iter().filter_map(value).collect();
        values.iter().sum::<f64>() / values.len() as f64
    }

    /// Whether the command asks the robot to move.
    pub fn moves(&self) -> bool {
        self.command.iter().any(|&x| x != 0.0)
    }
}
