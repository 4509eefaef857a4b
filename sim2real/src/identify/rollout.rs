//! Whole logs through actuators and engine at 1 kHz, many candidate robots side by side in SIMD lanes.

use omniwalk_env::actuators::Actuators;
use omniwalk_env::effect::{Effect, Kind, decoder};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::{Engine, EngineError, Friction, Start, World};
use omniwalk_env::robot::Robot;

use super::starts;
use super::trial::{DT, LEAD, Trial, steps};

/// Friction of the ground: what is walked on is not measured, and nothing of a fixed base touches it.
pub const GROUND: Friction = Friction {
    tangential: 1.0,
    torsional: 0.01,
    rolling: 0.001,
};

/// The widest lane type in double precision that this processor has: finite differences need its digits.
pub fn level() -> Simd {
    [Simd::F64x8, Simd::F64x4, Simd::Scalar]
        .into_iter()
        .find(|level| level.is_available())
        .unwrap_or(Simd::Scalar)
}

/// Worlds of one robot each, at a trial's start.
pub struct Rollout<'a> {
    trial: &'a Trial,
    engine: Box<dyn Engine>,
    actuators: Actuators,
    worlds: usize,
    dofs: usize,
}

impl<'a> Rollout<'a> {
    /// `robots` at the start of `trial`; they share their joints.
    ///
    /// # Errors
    /// When an engine does not take the robot.
    pub fn new(trial: &'a Trial, robots: &[Robot], dt: f64) -> Result<Self, EngineError> {
        let shifts = vec![trial.shift.clone(); robots.len()];
        Self::shifted(trial, robots, dt, &shifts)
    }

    /// The same from starts of which each is moved by its own of `shifts`; by nothing where the base is held.
    ///
    /// # Errors
    /// As [`Rollout::new`].
    pub fn shifted(trial: &'a Trial, robots: &[Robot], dt: f64, shifts: &[Vec<f64>]) -> Result<Self, EngineError> {
        let engine = Lanes::new(&robots[0], dt, robots.len(), level())?;
        Ok(Self::on((Box::new(engine), GROUND), trial, robots, dt, shifts))
    }

    /// The same in any engine, of as many worlds as there are robots, on any ground.
    pub fn on(
        (mut engine, ground): (Box<dyn Engine>, Friction),
        trial: &'a Trial,
        robots: &[Robot],
        dt: f64,
        shifts: &[Vec<f64>],
    ) -> Self {
        let worlds = robots.len();
        let own: Vec<&Robot> = robots.iter().collect();
        let mut actuators = Actuators::of(&own, dt);
        let dofs = robots[0].dofs.len();
        for (w, robot) in robots.iter().enumerate() {
            let mut start = Start::nominal(robot);
            // Found once: the past of a joint has as many readings as there are steps before the start.
            let encoders: Vec<_> = (0..dofs).map(|d| (lateness(robot, d), decoder(robot, d))).collect();
            for (d, (states, (late, position))) in trial.initial.iter().zip(&encoders).enumerate() {
                let (reading, velocity) = states[trial.begin() + late];
                start.joints[d] = position(reading);
                start.joint_velocities[d] = velocity;
            }
            if let Some(base) = &trial.base {
                let base = starts::inclined(base, &shifts[w]);
                starts::moved(&mut start, &shifts[w], |start| base.place(robot, start));
            }
            engine.reset(w, &start, &World::nominal(robot, ground));
            for (d, told) in trial.told.iter().enumerate() {
                let target = if told.effort { start.joints[d] } else { told.command[0] };
                actuators.start(d, w, (start.joints[d], start.joint_velocities[d]), target);
                let (late, position) = &encoders[d];
                let past = |age: usize| {
                    let age = (age as f64 * dt / DT).round() as usize;
                    let told = told.past[age.clamp(1, told.past.len()) - 1];
                    let (reading, _) = trial.initial[d][trial.begin() + late - age];
                    (told, position(reading))
                };
                let known = (LEAD / dt).round() as usize;
                actuators.recall(d, w, told.effort, known, past);
                actuators.set_time(d, w, trial.start);
            }
        }
        Self {
            trial,
            engine,
            actuators,
            worlds,
            dofs,
        }
    }

    /// Gives every joint its command for the next step of the trial.
    pub fn command(&mut self, step: usize) {
        for (d, told) in self.trial.told.iter().enumerate() {
            let switched = step == 0 || told.enabled[step] != told.enabled[step - 1];
            for w in 0..self.worlds {
                if told.effort {
                    self.actuators.set_torque(d, w, told.command[step]);
                } else {
                    self.actuators.set_target(d, w, told.command[step]);
                }
                if switched {
                    self.actuators.set_power(d, w, told.enabled[step]);
                }
            }
        }
    }

    /// One physics step.
    pub fn advance(&mut self) {
        self.engine.step(self.actuators.drive(self.engine.joints()));
        self.actuators.sense(self.engine.joints());
    }

    /// What the encoders say now, entry `d * worlds + w`.
    pub fn read(&self, into: &mut [f64]) {
        let positions = &self.engine.joints().position;
        for d in 0..self.dofs {
            for w in 0..self.worlds {
                into[d * self.worlds + w] = self.actuators.read(d, w, positions);
            }
        }
    }

    /// The engine and the actuators.
    pub fn parts(&mut self) -> (&dyn Engine, &mut Actuators) {
        (&*self.engine, &mut self.actuators)
    }
}

/// Steps of a millisecond by which readings of degree of freedom `d` are late, as far as the start can know.
fn lateness(robot: &Robot, d: usize) -> usize {
    let own = |effect: &&Effect| effect.kind == Kind::SensorDelay && effect.target == d;
    let delay = robot.effects.iter().find(own).map_or(0.0, |effect| effect.values[0]);
    steps(delay.min(LEAD))
}

/// What the encoders of every robot said at every reading of `trial`, at `finer` physics steps a millisecond: entry
/// `reading * robots + w`. Not finite where a simulation broke.
///
/// # Errors
/// When an engine does not take the robot.
pub fn predict(trial: &Trial, robots: &[Robot], finer: usize) -> Result<Vec<f64>, EngineError> {
    Ok(follow(trial, Rollout::new(trial, robots, DT / finer as f64)?, finer))
}

/// What the encoders say at every reading of `trial` while `rollout` follows it.
pub fn follow(trial: &Trial, mut rollout: Rollout<'_>, finer: usize) -> Vec<f64> {
    let worlds = rollout.worlds;
    let size = rollout.dofs * worlds;
    let (mut before, mut now) = (vec![0.0; size], vec![0.0; size]);
    let mut out = vec![0.0; trial.readings.len() * worlds];
    let mut next = 0;
    rollout.read(&mut now);
    for step in 0..trial.steps {
        std::mem::swap(&mut before, &mut now);
        rollout.command(step);
        for _ in 0..finer {
            rollout.advance();
        }
        rollout.read(&mut now);
        while let Some(reading) = trial.readings.get(next).filter(|r| r.at <= (step + 1) as f64) {
            let share = (reading.at - step as f64).max(0.0);
            let row = reading.dof * worlds..(reading.dof + 1) * worlds;
            let between = before[row.clone()].iter().zip(&now[row]);
            for (out, (a, b)) in out[next * worlds..].iter_mut().zip(between) {
                *out = a + share * (b - a);
            }
            next += 1;
        }
    }
    for w in (0..worlds).filter(|&w| !rollout.engine.is_finite(w)) {
        out.iter_mut().skip(w).step_by(worlds).for_each(|x| *x = f64::NAN);
    }
    out
}
