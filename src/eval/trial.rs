//! Trials side by side: each asks one environment for something and keeps what came of it.

use std::sync::Arc;

use nalgebra::Vector3;
use omniwalk_env::engine::{BaseState, Engine, Maker};
use omniwalk_env::robot::Robot;
use omniwalk_env::task::environment::Environment;
use omniwalk_env::task::episode::Episode;
use omniwalk_env::task::shared::Shared;
use omniwalk_env::truth::Truth;
use omniwalk_env::{Batch, EnvConfig};

use super::forward::Watch;

/// Most environments of a batch: what bounds the memory, as a rapier world takes half a megabyte.
const SIDE_BY_SIDE: usize = 256;
/// Seeds of what is played apart lie this far apart, so that none of its random streams is that of another part.
const PART: u64 = 1 << 48;
const BATCH: u64 = 1 << 32;

/// What a trial wants of the next control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ask {
    /// Desired velocity (m/s, m/s, rad/s).
    pub velocity: [f64; 3],
    /// Force on the base, world frame, N.
    pub force: Vector3<f64>,
}

impl Ask {
    /// To walk at `velocity`, undisturbed.
    pub fn walk(velocity: [f64; 3]) -> Self {
        Self {
            velocity,
            force: Vector3::zeros(),
        }
    }
}

/// An environment after a control step.
pub struct Seen<'a> {
    /// What all environments have in common.
    pub shared: &'a Shared,
    /// The environment.
    pub environment: &'a Environment,
    /// Its engine.
    pub engine: &'a dyn Engine,
    /// Its world there.
    pub world: usize,
    /// The action of the step, in [0, 1] per joint.
    pub action: &'a [f32],
    /// The episode, if the step ended it; everything else is then of the episode that follows.
    pub ended: Option<&'a Episode>,
}

impl Seen<'_> {
    /// True state of the base.
    pub fn base(&self) -> BaseState {
        self.engine.base(self.world)
    }

    /// True velocity in the heading frame (m/s, m/s) and turn rate, rad/s.
    pub fn velocity(&self) -> [f64; 3] {
        let truth = Truth::new(&self.base());
        let [along, left] = truth.velocity_along(truth.heading);
        [along, left, truth.vertical_turn]
    }
}

/// What happens to one environment in a suite.
pub trait Trial {
    /// What the next step is asked for; `None` once the trial is over.
    fn ask(&mut self) -> Option<Ask>;

    /// Takes in the step that was asked for. An environment that fell has been reset to standing.
    fn see(&mut self, seen: &Seen<'_>);
}

/// Where trials are played.
pub struct Stage<'a> {
    /// The robot.
    pub robot: Arc<Robot>,
    /// The conditions.
    pub config: EnvConfig,
    /// Seed of everything random.
    pub seed: u64,
    /// What the worlds are stepped by.
    pub engines: &'a dyn Maker,
    /// Observations to actions, row-major.
    pub policy: &'a mut dyn FnMut(&[f32], &mut [f32]),
}

impl Stage<'_> {
    /// Control steps in `seconds`, at least one.
    pub fn steps(&self, seconds: f64) -> usize {
        (seconds * f64::from(self.config.engine.control_hz)).round().max(1.0) as usize
    }

    /// Plays `trials` to their ends. What is random in them depends on `part`, which no other trials of an evaluation
    /// should have. `watch` sees the first batch of them: environment `e` is trial `e`.
    ///
    /// # Errors
    /// When robot and configuration do not fit together, and whatever `watch` says.
    pub fn play<T: Trial>(
        &mut self,
        part: u64,
        trials: &mut [T],
        mut watch: Option<&mut dyn Watch>,
    ) -> miette::Result<()> {
        for (i, trials) in trials.chunks_mut(SIDE_BY_SIDE).enumerate() {
            let seed = self.seed.wrapping_add(part * PART + i as u64 * BATCH);
            self.play_batch(seed, trials, watch.take())?;
        }
        Ok(())
    }

    fn play_batch<T: Trial>(
        &mut self,
        seed: u64,
        trials: &mut [T],
        mut watch: Option<&mut dyn Watch>,
    ) -> miette::Result<()> {
        let mut batch = Batch::with_engines(self.robot.clone(), &self.config, trials.len(), seed, self.engines)?;
        let joints = batch.shared().spec.action_len();
        let mut actions = vec![0.0; trials.len() * joints];
        let mut observations = batch.observations().to_vec();
        let mut ended: Vec<Option<Episode>> = vec![None; trials.len()];
        let mut active = vec![true; trials.len()];
        let mut going = ask(&mut batch, trials, &mut active);
        // Again, so that the first observations hold the commands.
        batch.reset();
        if let Some(watch) = watch.as_deref_mut() {
            watch.start(&batch)?;
        }
        while going {
            observations.copy_from_slice(batch.observations());
            (self.policy)(&observations, &mut actions);
            batch.step(&actions);
            if let Some(watch) = watch.as_deref_mut() {
                watch.step(&batch, &observations, &actions)?;
            }
            ended.fill(None);
            for episode in batch.take_episodes() {
                let e = episode.environment;
                ended[e] = Some(episode);
            }
            for (e, trial) in trials.iter_mut().enumerate().filter(|(e, _)| active[*e]) {
                let (environment, engine, world) = batch.look(e);
                trial.see(&Seen {
                    shared: batch.shared(),
                    environment,
                    engine,
                    world,
                    action: &actions[e * joints..(e + 1) * joints],
                    ended: ended[e].as_ref(),
                });
            }
            going = ask(&mut batch, trials, &mut active);
        }
        Ok(())
    }
}

/// Passes on what the trials want and notes which of them go on; whether any does.
fn ask<T: Trial>(batch: &mut Batch, trials: &mut [T], active: &mut [bool]) -> bool {
    for (e, (trial, active)) in trials.iter_mut().zip(active.iter_mut()).enumerate() {
        let ask = trial.ask();
        *active = ask.is_some();
        let ask = ask.unwrap_or(Ask::walk([0.0; 3]));
        batch.set_desired_of(e, ask.velocity);
        batch.push(e, ask.force);
    }
    active.contains(&true)
}
