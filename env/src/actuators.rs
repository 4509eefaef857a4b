//! From joint targets to the engine's drive: gains, the torque-speed line, dry friction, and the effects a robot has
//! beyond them ([`crate::effect`]). Written once, for every engine.

use crate::effect::{JointDrive, Memory, Model, Told};
use crate::engine::{Drive, JointState};
use crate::robot::{Actuator, Kinematics, Robot};

/// The actuators of a batch of worlds. Arrays are structures of arrays, entry `d * worlds + w`.
pub struct Actuators {
    worlds: usize,
    /// Where there is a motor, in any world.
    motors: Vec<Option<Actuator>>,
    /// What motors have to give.
    motor_limit: Vec<f64>,
    /// The same, none where they are off.
    torque_limit: Vec<f64>,
    per_speed: Vec<f64>,
    drive: Drive,
    effects: Vec<JointEffects>,
    /// Where in `effects` an entry's are.
    places: Vec<Option<u32>>,
    /// Commanded torques.
    commanded: Vec<f64>,
    /// Torques from outside, where any were set.
    outside: Vec<f64>,
}

/// A joint of a world that has effects.
struct JointEffects {
    /// Entry of the arrays.
    k: usize,
    model: Model,
    memory: Memory,
    told: Told,
    powered: bool,
    /// What the encoder says now.
    reading: f64,
}

impl Actuators {
    /// Actuators of `robot` in `worlds` worlds at a physics step of `dt` s, holding the nominal pose.
    pub fn new(robot: &Robot, dt: f64, worlds: usize) -> Self {
        Self::of(&vec![robot; worlds], dt)
    }

    /// Actuators of robots that share their joints, one a world.
    pub fn of(robots: &[&Robot], dt: f64) -> Self {
        let worlds = robots.len();
        let dofs = robots.first().map_or(0, |robot| robot.dofs.len());
        let mut actuators = Self {
            worlds,
            motors: (0..dofs).map(|d| robots[0].dof(d).actuator).collect(),
            motor_limit: vec![0.0; dofs * worlds],
            torque_limit: vec![0.0; dofs * worlds],
            per_speed: vec![0.0; dofs * worlds],
            drive: Drive::idle(dofs, worlds),
            effects: Vec::new(),
            places: vec![None; dofs * worlds],
            commanded: vec![0.0; dofs * worlds],
            outside: Vec::new(),
        };
        for d in 0..dofs {
            for (w, robot) in robots.iter().enumerate() {
                actuators.prepare(robot, d, d * worlds + w, dt);
            }
        }
        actuators
    }

    fn prepare(&mut self, robot: &Robot, d: usize, k: usize, dt: f64) {
        let joint = robot.dof(d);
        self.drive.friction[k] = joint.passive.friction;
        self.drive.target[k] = joint.nominal;
        if let Some(motor) = joint.actuator {
            self.drive.stiffness[k] = motor.stiffness();
            self.drive.damping[k] = motor.kd;
            (self.motor_limit[k], self.torque_limit[k]) = (motor.torque_limit, motor.torque_limit);
            self.per_speed[k] = 1.0 / motor.speed_limit;
        }
        let own = robot.effects.iter().filter(|e| e.kind.runs() && e.target == d);
        // Effects are rare, and so are robots that differ: what a joint moves is found where it is asked for.
        if own.clone().next().is_none() {
            return;
        }
        let inertia = Kinematics::new(robot).moved_inertia(robot, d);
        let Some(model) = Model::new(joint, inertia, dt, own) else {
            return;
        };
        // Without a supply there is no torque at any speed.
        if model.supply() > 0.0 {
            self.per_speed[k] /= model.supply();
        }
        self.places[k] = Some(self.effects.len() as u32);
        self.effects.push(JointEffects {
            k,
            memory: model.memory((joint.nominal, 0.0), joint.nominal, 0.0),
            told: Told {
                target: joint.nominal,
                stiffness: self.drive.stiffness[k],
                damping: self.drive.damping[k],
                torque: 0.0,
                effort: false,
            },
            powered: joint.actuator.is_some(),
            reading: joint.nominal,
            model,
        });
    }

    fn effects(&self, k: usize) -> Option<&JointEffects> {
        self.places[k].map(|place| &self.effects[place as usize])
    }

    fn effects_mut(&mut self, k: usize) -> Option<&mut JointEffects> {
        self.places[k].map(|place| &mut self.effects[place as usize])
    }

    /// Starts an episode: degree of freedom `d` of `world` is at `state` (position and velocity, rad and rad/s or m and m/s) and
    /// has had the target `target`, rad or m.
    pub fn start(&mut self, d: usize, world: usize, state: (f64, f64), target: f64) {
        let k = d * self.worlds + world;
        self.drive.target[k] = target;
        if let Some(effects) = self.effects_mut(k) {
            effects.told.target = target;
            effects.memory = effects.model.memory(state, target, target - state.0);
            effects.reading = effects.model.read(&mut effects.memory, state.0);
        }
    }

    /// Says that degree of freedom `d` of `world`, which was started, is `time` (s) behind the start of its log.
    pub fn set_time(&mut self, d: usize, world: usize, time: f64) {
        let k = d * self.worlds + world;
        if let Some(effects) = self.effects_mut(k) {
            effects.memory.set_time(time);
        }
    }

    /// Gives degree of freedom `d` of `world`, which was started, a past: `past(age)` says what was commanded (target in rad or
    /// m, effort in N m or N) and where the joint was (rad or m) `age` physics steps before its first step, at most `known`.
    /// Delays and rate limits look back.
    pub fn recall(&mut self, d: usize, world: usize, effort: bool, known: usize, past: impl Fn(usize) -> (f64, f64)) {
        let k = d * self.worlds + world;
        if let Some(effects) = self.effects_mut(k) {
            effects.told.effort = effort;
            effects.model.recall(&mut effects.memory, known, past);
            effects.reading = effects.model.delayed_reading(&effects.memory);
        }
    }

    /// Sets the target of degree of freedom `d` in `world`, rad or m.
    pub fn set_target(&mut self, d: usize, world: usize, target: f64) {
        let k = d * self.worlds + world;
        self.drive.target[k] = target;
        if let Some(effects) = self.effects_mut(k) {
            effects.told.target = target;
        }
    }

    /// Commands a torque (N m or N) instead of a position, within the torque limits.
    pub fn set_torque(&mut self, d: usize, world: usize, torque: f64) {
        let k = d * self.worlds + world;
        (self.drive.stiffness[k], self.drive.damping[k]) = (0.0, 0.0);
        (self.drive.feed_forward[k], self.commanded[k]) = (torque, torque);
        if let Some(effects) = self.effects_mut(k) {
            // A delay begins with the first torque that was commanded.
            if !effects.told.effort {
                let time = effects.memory.time();
                effects.memory = effects.model.memory(effects.memory.state(), torque, torque);
                effects.memory.set_time(time);
            }
            effects.told = Told {
                target: effects.told.target,
                stiffness: 0.0,
                damping: 0.0,
                torque,
                effort: true,
            };
        }
    }

    /// Switches the motor of degree of freedom `d` in `world` on or off; where it is off, only passive torques act.
    pub fn set_power(&mut self, d: usize, world: usize, on: bool) {
        let k = d * self.worlds + world;
        self.torque_limit[k] = if on { self.motor_limit[k] } else { 0.0 };
    }

    /// Sets a torque (N m or N) that acts on degree of freedom `d` in `world` from outside, whatever the motor does.
    pub fn set_outside(&mut self, d: usize, world: usize, torque: f64) {
        if self.outside.is_empty() {
            self.outside = vec![0.0; self.drive.target.len()];
        }
        let k = d * self.worlds + world;
        self.outside[k] = torque;
    }

    /// Target of degree of freedom `d` in `world`, rad or m.
    pub fn target(&self, d: usize, world: usize) -> f64 {
        let k = d * self.worlds + world;
        self.effects(k)
            .map_or(self.drive.target[k], |effects| effects.told.target)
    }

    /// What the encoders say: `positions` seen through the sensors' effects.
    pub fn read(&self, d: usize, world: usize, positions: &[f64]) -> f64 {
        let k = d * self.worlds + world;
        self.effects(k).map_or(positions[k], |effects| effects.reading)
    }

    /// Torque of the motor in the last step, N m or N: that of the engine's drive unless effects come between.
    pub fn motor_torque(&self, d: usize, world: usize, joints: &JointState) -> f64 {
        let k = d * self.worlds + world;
        self.effects(k)
            .map_or(joints.torque[k], |effects| effects.memory.motor_torque())
    }

    /// Everything the actuators remember: the targets, then what effects do.
    pub fn save(&self) -> Vec<f64> {
        let mut saved = self.drive.target.clone();
        for effects in &self.effects {
            saved.extend([effects.told.target, effects.reading]);
            saved.extend(effects.memory.clone().numbers().map(|x| *x));
        }
        saved
    }

    /// Restores [`Actuators::save`].
    ///
    /// # Errors
    /// A message when their number is another.
    pub fn restore(&mut self, saved: &[f64]) -> Result<(), String> {
        let expected = self.save().len();
        if saved.len() != expected {
            return Err(format!("{} numbers of the actuators, not {expected}", saved.len()));
        }
        let (targets, rest) = saved.split_at(self.drive.target.len());
        self.drive.target.copy_from_slice(targets);
        let mut rest = rest.iter();
        for effects in &mut self.effects {
            let own = [&mut effects.told.target, &mut effects.reading];
            for (to, from) in own.into_iter().chain(effects.memory.numbers()).zip(&mut rest) {
                *to = *from;
            }
        }
        Ok(())
    }

    /// The drive for the next physics step: torque limits follow the torque-speed line at the present speed.
    ///
    /// In the direction of motion the available torque falls linearly to zero at the no-load speed; against it the
    /// full torque is there.
    pub fn drive(&mut self, joints: &JointState) -> &Drive {
        let worlds = self.worlds;
        for d in 0..self.motors.len() {
            if self.motors[d].is_none() {
                continue;
            }
            let range = d * worlds..(d + 1) * worlds;
            let upper = &mut self.drive.torque_max[range.clone()];
            let lower = &mut self.drive.torque_min[range.clone()];
            let limits = self.torque_limit[range.clone()]
                .iter()
                .zip(&self.per_speed[range.clone()]);
            for (((upper, lower), &speed), (limit, per_speed)) in
                upper.iter_mut().zip(lower).zip(&joints.velocity[range]).zip(limits)
            {
                let share = speed * per_speed;
                *upper = limit * (1.0 - share).clamp(0.0, 1.0);
                *lower = -limit * (1.0 + share).clamp(0.0, 1.0);
            }
        }
        self.run_effects(joints);
        let plain = |(k, _): &(usize, &f64)| self.places[*k].is_none();
        for (k, &torque) in self.outside.iter().enumerate().filter(plain) {
            // A joint without a motor has no clamp that is set anew in every step.
            let motor = f64::from(u8::from(self.motors[k / worlds].is_some()));
            self.drive.feed_forward[k] = self.commanded[k] + torque;
            self.drive.torque_min[k] = motor * self.drive.torque_min[k] + torque;
            self.drive.torque_max[k] = motor * self.drive.torque_max[k] + torque;
        }
        &self.drive
    }

    /// What [`Actuators::drive`] gave last.
    pub fn last_drive(&self) -> &Drive {
        &self.drive
    }

    fn run_effects(&mut self, joints: &JointState) {
        let drive = &mut self.drive;
        for effects in &mut self.effects {
            let k = effects.k;
            let mut own = JointDrive {
                target: &mut drive.target[k],
                stiffness: &mut drive.stiffness[k],
                damping: &mut drive.damping[k],
                feed_forward: &mut drive.feed_forward[k],
                torque_min: &mut drive.torque_min[k],
                torque_max: &mut drive.torque_max[k],
                friction: &mut drive.friction[k],
            };
            let state = (joints.position[k], joints.velocity[k], joints.torque[k]);
            let JointEffects {
                model,
                memory,
                told,
                powered,
                ..
            } = effects;
            if !*powered {
                (*own.torque_min, *own.torque_max) = (0.0, 0.0);
            }
            let outside = self.outside.get(k).copied().unwrap_or_default();
            model.step(memory, &mut own, told, outside, state);
        }
    }

    /// After a physics step: what lies between motor and joint is moved, and encoders with effects are read.
    pub fn sense(&mut self, joints: &JointState) {
        for effects in &mut self.effects {
            let k = effects.k;
            let state = (joints.position[k], joints.velocity[k], joints.torque[k]);
            effects.reading = effects.model.finish(&mut effects.memory, state);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// A pendulum whose motor gives at most `torque_limit` N m.
    fn robot(torque_limit: f64) -> Robot {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/pendulum");
        let mut robot = crate::robot::load(&folder).unwrap_or_else(|error| panic!("{error}"));
        robot.joints[0].actuator = Some(Actuator {
            kp: 1.0,
            kp_scale: 1.0,
            kd: 0.0,
            torque_limit,
            speed_limit: 4.0,
        });
        robot
    }

    fn moving(speeds: &[f64]) -> JointState {
        JointState {
            position: vec![0.0; speeds.len()],
            velocity: speeds.to_vec(),
            torque: vec![0.0; speeds.len()],
        }
    }

    #[test]
    fn a_motor_that_is_switched_on_has_the_limit_of_its_own_robot() {
        let robots = [10.0, 7.0].map(robot);
        let mut actuators = Actuators::of(&robots.each_ref(), 0.005);
        for on in [true, false, true] {
            (0..2).for_each(|w| actuators.set_power(0, w, on));
            let limits = if on { [10.0, 7.0] } else { [0.0; 2] };
            assert_eq!(actuators.drive(&moving(&[0.0; 2])).torque_max, limits);
        }
    }

    #[test]
    fn torque_falls_to_zero_at_the_no_load_speed_in_the_direction_of_motion_only() {
        let mut actuators = Actuators::new(&robot(10.0), 0.005, 1);
        // Speed, rad/s, and the torques that are left at it, N m.
        for (speed, lower, upper) in [
            (0.0, -10.0, 10.0),
            (1.0, -10.0, 7.5),
            (4.0, -10.0, 0.0),
            (6.0, -10.0, 0.0),
            (-1.0, -7.5, 10.0),
            (-3.0, -2.5, 10.0),
            (-9.0, 0.0, 10.0),
        ] {
            let drive = actuators.drive(&moving(&[speed]));
            assert_eq!(
                (drive.torque_min[0], drive.torque_max[0]),
                (lower, upper),
                "at {speed} rad/s"
            );
        }
    }
}
