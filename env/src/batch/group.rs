//! A group: one engine object with its worlds and the environments around them.

use omniwalk_controller::{ROW, RowObserver};
use serde::{Deserialize, Serialize};

use super::collect::{Collect, Outcomes};
use crate::actuators::Actuators;
use crate::clock::Clock;
use crate::engine::{Engine, Maker, lanes};
use crate::error::EnvError;
use crate::random::Stream;
use crate::robot::Robot;
use crate::task::environment::{Environment, Scratch};
use crate::task::episode::{End, Episode, Fault, Outcome};
use crate::task::poses::Poses;
use crate::task::reward::{Factors, Terms};
use crate::task::shared::Shared;
use crate::truth::Truth;

/// The environments around one engine object.
pub struct Group {
    pub engine: Box<dyn Engine>,
    actuators: Actuators,
    pub environments: Vec<Environment>,
    /// Those that ended, with the step they ended in.
    pub episodes: Vec<(usize, Episode)>,
    /// Of the episodes that are lost: the environment, and what was not finite.
    pub faults: Vec<(usize, Fault)>,
    scratch: Scratch,
    poses: Poses,
    /// The bases at the end of the step; `None` where the physics has gone non-finite.
    truths: Vec<Option<Truth>>,
    observer: RowObserver,
    pub clock: Clock<{ PHASES.len() }>,
}

/// Phases of a control step in order.
pub const PHASES: [&str; 6] = ["actions", "drives", "engine", "sensing", "reward", "resets"];
const ACTIONS: usize = 0;
const DRIVES: usize = 1;
const ENGINE: usize = 2;
const SENSING: usize = 3;
const REWARD: usize = 4;
const RESETS: usize = 5;

/// A group's rows of the batch's arrays.
pub struct Rows<'a> {
    pub observations: &'a mut [f32],
    pub final_observations: &'a mut [f32],
    pub terms: &'a mut [Terms],
    pub ends: &'a mut [Option<End>],
}

/// Everything that determines the future of a group.
#[derive(Serialize, Deserialize)]
pub struct SavedGroup {
    environments: Vec<Environment>,
    targets: Vec<f64>,
    observations: Vec<f32>,
    worlds: Vec<Vec<u8>>,
}

impl Group {
    pub fn new(shared: &Shared, engines: &dyn Maker, first: usize, worlds: usize) -> Result<Self, EnvError> {
        Ok(Self {
            engine: engines.make(&shared.robot, &shared.ground, &shared.config, worlds)?,
            actuators: actuators(shared, first, worlds),
            environments: (0..worlds)
                .map(|w| Environment::new(shared, first + w))
                .collect::<Result<_, _>>()?,
            episodes: Vec::with_capacity(worlds),
            faults: Vec::with_capacity(worlds),
            scratch: Scratch::new(shared),
            poses: Poses::new(&shared.robot, worlds),
            truths: vec![None; worlds],
            observer: RowObserver::new(&shared.spec),
            clock: Clock::new(),
        })
    }

    /// Draws the actuators anew, for another seed; the group's first environment is number `first`.
    pub fn redraw(&mut self, shared: &Shared, first: usize) {
        self.actuators = actuators(shared, first, self.environments.len());
    }

    pub fn reset(&mut self, shared: &Shared, observations: &mut [f32]) {
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

    /// One step of a rollout.
    pub fn collect<C: Collect>(
        &mut self,
        shared: &Shared,
        factors: Factors,
        step: usize,
        collect: &C,
        rows: &mut Rows,
        part: &mut C::Part,
    ) {
        let actions = collect.act(part, step, rows.observations);
        self.step(shared, factors, step, actions, rows);
        collect.take(part, step, &Outcomes::new(rows, &self.faults));
        self.faults.clear();
    }

    /// The step number `step` of those that are done in one go.
    pub fn step(&mut self, shared: &Shared, factors: Factors, step: usize, actions: &[f32], rows: &mut Rows) {
        let Self {
            engine,
            actuators,
            environments,
            clock,
            ..
        } = self;
        let largest_push = factors.push * shared.config.push.force;
        clock.begin();
        let engine = &mut **engine;
        let actions = actions.chunks_exact(shared.spec.action_len());
        for (w, (environment, action)) in environments.iter_mut().zip(actions).enumerate() {
            environment.act(shared, engine, actuators, w, action, largest_push);
        }
        clock.lap(ACTIONS);
        let (dt, worlds) = (shared.config.physics_dt(), environments.len());
        for _ in 0..shared.config.substeps() {
            let drive = actuators.drive(engine.joints());
            clock.lap(DRIVES);
            engine.step(drive);
            clock.lap(ENGINE);
            actuators.sense(engine.joints());
            let loads = engine.foot_loads();
            for (w, environment) in environments.iter_mut().enumerate() {
                environment.forces(&loads[w..], worlds, dt);
            }
        }
        self.clock.lap(DRIVES);
        self.observe(shared, rows.observations);
        self.clock.lap(SENSING);
        self.judge(shared, factors, step, rows);
    }

    /// Reads the sensors of every world and writes the observations.
    fn observe(&mut self, shared: &Shared, observations: &mut [f32]) {
        self.poses.look(&mut *self.engine);
        for (w, (environment, truth)) in self.environments.iter_mut().zip(&mut self.truths).enumerate() {
            *truth = environment.sense(shared, &*self.engine, &self.actuators, w, &self.poses);
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
    fn judge(&mut self, shared: &Shared, factors: Factors, step: usize, rows: &mut Rows) {
        let n = shared.spec.observation_len();
        for (w, (environment, truth)) in self.environments.iter_mut().zip(&self.truths).enumerate() {
            let engine = &mut *self.engine;
            let row = &rows.observations[w * n..(w + 1) * n];
            let judged = sound(truth.as_ref(), row).and_then(|truth| {
                let outcome = environment.conclude_step(shared, engine, w, truth, factors, &self.poses);
                outcome
                    .terms
                    .not_finite()
                    .map_or(Ok(outcome), |term| Err(Fault::Reward(term)))
            });
            let outcome = judged.unwrap_or_else(|fault| {
                self.faults.push((environment.index(), fault));
                Outcome {
                    terms: Terms::default(),
                    end: Some(End::Lost),
                }
            });
            rows.terms[w] = outcome.terms;
            rows.ends[w] = outcome.end;
            if let Some(end) = outcome.end {
                let row = &mut rows.observations[w * n..(w + 1) * n];
                rows.final_observations[w * n..(w + 1) * n].copy_from_slice(row);
                self.clock.lap(REWARD);
                self.episodes.push((step, environment.conclude(end)));
                environment.reset(shared, engine, &mut self.actuators, w, &mut self.scratch, row);
                self.clock.lap(RESETS);
            }
        }
        self.clock.lap(REWARD);
    }

    /// Operations of a physics step with the drive of the last one, see [`lanes::operations`].
    pub fn operations(&self, shared: &Shared) -> Result<Vec<u64>, String> {
        lanes::operations(
            &shared.ground,
            &shared.robot,
            shared.config.physics_dt(),
            &*self.engine,
            self.actuators.last_drive(),
        )
    }

    pub fn save(&self, observations: &[f32]) -> SavedGroup {
        let worlds = (0..self.environments.len())
            .map(|w| {
                let mut bytes = Vec::new();
                self.engine.save(w, &mut bytes);
                bytes
            })
            .collect();
        SavedGroup {
            environments: self.environments.clone(),
            targets: self.actuators.save(),
            observations: observations.to_vec(),
            worlds,
        }
    }

    pub fn load(&mut self, saved: SavedGroup, observations: &mut [f32]) -> Result<(), EnvError> {
        let fits = saved.environments.len() == self.environments.len()
            && saved.worlds.len() == self.environments.len()
            && saved.observations.len() == observations.len();
        if !fits {
            return Err(EnvError::State(
                "another number of environments or another observation".into(),
            ));
        }
        let own = self.environments.iter();
        if !saved
            .environments
            .iter()
            .zip(own)
            .all(|(saved, own)| saved.has_shape_of(own))
        {
            return Err(EnvError::State("environments of another robot or configuration".into()));
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

/// The base's state, if it and the observation are finite.
fn sound<'a>(truth: Option<&'a Truth>, observation: &[f32]) -> Result<&'a Truth, Fault> {
    let truth = truth.ok_or(Fault::Physics)?;
    match observation.iter().position(|entry| !entry.is_finite()) {
        Some(entry) => Err(Fault::Observation(entry)),
        None => Ok(truth),
    }
}

/// The stream of an environment that is drawn from once, whatever the episode.
const ONCE: u64 = u64::MAX;

/// Actuators of `worlds` environments from number `first` on, each with its own draw of what the robot gives ranges for.
fn actuators(shared: &Shared, first: usize, worlds: usize) -> Actuators {
    let (robot, dt) = (&*shared.robot, shared.config.physics_dt());
    if robot.ranges.is_empty() || !shared.config.randomise.effects {
        return Actuators::new(robot, dt, worlds);
    }
    let drawn = |w: usize| robot.drawn(&mut Stream::new(shared.seed, (first + w) as u64, ONCE));
    let robots: Vec<Robot> = (0..worlds).map(drawn).collect();
    Actuators::of(&robots.iter().collect::<Vec<_>>(), dt)
}
