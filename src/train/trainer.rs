//! One training run: environments, learner and curriculum, an update at a time.

use std::sync::Arc;
use std::time::Instant;

use omniwalk_controller::Spec;
use omniwalk_curriculum::{Curriculum, Performance};
use omniwalk_env::engine::{Configured, Maker};
use omniwalk_env::robot::Robot;
use omniwalk_env::task::command::CommandRange;
use omniwalk_env::task::episode::Fault;
use omniwalk_env::task::reward::{Factors, Terms};
use omniwalk_env::{Batch, EnvError};
use omniwalk_ppo::{self as ppo, Agent, Mirror, Rollout, UpdateStats};
use serde::{Deserialize, Serialize};

use super::collect::{self, Collected, Part, Sampling};
use super::window::Window;
use crate::settings::Settings;

/// Keeps the keys of updates apart from those of actions.
const UPDATE_STREAM: u64 = 1 << 63;

/// A run in memory.
pub struct Trainer {
    settings: Settings,
    batch: Batch,
    agent: Agent,
    rollout: Rollout,
    mirror: Option<Mirror>,
    progress: Progress,
    /// One for each group of environments.
    parts: Vec<Part>,
}

/// What a checkpoint keeps beside networks and environments.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Progress {
    /// Updates done.
    pub update: u64,
    /// Control steps done, all environments together.
    pub steps: u64,
    /// The curriculum.
    pub curriculum: Curriculum,
    /// The latest finished episodes.
    pub window: Window,
    /// Wall time spent, s. A checkpoint keeps it beside the tensors, which depend on nothing but configuration and seed.
    #[serde(skip)]
    pub seconds: f64,
}

/// Robot and configuration do not fit together.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum TrainError {
    /// The environments cannot be made.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// The networks cannot be made.
    #[error("ppo.{0}")]
    Ppo(#[from] ppo::InvalidConfig),
}

/// Seconds an update spent where; while collecting, of the time of one thread.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Split {
    /// Stepping the environments: physics, sensors, reward.
    pub physics: f64,
    /// Networks while collecting.
    pub inference: f64,
    /// Learning.
    pub update: f64,
}

/// What one update did.
pub struct Report {
    /// Where the time went.
    pub split: Split,
    /// The learner's own figures.
    pub learning: UpdateStats,
    /// Mean reward per second by term, before the reward scale.
    pub terms: Terms,
    /// What the curriculum saw.
    pub performance: Performance,
    /// Episodes that were lost to numbers that are not finite.
    pub lost: u64,
    /// The first of them: the environment, and what was not finite.
    pub fault: Option<(usize, Fault)>,
    /// Control steps it collected.
    pub samples: usize,
}

impl Trainer {
    /// A run at its beginning.
    ///
    /// # Errors
    /// [`TrainError`] when robot and configuration do not fit together.
    pub fn new(settings: &Settings, robot: Arc<Robot>) -> Result<Self, TrainError> {
        Self::with_engines(settings, robot, &Configured)
    }

    /// A run at its beginning, in engines that `engines` makes.
    ///
    /// # Errors
    /// As [`Trainer::new`].
    pub fn with_engines(settings: &Settings, robot: Arc<Robot>, engines: &dyn Maker) -> Result<Self, TrainError> {
        let train = &settings.train;
        let batch = Batch::with_engines(robot, &settings.env, train.environments, train.seed, engines)?;
        let spec = &batch.shared().spec;
        let (observation_len, action_len) = (spec.observation_len(), spec.action_len());
        let agent = Agent::new(settings.ppo.clone(), observation_len, action_len, train.seed)?;
        let mirror = if train.mirror { Some(mirror(&batch)?) } else { None };
        let mut trainer = Self {
            settings: settings.clone(),
            rollout: Rollout::new(train.steps_per_update, train.environments, observation_len, action_len),
            mirror,
            progress: Progress {
                update: 0,
                steps: 0,
                curriculum: Curriculum::new(&settings.curriculum),
                window: Window::default(),
                seconds: 0.0,
            },
            parts: batch
                .groups()
                .map(|environments| Part::new(train.steps_per_update, environments, &agent))
                .collect(),
            batch,
            agent,
        };
        trainer.apply_curriculum();
        trainer.batch.reset();
        Ok(trainer)
    }

    /// Goes on from a checkpoint.
    ///
    /// # Errors
    /// [`EnvError::State`] when the environments' state does not fit this configuration.
    pub fn restore(&mut self, agent: Agent, environments: &[u8], progress: Progress) -> Result<(), EnvError> {
        self.batch.load(environments)?;
        self.agent = agent;
        self.progress = progress;
        Ok(())
    }

    /// Puts another learner in the place of the one with random weights, before the first update.
    pub fn begin_with(&mut self, agent: Agent) {
        self.agent = agent;
    }

    /// Networks, optimiser and normaliser.
    pub fn agent(&self) -> &Agent {
        &self.agent
    }

    /// The environments.
    pub fn batch(&self) -> &Batch {
        &self.batch
    }

    /// How far the run is.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// The layout of observation and action.
    pub fn spec(&self) -> &Spec {
        &self.batch.shared().spec
    }

    /// Collects samples, learns from them, advances the curriculum.
    pub fn update(&mut self) -> Report {
        // Once inside the pool: from outside it, every parallel loop of every step would wake a thread of it and wait.
        rayon::scope(|_| self.iterate())
    }

    fn iterate(&mut self) -> Report {
        let start = Instant::now();
        let Collected {
            terms,
            lost,
            falls,
            fault,
            seconds: [physics, inference],
        } = self.collect();
        let learn = Instant::now();
        let key = collect::mix(self.settings.train.seed ^ UPDATE_STREAM, self.progress.update);
        let learning = self.agent.update(&self.rollout, self.mirror.as_ref(), key);
        let split = Split {
            physics,
            inference,
            update: learn.elapsed().as_secs_f64(),
        };
        let performance = self.performance(&terms, falls);
        self.progress
            .curriculum
            .advance(&self.settings.curriculum, &performance);
        self.apply_curriculum();
        self.progress.update += 1;
        self.progress.steps += self.rollout.samples() as u64;
        self.progress.seconds += start.elapsed().as_secs_f64();
        Report {
            split,
            learning,
            terms: self.per_second(&terms),
            performance,
            lost,
            fault,
            samples: self.rollout.samples(),
        }
    }

    /// Fills the rollout.
    fn collect(&mut self) -> Collected {
        let train = &self.settings.train;
        let sampling = Sampling {
            agent: &self.agent,
            seed: train.seed,
            done: self.progress.steps,
            environments: train.environments,
            reward_scale: train.reward_scale,
        };
        self.batch.roll(self.rollout.steps, &sampling, &mut self.parts);
        self.progress.window.extend(self.batch.take_episodes());
        collect::gather(&mut self.parts, &mut self.rollout)
    }

    /// Bounds of the region desired velocities are drawn from.
    pub fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        region(&self.settings, &self.progress)
    }

    fn apply_curriculum(&mut self) {
        let (lower, upper) = self.bounds();
        let (curriculum, command) = (&self.progress.curriculum, &self.settings.env.command);
        self.batch.set_factors(Factors {
            velocity: curriculum.velocity_factor(),
            foot: curriculum.foot_factor(),
            push: curriculum.push_factor(&self.settings.curriculum),
        });
        self.batch.set_range(CommandRange {
            lower,
            upper,
            zero_share: command.zero_share,
            axis_share: command.axis_share,
        });
    }

    /// The mean kernels of the update, and falls per full length of an episode.
    fn performance(&self, terms: &Terms, falls: u64) -> Performance {
        let reward = &self.settings.env.reward;
        let seconds = self.rollout.samples() as f64 / f64::from(self.settings.env.engine.control_hz);
        let kernel = |sum: f64, weight: f64| if weight > 0.0 { sum / (weight * seconds) } else { 1.0 };
        let curriculum = &self.progress.curriculum;
        Performance {
            velocity: kernel(terms.velocity, reward.velocity_weight * curriculum.velocity_factor()),
            foot: kernel(terms.foot, reward.foot_weight * curriculum.foot_factor()),
            falls: Some((falls as f64 * self.settings.env.task.episode_seconds / seconds).min(1.0)),
        }
    }

    fn per_second(&self, sum: &Terms) -> Terms {
        let seconds = self.rollout.samples() as f64 / f64::from(self.settings.env.engine.control_hz);
        sum.scaled(1.0 / seconds)
    }
}

/// Bounds of the region desired velocities are drawn from when a run with `settings` is as far as `progress`.
pub fn region(settings: &Settings, progress: &Progress) -> ([f64; 3], [f64; 3]) {
    let command = &settings.env.command;
    progress
        .curriculum
        .bounds(&settings.curriculum, command.lower, command.upper)
}

fn mirror(batch: &Batch) -> Result<Mirror, EnvError> {
    let shared = batch.shared();
    let joints = shared.robot.mirror_map().ok_or_else(|| EnvError::NoMirror {
        robot: shared.robot.name.clone(),
    })?;
    Ok(Mirror {
        observation: shared.spec.mirror_observation(&joints),
        action: shared.spec.mirror_action(&joints),
    })
}
