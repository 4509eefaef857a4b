//! The true motion of a robot's base in the frames that sensors and task look at it in.

use nalgebra::Vector3;

use crate::engine::BaseState;

/// A base at the end of a control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Position of the base link's frame in the world, m.
    pub position: Vector3<f64>,
    /// Velocity of the base link's origin in the base frame, m/s.
    pub velocity: Vector3<f64>,
    /// The same in the world frame, m/s.
    pub world_velocity: Vector3<f64>,
    /// Angular velocity in the base frame, rad/s.
    pub turn: Vector3<f64>,
    /// Angular velocity about the vertical, rad/s.
    pub vertical_turn: f64,
    /// Unit vector against gravity in the base frame.
    pub up: Vector3<f64>,
    /// The heading: direction of the base's x axis in the horizontal plane, a unit vector.
    pub heading: [f64; 2],
}

impl Truth {
    /// Of a base in the state `base`.
    pub fn new(base: &BaseState) -> Self {
        let rotation = base.orientation.to_rotation_matrix();
        let (x, y) = (rotation[(0, 0)], rotation[(1, 0)]);
        let length = (x * x + y * y).sqrt();
        Self {
            position: base.position,
            velocity: rotation.inverse_transform_vector(&base.linear_velocity),
            world_velocity: base.linear_velocity,
            turn: rotation.inverse_transform_vector(&base.angular_velocity),
            vertical_turn: base.angular_velocity.z,
            up: rotation.matrix().row(2).transpose(),
            // Where the x axis is vertical any heading is as good.
            heading: if length > 0.0 {
                [x / length, y / length]
            } else {
                [1.0, 0.0]
            },
        }
    }

    /// The base's velocity seen along the horizontal unit vector `heading` and to its left, m/s.
    pub fn velocity_along(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let v = &self.world_velocity;
        [x * v.x + y * v.y, x * v.y - y * v.x]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    #[test]
    fn a_robot_that_walks_sideways_with_a_heading_and_a_tilt_is_seen_so() {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5);
        let tilt = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.2);
        let base = BaseState {
            position: Vector3::new(1.0, 2.0, 0.7),
            orientation: yaw * tilt,
            linear_velocity: yaw * Vector3::new(0.0, 0.3, 0.0),
            angular_velocity: Vector3::new(0.0, 0.0, 0.4),
        };
        let truth = Truth::new(&base);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} {b}");
        close(truth.heading[0], 0.5_f64.cos());
        close(truth.heading[1], 0.5_f64.sin());
        let [along, left] = truth.velocity_along(truth.heading);
        close(along, 0.0);
        close(left, 0.3);
        close(truth.velocity.y, 0.3);
        close(truth.turn.x, -0.4 * 0.2_f64.sin());
        close(truth.turn.z, 0.4 * 0.2_f64.cos());
        close(truth.up.x, -0.2_f64.sin());
        close(truth.up.z, 0.2_f64.cos());
    }
}
