//! Many environments behind flat arrays, stepped by all cores.
//!
//! A batch is made of groups; a group is one engine object with its worlds and the environments around them.
//! Groups share nothing that changes, so the result does not depend on how many threads step them.

mod collect;
mod group;
mod schedule;

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::EnvConfig;
use crate::engine::{BaseState, Configured, Engine, Maker, Phase};
use crate::error::EnvError;
use crate::robot::{Base, Robot};
use crate::task::command::CommandRange;
use crate::task::environment::Environment;
use crate::task::episode::{End, Episode, Fault};
use crate::task::reward::{Factors, Terms};
use crate::task::shared::Shared;
pub use collect::{Collect, Outcomes};
use group::{Group, PHASES, Rows, SavedGroup};

/// A batch of environments. Row `e` of every array belongs to environment `e`.
pub struct Batch {
    shared: Shared,
    groups: Vec<Group>,
    factors: Factors,
    observations: Vec<f32>,
    final_observations: Vec<f32>,
    terms: Vec<Terms>,
    ends: Vec<Option<End>>,
    /// With the step they ended in, counted from the beginning of the last call that stepped.
    episodes: Vec<(usize, Episode)>,
    faults: Vec<(usize, Fault)>,
}

#[derive(Serialize, Deserialize)]
struct Saved {
    factors: Factors,
    groups: Vec<SavedGroup>,
}

impl Batch {
    /// `environments` environments of `robot`, each at the start of its first episode.
    ///
    /// # Errors
    /// [`EnvError`] when robot, configuration and engine do not fit together.
    pub fn new(robot: Arc<Robot>, config: &EnvConfig, environments: usize, seed: u64) -> Result<Self, EnvError> {
        Self::with_engines(robot, config, environments, seed, &Configured)
    }

    /// The same with the engines that `engines` makes.
    ///
    /// # Errors
    /// As [`Batch::new`].
    pub fn with_engines(
        robot: Arc<Robot>,
        config: &EnvConfig,
        environments: usize,
        seed: u64,
        engines: &dyn Maker,
    ) -> Result<Self, EnvError> {
        if robot.base == Base::Fixed {
            return Err(EnvError::FixedBase {
                robot: robot.name.clone(),
            });
        }
        if robot.feet.is_empty() {
            return Err(EnvError::NoFeet {
                robot: robot.name.clone(),
            });
        }
        let shared = Shared::new(robot, config, seed)?;
        let width = engines.width(config, environments).clamp(1, environments.max(1));
        let groups = (0..environments)
            .step_by(width)
            .map(|first| Group::new(&shared, engines, first, width.min(environments - first)))
            .collect::<Result<Vec<_>, _>>()?;
        let observation_len = shared.spec.observation_len();
        let mut batch = Self {
            shared,
            groups,
            factors: Factors {
                velocity: 1.0,
                foot: 1.0,
                push: 1.0,
            },
            observations: vec![0.0; environments * observation_len],
            final_observations: vec![0.0; environments * observation_len],
            terms: vec![Terms::default(); environments],
            ends: vec![None; environments],
            episodes: Vec::new(),
            faults: Vec::new(),
        };
        batch.reset();
        Ok(batch)
    }

    /// Number of environments.
    pub fn environments(&self) -> usize {
        self.terms.len()
    }

    /// What the environments have in common.
    pub fn shared(&self) -> &Shared {
        &self.shared
    }

    /// Observations that wait for an action, row-major.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// The last observation of the episodes that ended in the last step; other rows are meaningless.
    pub fn final_observations(&self) -> &[f32] {
        &self.final_observations
    }

    /// Rewards of the last step by term.
    pub fn terms(&self) -> &[Terms] {
        &self.terms
    }

    /// Which episodes ended in the last step, and how. Those environments have already started another.
    pub fn ends(&self) -> &[Option<End>] {
        &self.ends
    }

    /// The episodes that ended since the last call, in the order of steps and environments.
    pub fn take_episodes(&mut self) -> impl Iterator<Item = Episode> {
        self.episodes.drain(..).map(|(_, episode)| episode)
    }

    /// Of the episodes that were lost in the last [`Batch::step`]: the environment, and what was not finite.
    pub fn faults(&self) -> &[(usize, Fault)] {
        &self.faults
    }

    /// Sets the curriculum's factors on the reward and on pushes.
    pub fn set_factors(&mut self, factors: Factors) {
        self.factors = factors;
    }

    /// Sets where every environment draws desired velocities from, from its next draw on.
    pub fn set_range(&mut self, range: CommandRange) {
        self.each(|environment| environment.set_range(range));
    }

    /// Sets where environment `e` draws desired velocities from, from its next draw on.
    pub fn set_range_of(&mut self, e: usize, range: CommandRange) {
        let (group, world) = self.place(e);
        self.groups[group].environments[world].set_range(range);
    }

    /// Sets the desired velocity of environment `e` (m/s, m/s, rad/s), from its next observation on and in later
    /// episodes.
    pub fn set_desired_of(&mut self, e: usize, velocity: [f64; 3]) {
        let (group, world) = self.place(e);
        self.groups[group].environments[world].set_desired(velocity);
    }

    /// Sets the external force on the base of environment `e`, world frame, N; it acts until it is set again or the
    /// episode ends. Pushes of the configuration must be off: they set it too.
    pub fn push(&mut self, e: usize, force: Vector3<f64>) {
        let (group, world) = self.place(e);
        self.groups[group].engine.push(world, force);
    }

    /// Starts an episode everywhere.
    pub fn reset(&mut self) {
        let rows = self.width() * self.shared.spec.observation_len();
        let shared = &self.shared;
        self.groups
            .par_iter_mut()
            .zip(self.observations.par_chunks_mut(rows))
            .for_each(|(group, observations)| group.reset(shared, observations));
    }

    /// Ends every episode without a record and starts the next.
    pub fn restart(&mut self) {
        self.each(Environment::pass_over);
        self.reset();
    }

    /// Starts over with the first episodes of `seed`, as in a new batch; what was set of commands and rewards stays.
    pub fn reseed(&mut self, seed: u64) {
        self.shared.seed = seed;
        let width = self.width();
        for (g, group) in self.groups.iter_mut().enumerate() {
            group.redraw(&self.shared, g * width);
        }
        self.each(Environment::start_over);
        self.reset();
    }

    fn each(&mut self, change: impl Fn(&mut Environment)) {
        self.groups
            .iter_mut()
            .flat_map(|group| &mut group.environments)
            .for_each(change);
    }

    /// One control step: `actions` in [0, 1], one row an environment.
    pub fn step(&mut self, actions: &[f32]) {
        let joints = self.shared.spec.action_len();
        debug_assert_eq!(actions.len(), self.environments() * joints);
        let actions = actions.par_chunks(self.width() * joints);
        self.each_group(actions, |shared, factors, group, rows, actions| {
            group.step(shared, factors, 0, actions, rows);
        });
        self.faults.clear();
        for group in &mut self.groups {
            self.faults.append(&mut group.faults);
        }
    }

    /// The environments of each group, in order: what [`Batch::roll`] wants a part for.
    pub fn groups(&self) -> impl Iterator<Item = Range<usize>> {
        let (n, width) = (self.environments(), self.width());
        (0..n).step_by(width).map(move |first| first..(first + width).min(n))
    }

    /// Does `work` for every group, its rows and its element of `with`, on all cores, and gathers the episodes that ended.
    fn each_group<T: Send>(
        &mut self,
        with: impl IndexedParallelIterator<Item = T>,
        work: impl Fn(&Shared, Factors, &mut Group, &mut Rows, T) + Sync,
    ) {
        let (n, width) = (self.shared.spec.observation_len(), self.width());
        let (shared, factors) = (&self.shared, self.factors);
        self.groups
            .par_iter_mut()
            .zip(self.observations.par_chunks_mut(width * n))
            .zip(self.final_observations.par_chunks_mut(width * n))
            .zip(self.terms.par_chunks_mut(width))
            .zip(self.ends.par_chunks_mut(width))
            .zip(with)
            .for_each(|(((((group, observations), final_observations), terms), ends), with)| {
                let mut rows = Rows {
                    observations,
                    final_observations,
                    terms,
                    ends,
                };
                work(shared, factors, group, &mut rows, with);
            });
        self.gather();
    }

    /// Gathers the groups' episodes that ended.
    fn gather(&mut self) {
        let first = self.episodes.len();
        for group in &mut self.groups {
            self.episodes.append(&mut group.episodes);
        }
        self.episodes[first..].sort_unstable_by_key(|(step, episode)| (*step, episode.environment));
    }

    /// Environments of a group; the last may have fewer.
    fn width(&self) -> usize {
        self.groups[0].environments.len()
    }

    /// Starts, or stops, the clocks that split steps into phases, from zero: of control steps and, if `engine`, of physics
    /// steps too, which costs those a hundredth.
    pub fn time_phases(&mut self, running: bool, engine: bool) {
        for group in &mut self.groups {
            group.clock.run(running);
            group.engine.time_phases(running && engine);
        }
    }

    /// Time by phase since [`Batch::time_phases`], added over all threads. `drives` is what happens between physics
    /// steps, `sensing` goes up to the observation.
    pub fn phases(&self) -> Vec<Phase> {
        let mut phases = PHASES.map(|name| Phase { name, seconds: 0.0 });
        for group in &self.groups {
            for (phase, seconds) in phases.iter_mut().zip(group.clock.seconds()) {
                phase.seconds += seconds;
            }
        }
        phases.to_vec()
    }

    /// Time by phase of the physics step, likewise; empty where the engine has no phases.
    pub fn engine_phases(&self) -> Vec<Phase> {
        let mut phases = self.groups[0].engine.phases();
        for group in &self.groups[1..] {
            for (phase, own) in phases.iter_mut().zip(group.engine.phases()) {
                phase.seconds += own.seconds;
            }
        }
        phases
    }

    /// Floating-point operations of a physics step of all environments by phase, were it done now with the last drives, see [`crate::engine::lanes::operations`].
    ///
    /// # Errors
    /// When the engine is not `lanes` in `f32`.
    pub fn operations(&self) -> Result<Vec<u64>, String> {
        let shared = &self.shared;
        let mut sums = Vec::new();
        for group in &self.groups {
            let own = group.operations(shared)?;
            sums.resize(own.len(), 0);
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
        Ok(sums)
    }

    /// The environment `e`, its engine and its world there.
    pub fn look(&self, e: usize) -> (&Environment, &dyn Engine, usize) {
        let (group, world) = self.place(e);
        (
            &self.groups[group].environments[world],
            &*self.groups[group].engine,
            world,
        )
    }

    /// True base state of environment `e`.
    pub fn base(&self, e: usize) -> BaseState {
        let (_, engine, world) = self.look(e);
        engine.base(world)
    }

    /// Everything that determines the future of the batch.
    pub fn save(&self) -> Vec<u8> {
        let rows = self.width() * self.shared.spec.observation_len();
        let groups = self.groups.iter().zip(self.observations.chunks(rows));
        let groups = groups.map(|(group, observations)| group.save(observations)).collect();
        postcard::to_stdvec(&Saved {
            factors: self.factors,
            groups,
        })
        .expect("plain data always serialises")
    }

    /// Restores what [`Batch::save`] wrote: the batch goes on with the same bits.
    ///
    /// # Errors
    /// [`EnvError::State`] when the bytes are damaged or from another configuration; the batch must then not be used.
    pub fn load(&mut self, bytes: &[u8]) -> Result<(), EnvError> {
        let saved: Saved = postcard::from_bytes(bytes).map_err(|error| EnvError::State(error.to_string()))?;
        if saved.groups.len() != self.groups.len() {
            return Err(EnvError::State(format!(
                "{} groups, not {}",
                saved.groups.len(),
                self.groups.len()
            )));
        }
        self.factors = saved.factors;
        let rows = self.width() * self.shared.spec.observation_len();
        let groups = self.groups.iter_mut().zip(self.observations.chunks_mut(rows));
        for ((group, observations), saved) in groups.zip(saved.groups) {
            group.load(saved, observations)?;
        }
        Ok(())
    }

    fn place(&self, e: usize) -> (usize, usize) {
        let width = self.width();
        (e / width, e % width)
    }
}
