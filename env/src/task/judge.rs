//! How an environment judges and measures a control step.

use nalgebra::Vector3;

use super::environment::{Asked, Environment};
use super::reward::{Factors, Judged, Motion, Terms, foot_error};
use super::shared::Shared;
use crate::engine::Engine;
use crate::truth::Truth;

impl Environment {
    /// The reward of the control step that ended in `truth`.
    pub(super) fn judge(
        &mut self,
        shared: &Shared,
        engine: &dyn Engine,
        world: usize,
        truth: &Truth,
        alive: bool,
        factors: Factors,
    ) -> Terms {
        let config = &shared.config.reward;
        let dt = shared.config.control_dt();
        if config.commanded_heading && !self.pipeline.frame_was_set() {
            self.heading = turned(self.heading, self.asked.commanded[2] * dt);
        }
        let motion = Motion {
            base: [truth.velocity.x, truth.velocity.y],
            inertial: truth.velocity_along(self.heading),
            turn: truth.turn.z,
        };
        let gain = if config.velocity_filter > 0.0 {
            dt / (config.velocity_filter + dt)
        } else {
            1.0
        };
        self.motion.follow(&motion, gain);
        let (worlds, positions) = (engine.worlds(), &engine.joints().position);
        let squares = shared.pose_joints.iter().map(|&i| {
            let joint = &shared.joints[i];
            (positions[joint.dof * worlds + world] - joint.nominal).powi(2)
        });
        let pose_error = squares.sum::<f64>().sqrt();
        let foot_error = self.foot_error(shared);
        let judged = Judged {
            motion: &self.motion,
            commanded: self.asked.commanded,
            pose_error,
            alive,
            foot_error,
            action_change: self.action_change,
            slip: self.gait.slip_squared(),
            taps: self.gait.taps(),
        };
        judged.terms(config, factors, dt)
    }

    fn foot_error(&mut self, shared: &Shared) -> Option<f64> {
        let config = &shared.config.reward;
        let [left, right] = self.soles.as_slice() else {
            return None;
        };
        let share = if config.clock_swing {
            self.swing.by_clock(f64::from(self.pipeline.clock_phase()))
        } else {
            self.swing
                .by_height([left.centre[2], right.centre[2]], config.swing_hysteresis);
            1.0
        };
        let (swing, stance) = if self.swing.leg() == 0 {
            (left, right)
        } else {
            (right, left)
        };
        Some(foot_error(
            swing,
            stance,
            share * config.clearance,
            config.foot_height_weight,
        ))
    }

    /// Mean square of the change of the targets, in half ranges of the action.
    pub(super) fn target_change(&self, shared: &Shared) -> f64 {
        let pairs = self.targets.iter().zip(&self.previous_targets);
        let change = pairs.zip(&shared.spec.joints).map(|((new, old), joint)| {
            let share = f64::from((new - old) / joint.action_scale);
            share * share
        });
        change.sum::<f64>() / self.targets.len() as f64
    }

    /// Adds the step to the episode's measures.
    pub(super) fn measure_step(&mut self, shared: &Shared, engine: &dyn Engine, world: usize, truth: &Truth) {
        let Asked { commanded, desired } = self.asked;
        let reached = (0..3).all(|k| (commanded[k] - desired[k]).abs() < 1e-4);
        let [along, left] = truth.velocity_along(truth.heading);
        self.tracking
            .step([along, left, truth.vertical_turn], commanded, reached);
        let (_, estimate) = self.pipeline.velocity();
        let miss = Vector3::from(estimate.map(f64::from)) - truth.velocity;
        let (worlds, torques) = (engine.worlds(), &engine.joints().torque);
        let torque: f64 = shared
            .joints
            .iter()
            .map(|joint| torques[joint.dof * worlds + world].abs())
            .sum();
        let sums = &mut self.sums;
        sums.estimator_error += miss.norm();
        sums.torque += torque / shared.joints.len() as f64;
        sums.action_change += self.action_change;
        sums.position = [truth.position.x, truth.position.y];
    }
}

/// The direction (cosine, sine) turned by `angle`, rad.
fn turned([x, y]: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::engine::BaseState;

    #[test]
    fn a_robot_that_follows_a_turning_command_has_the_commanded_velocity_along_the_commanded_heading() {
        let (commanded, dt) = ([0.3, -0.2, 0.6], 0.025);
        let mut heading = [1.0, 0.0];
        for step in 1..=80 {
            heading = turned(heading, commanded[2] * dt);
            let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(step) * dt * commanded[2]);
            let truth = Truth::new(&BaseState {
                position: Vector3::zeros(),
                orientation: yaw,
                linear_velocity: yaw * Vector3::new(commanded[0], commanded[1], 0.0),
                angular_velocity: Vector3::new(0.0, 0.0, commanded[2]),
            });
            let [along, left] = truth.velocity_along(heading);
            assert!((along - 0.3).abs() < 1e-12 && (left + 0.2).abs() < 1e-12, "step {step}");
        }
    }
}
