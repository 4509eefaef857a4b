//! From joint targets to the engine's drive: gains, the torque-speed line, dry friction and the response of
//! each joint in this episode. Written once, for every engine.

use crate::engine::{Drive, JointState};
use crate::robot::{Actuator, Robot};

/// The actuators of a batch of worlds. Arrays are structures of arrays, entry `d * worlds + w`.
pub struct Actuators {
    worlds: usize,
    motors: Vec<Option<Actuator>>,
    drive: Drive,
}

impl Actuators {
    /// Actuators of `robot` in `worlds` worlds, holding the nominal pose.
    pub fn new(robot: &Robot, worlds: usize) -> Self {
        let dofs = robot.dofs.len();
        let mut drive = Drive::idle(dofs, worlds);
        let motors: Vec<_> = (0..dofs).map(|d| robot.dof(d).actuator).collect();
        for (d, motor) in motors.iter().enumerate() {
            for k in d * worlds..(d + 1) * worlds {
                drive.friction[k] = robot.dof(d).passive.friction;
                drive.target[k] = robot.dof(d).nominal;
                if let Some(motor) = motor {
                    drive.stiffness[k] = motor.kp;
                    drive.damping[k] = motor.kd;
                }
            }
        }
        Self { worlds, motors, drive }
    }

    /// Sets the target of degree of freedom `d` in `world`, rad or m.
    pub fn set_target(&mut self, d: usize, world: usize, target: f64) {
        self.drive.target[d * self.worlds + world] = target;
    }

    /// Target of degree of freedom `d` in `world`, rad or m.
    pub fn target(&self, d: usize, world: usize) -> f64 {
        self.drive.target[d * self.worlds + world]
    }

    /// Targets of all degrees of freedom in all worlds.
    pub fn targets(&self) -> &[f64] {
        &self.drive.target
    }

    /// Restores [`Actuators::targets`].
    ///
    /// # Errors
    /// A message when their number is another.
    pub fn restore(&mut self, targets: &[f64]) -> Result<(), String> {
        if targets.len() != self.drive.target.len() {
            return Err(format!(
                "{} joint targets, not {}",
                targets.len(),
                self.drive.target.len()
            ));
        }
        self.drive.target.copy_from_slice(targets);
        Ok(())
    }

    /// The drive for the next physics step: torque limits follow the torque-speed line at the present speed.
    ///
    /// In the direction of motion the available torque falls linearly to zero at the no-load speed; against it the
    /// full torque is there.
    pub fn drive(&mut self, joints: &JointState) -> &Drive {
        let worlds = self.worlds;
        for (d, motor) in self.motors.iter().enumerate() {
            let Some(motor) = motor else { continue };
            let range = d * worlds..(d + 1) * worlds;
            let upper = &mut self.drive.torque_max[range.clone()];
            let lower = &mut self.drive.torque_min[range.clone()];
            let per_speed = 1.0 / motor.speed_limit;
            for ((upper, lower), &speed) in upper.iter_mut().zip(lower).zip(&joints.velocity[range]) {
                let share = speed * per_speed;
                *upper = motor.torque_limit * (1.0 - share).clamp(0.0, 1.0);
                *lower = -motor.torque_limit * (1.0 + share).clamp(0.0, 1.0);
            }
        }
        &self.drive
    }
}
