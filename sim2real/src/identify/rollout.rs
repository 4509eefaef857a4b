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
                let target = if told.effort {
                    start.joints[d]
                } else {
                    told.command.mean[0]
                };
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

    /// The next step of the trial, in so many physics steps.
    pub fn step(&mut self, step: usize, finer: usize) {
        let mut told = self.trial.told.iter();
        let parts = if told.any(|told| told.command.switches_within(step)) {
            finer
        } else {
            1
        };
        for part in 0..finer {
            if part < parts {
                self.command(step, part, parts);
            }
            self.advance();
        }
    }

    /// Gives every joint its command for part `part` of `parts` of the next step of the trial.
    pub fn command(&mut self, step: usize, part: usize, parts: usize) {
        for (d, told) in self.trial.told.iter().enumerate() {
            let switched = part == 0 && (step == 0 || told.enabled[step] != told.enabled[step - 1]);
            let command = told.command.over(step, part, parts);
            for w in 0..self.worlds {
                if told.effort {
                    self.actuators.set_torque(d, w, command);
                } else {
                    self.actuators.set_target(d, w, command);
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
        rollout.step(step, finer);
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

#[cfg(test)]
mod tests {
    use super::super::cut::{self, Lengths};
    use super::super::hinge::robot;
    use super::*;
    use crate::recording::{JointRecord, Recording, Series};

    /// A joint at rest that is told to jump every tenth of a second and a bit, farther than its torque limit takes it at once.
    fn jumps() -> JointRecord {
        let at = |k: i32| 0.1037 * f64::from(k);
        let still: Vec<f64> = (0..1000).map(|k| 5e-3 * f64::from(k)).collect();
        JointRecord {
            name: "hinge".into(),
            command: Series {
                time: (2..45).map(at).collect(),
                value: (2..45).map(|k| if k % 2 == 0 { 0.4 } else { -0.3 }).collect(),
            },
            position: Series {
                value: vec![0.4; still.len()],
                time: still,
            },
            ..JointRecord::default()
        }
    }

    #[test]
    fn predictions_converge_with_the_physics_step_where_commands_come_within_a_millisecond() {
        let robot = robot("kp = 30.0\nkd = 1.0\ntorque_limit = 2.0\nspeed_limit = 50.0\n");
        let log = Recording {
            name: "log".into(),
            joints: vec![jumps()],
            ..Recording::default()
        };
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let trial = cut::cut(&robot, &log, 0, (0.0, f64::INFINITY), lengths)
            .expect("trials")
            .swap_remove(0);
        let told = |finer| predict(&trial, std::slice::from_ref(&robot), finer).expect("a rollout");
        let best = told(64);
        let off = |finer: usize| {
            let squares = told(finer).iter().zip(&best).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            (squares / best.len() as f64).sqrt()
        };
        let [one, four, sixteen] = [1, 4, 16].map(off);
        assert!(
            four < 0.4 * one && sixteen < 0.4 * four,
            "{one:e}, {four:e}, {sixteen:e}"
        );
    }

    #[test]
    fn the_parts_of_a_step_have_the_mean_of_its_commands() {
        let log = jumps();
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        let log = Recording {
            name: "log".into(),
            joints: vec![log],
            ..Recording::default()
        };
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let trial = &cut::cut(&robot, &log, 0, (0.0, f64::INFINITY), lengths).expect("trials")[0];
        let command = &trial.told[0].command;
        let switching = command.given.iter().filter(|(at, _)| at.fract() > 0.3).count();
        assert!(switching > 5);
        for step in 0..trial.steps {
            let parts = (0..16).map(|part| command.over(step, part, 16)).sum::<f64>() / 16.0;
            assert!((parts - command.over(step, 0, 1)).abs() < 1e-9, "step {step}");
        }
    }
}
