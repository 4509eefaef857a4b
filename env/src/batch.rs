//! Many environments behind flat arrays, stepped by all cores.
//!
//! A batch is made of groups; a group is one engine object with its worlds and the environments around them.
//! Groups share nothing that changes, so the result does not depend on how many threads step them.

use std::sync::Arc;

use nalgebra::Vector3;
use omniwalk_controller::{ROW, RowObserver};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::actuators::Actuators;
use crate::config::EnvConfig;
use crate::engine::{self, BaseState, Engine};
use crate::error::EnvError;
use crate::robot::{Base, Robot};
use crate::task::command::CommandRange;
use crate::task::environment::{Environment, Scratch};
use crate::task::episode::{End, Episode, Outcome};
use crate::task::poses::Poses;
use crate::task::reward::{Factors, Terms};
use crate::task::shared::Shared;
use crate::truth::Truth;

/// A batch of environments. Row `e` of every array belongs to environment `e`.
pub struct Batch {
    shared: Arc<Shared>,
    groups: Vec<Group>,
    factors: Factors,
    observations: Vec<f32>,
    final_observations: Vec<f32>,
    terms: Vec<Terms>,
    ends: Vec<Option<End>>,
    episodes: Vec<Episode>,
}

/// The environments around one engine object.
struct Group {
    engine: Box<dyn Engine>,
    actuators: Actuators,
    environments: Vec<Environment>,
    episodes: Vec<Episode>,
    scratch: Scratch,
    poses: Poses,
    /// The bases at the end of the step; `None` where the physics has gone non-finite.
    truths: Vec<Option<Truth>>,
    observer: RowObserver,
}

/// A group's rows of the batch's arrays.
struct Rows<'a> {
    observations: &'a mut [f32],
    final_observations: &'a mut [f32],
    terms: &'a mut [Terms],
    ends: &'a mut [Option<End>],
}

#[derive(Serialize, Deserialize)]
struct Saved {
    factors: Factors,
    groups: Vec<SavedGroup>,
}

#[derive(Serialize, Deserialize)]
struct SavedGroup {
    environments: Vec<Environment>,
    targets: Vec<f64>,
    observations: Vec<f32>,
    worlds: Vec<Vec<u8>>,
}

impl Batch {
    /// `environments` environments of `robot`, each at the start of its first episode.
    ///
    /// # Errors
    /// [`EnvError`] when robot, configuration and engine do not fit together.
    pub fn new(robot: Arc<Robot>, config: &EnvConfig, environments: usize, seed: u64) -> Result<Self, EnvError> {
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
        let shared = Arc::new(Shared::new(robot, config, seed)?);
        let width = engine::group_width(config).min(environments.max(1));
        let groups = (0..environments)
            .step_by(width)
            .map(|first| Group::new(&shared, first, width.min(environments - first)))
            .collect::<Result<Vec<_>, _>>()?;
        let observation_len = shared.spec.observation_len();
        let mut batch = Self {
            shared,
            groups,
            factors: Factors {
                velocity: 1.0,
                foot: 1.0,
            },
            observations: vec![0.0; environments * observation_len],
            final_observations: vec![0.0; environments * observation_len],
            terms: vec![Terms::default(); environments],
            ends: vec![None; environments],
            episodes: Vec::new(),
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
    pub fn take_episodes(&mut self) -> std::vec::Drain<'_, Episode> {
        self.episodes.drain(..)
    }

    /// Sets the curriculum's factors on the reward.
    pub fn set_factors(&mut self, factors: Factors) {
        self.factors = factors;
    }

    /// Sets where every environment draws desired velocities from, from its next draw on.
    pub fn set_range(&mut self, range: CommandRange) {
        self.groups
            .iter_mut()
            .flat_map(|group| &mut group.environments)
            .for_each(|e| e.set_range(range));
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
        let shared = &self.shared;
        let rows = self.groups[0].environments.len() * shared.spec.observation_len();
        self.groups
            .par_iter_mut()
            .zip(self.observations.par_chunks_mut(rows))
            .for_each(|(group, observations)| group.reset(shared, observations));
    }

    /// One control step: `actions` in [0, 1], one row an environment.
    pub fn step(&mut self, actions: &[f32]) {
        let (joints, n) = (self.shared.spec.action_len(), self.shared.spec.observation_len());
        debug_assert_eq!(actions.len(), self.environments() * joints);
        let (shared, factors) = (&self.shared, self.factors);
        let width = self.groups[0].environments.len();
        self.groups
            .par_iter_mut()
            .zip(self.observations.par_chunks_mut(width * n))
            .zip(self.final_observations.par_chunks_mut(width * n))
            .zip(self.terms.par_chunks_mut(width))
            .zip(self.ends.par_chunks_mut(width))
            .zip(actions.par_chunks(width * joints))
            .for_each(
                |(((((group, observations), final_observations), terms), ends), actions)| {
                    let rows = Rows {
                        observations,
                        final_observations,
                        terms,
                        ends,
                    };
                    group.step(shared, factors, actions, rows);
                },
            );
        for group in &mut self.groups {
            self.episodes.append(&mut group.episodes);
        }
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
        let rows = self.groups[0].environments.len() * self.shared.spec.observation_len();
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
        let rows = self.groups[0].environments.len() * self.shared.spec.observation_len();
        let groups = self.groups.iter_mut().zip(self.observations.chunks_mut(rows));
        for ((group, observations), saved) in groups.zip(saved.groups) {
            group.load(saved, observations)?;
        }
        Ok(())
    }

    fn place(&self, e: usize) -> (usize, usize) {
        let width = self.groups[0].environments.len();
        (e / width, e % width)
    }
}

impl Group {
    fn new(shared: &Shared, first: usize, worlds: usize) -> Result<Self, EnvError> {
        Ok(Self {
            engine: engine::build(&shared.robot, &shared.config, worlds)?,
            actuators: Actuators::new(&shared.robot, worlds),
            environments: (0..worlds)
                .map(|w| Environment::new(shared, first + w))
                .collect::<Result<_, _>>()?,
            episodes: Vec::with_capacity(worlds),
            scratch: Scratch::new(shared),
            poses: Poses::new(&shared.robot, worlds),
            truths: vec![None; worlds],
            observer: RowObserver::new(&shared.spec),
        })
    }

    fn reset(&mut self, shared: &Shared, observations: &mut [f32]) {
        let rows = observations.chunks_exact_mut(shared.spec.observation_len());
        for (w, (environment, row)) in self.environments.iter_mut().zip(rows).enumerate() {
            environment.reset(
                shared,
                &mut *self.engine,
                &mut self.actuators,
                w,
                &mut self.scratch,
                row,
            );
        }
    }

    fn step(&mut self, shared: &Shared, factors: Factors, actions: &[f32], mut rows: Rows) {
        let Self {
            engine,
            actuators,
            environments,
            ..
        } = self;
        let engine = &mut **engine;
        let actions = actions.chunks_exact(shared.spec.action_len());
        for (w, (environment, action)) in environments.iter_mut().zip(actions).enumerate() {
            environment.act(shared, engine, actuators, w, action);
        }
        let (dt, worlds) = (shared.config.physics_dt(), environments.len());
        for _ in 0..shared.config.substeps() {
            engine.step(actuators.drive(engine.joints()));
            let loads = engine.foot_loads();
            for (w, environment) in environments.iter_mut().enumerate() {
                environment.forces(&loads[w..], worlds, dt);
            }
        }
        self.observe(shared, rows.observations);
        self.judge(shared, factors, &mut rows);
    }

    /// Reads the sensors of every world and writes the observations.
    fn observe(&mut self, shared: &Shared, observations: &mut [f32]) {
        self.poses.look(&mut *self.engine);
        for (w, (environment, truth)) in self.environments.iter_mut().zip(&mut self.truths).enumerate() {
            *truth = environment.sense(shared, &*self.engine, w, &self.poses);
        }
        let n = shared.spec.observation_len();
        let places = self.environments.chunks_mut(ROW).zip(self.truths.chunks(ROW));
        for ((environments, truths), rows) in places.zip(observations.chunks_mut(ROW * n)) {
            let mut places = environments.iter_mut().zip(truths).zip(rows.chunks_exact_mut(n));
            let mut turns = std::array::from_fn(|_| {
                let ((environment, truth), row) = places.next()?;
                truth.as_ref().map(|truth| environment.turn(shared, truth, row))
            });
            self.observer.observe(&shared.spec, &mut turns);
        }
    }

    /// Judges the step in every world, and starts another episode where one has ended.
    fn judge(&mut self, shared: &Shared, factors: Factors, rows: &mut Rows) {
        let n = shared.spec.observation_len();
        for (w, (environment, truth)) in self.environments.iter_mut().zip(&self.truths).enumerate() {
            let engine = &mut *self.engine;
            let lost = Outcome {
                terms: Terms::default(),
                end: Some(End::Lost),
            };
            let outcome = truth.as_ref().map_or(lost, |truth| {
                environment.conclude_step(shared, engine, w, truth, factors, &self.poses)
            });
            rows.terms[w] = outcome.terms;
            rows.ends[w] = outcome.end;
            if let Some(end) = outcome.end {
                let row = &mut rows.observations[w * n..(w + 1) * n];
                rows.final_observations[w * n..(w + 1) * n].copy_from_slice(row);
                self.episodes.push(environment.conclude(end));
                environment.reset(shared, engine, &mut self.actuators, w, &mut self.scratch, row);
            }
        }
    }

    fn save(&self, observations: &[f32]) -> SavedGroup {
        let worlds = (0..self.environments.len())
            .map(|w| {
                let mut bytes = Vec::new();
                self.engine.save(w, &mut bytes);
                bytes
            })
            .collect();
        SavedGroup {
            environments: self.environments.clone(),
            targets: self.actuators.targets().to_vec(),
            observations: observations.to_vec(),
            worlds,
        }
    }

    fn load(&mut self, saved: SavedGroup, observations: &mut [f32]) -> Result<(), EnvError> {
        let fits = saved.environments.len() == self.environments.len()
            && saved.worlds.len() == self.environments.len()
            && saved.observations.len() == observations.len();
        if !fits {
            return Err(EnvError::State(
                "another number of environments or another observation".into(),
            ));
        }
        self.actuators.restore(&saved.targets).map_err(EnvError::State)?;
        for (w, bytes) in saved.worlds.iter().enumerate() {
            self.engine.load(w, bytes).map_err(EnvError::State)?;
        }
        self.environments = saved.environments;
        observations.copy_from_slice(&saved.observations);
        Ok(())
    }
}
