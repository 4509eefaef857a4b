//! Fused angles: orientation as yaw about the vertical, and roll and pitch read off the direction of gravity
//! (Allgeuer and Behnke, "Fused Angles: A Representation of Body Orientation for Balance", IROS 2015).
//!
//! An orientation is a turn by the *fused yaw* about the vertical after the smallest turn, the *tilt*, that leaves
//! the vertical where it is. The tilt says where "up" is in the base frame, `up = R^T e_z`:
//!
//! ```text
//! fused pitch = asin(-up_x)      fused roll = asin(up_y)      hemisphere = sign(up_z)
//! ```
//!
//! so for a base turned about x alone the fused roll is that angle, and about y alone the fused pitch. Two angles leave the
//! hemisphere open; a robot whose base is more than 90 degrees off has fallen, and functions that start from two angles
//! assume it is upright.

use libm::{asinf, atan2f, sqrt};

use crate::{
    math::{Quat, Vec3},
    number::Number,
};

/// Unit vector against gravity in the base frame for a base whose world orientation is `orientation` (unit
/// quaternion x, y, z, w).
pub fn up_from_orientation([x, y, z, w]: [f32; 4]) -> [f32; 3] {
    [
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        w * w + z * z - x * x - y * y,
    ]
}

/// Fused roll and pitch in rad, each in [-pi/2, pi/2], from the world orientation of the base (unit quaternion
/// x, y, z, w).
pub fn fused_from_orientation(orientation: [f32; 4]) -> [f32; 2] {
    fused_from_up(up_from_orientation(orientation))
}

/// Fused roll and pitch in rad from the unit vector against gravity in the base frame (a filtered accelerometer
/// reading at rest, normalised).
pub fn fused_from_up(up: [f32; 3]) -> [f32; 2] {
    [asinf(up[1].clamp(-1.0, 1.0)), asinf((-up[0]).clamp(-1.0, 1.0))]
}

/// Fused yaw in rad, in [-pi, pi]: the heading of the gravity-aligned base frame.
pub fn fused_yaw([_, _, z, w]: [f32; 4]) -> f32 {
    // q and -q are the same orientation; w >= 0 keeps twice the half angle within one turn.
    if w < 0.0 {
        2.0 * atan2f(-z, -w)
    } else {
        2.0 * atan2f(z, w)
    }
}

/// Unit vector against gravity in the base frame from fused roll and pitch, rad, in the upright hemisphere.
///
/// The two angles of an orientation satisfy `sin^2 roll + sin^2 pitch <= 1`; a noisy pair beyond that is moved to the
/// nearest direction that exists.
pub fn up_from_fused(fused: [f32; 2]) -> [f64; 3] {
    let [roll, pitch] = fused.map(f64::from);
    let (x, y) = (-Number::sin_cos(pitch).0, Number::sin_cos(roll).0);
    let horizontal = x * x + y * y;
    if horizontal <= 1.0 {
        [x, y, sqrt(1.0 - horizontal)]
    } else {
        let length = sqrt(horizontal);
        [x / length, y / length, 0.0]
    }
}

/// The tilt (unit quaternion x, y, z, w): the smallest turn that takes a vector from the base frame to the
/// gravity-aligned frame with the same heading. `up` is the unit vector against gravity in the base frame, `up_z > -1`.
pub fn tilt_from_up(up: [f64; 3]) -> [f64; 4] {
    // The half-angle quaternion (up x e_z, 1 + up . e_z), normalised: its squared length is 2 (1 + up_z).
    let length = sqrt((2.0 * (1.0 + up[2])).max(f64::MIN_POSITIVE));
    [up[1] / length, -up[0] / length, 0.0, (1.0 + up[2]) / length]
}

/// Rate of the fused yaw, rad/s, from the angular velocity in the base frame and the unit vector against gravity
/// there, `up_z > -1`.
///
/// With `q' = q (omega / 2)` and `yaw = 2 atan2(q_z, q_w)` follows
/// `yaw' = omega_z + (omega_x up_x + omega_y up_y) / (1 + up_z)`. Unlike `omega . up`, whose integral drifts when roll and pitch
/// swing out of phase, this is the derivative of an angle.
pub fn yaw_rate(gyro: [f64; 3], up: [f64; 3]) -> f64 {
    gyro[2] + (gyro[0] * up[0] + gyro[1] * up[1]) / (1.0 + up[2]).max(f64::EPSILON)
}

/// A vector of the base frame in the gravity-aligned frame with the same heading.
pub(crate) fn level(up: Vec3<f64>, v: Vec3<f64>) -> Vec3<f64> {
    let tilt: Quat<f64> = tilt_from_up(up);
    crate::math::rotate(tilt, v)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;
    use crate::math::{axis_angle, compose, rotate};
    use libm::sqrtf;

    fn orientation() -> impl Strategy<Value = [f32; 4]> {
        prop::array::uniform4(-1.0f32..1.0).prop_filter_map("too short", |q| {
            let length = sqrtf(q.iter().map(|x| x * x).sum());
            (length > 0.1).then(|| q.map(|x| x / length))
        })
    }

    #[test]
    fn a_turn_about_one_axis_is_that_fused_angle() {
        let angle = 0.3;
        let roll = fused_from_orientation(axis_angle([1.0, 0.0, 0.0], angle));
        let pitch = fused_from_orientation(axis_angle([0.0, 1.0, 0.0], angle));
        assert!((roll[0] - angle).abs() < 1e-6 && roll[1].abs() < 1e-6, "{roll:?}");
        assert!((pitch[1] - angle).abs() < 1e-6 && pitch[0].abs() < 1e-6, "{pitch:?}");
    }

    #[test]
    fn yaw_does_not_change_roll_and_pitch() {
        let tilted = compose(axis_angle([1.0, 0.0, 0.0], 0.4), axis_angle([0.0, 1.0, 0.0], -0.2));
        let turned = compose(axis_angle([0.0, 0.0, 1.0], 2.0), tilted);
        let (a, b) = (fused_from_orientation(tilted), fused_from_orientation(turned));
        assert!((a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6);
    }

    #[test]
    fn impossible_pairs_of_angles_become_a_horizontal_unit_vector() {
        let up = up_from_fused([1.2, -FRAC_PI_2]);
        assert_eq!(up[2], 0.0);
        assert!((up[0] * up[0] + up[1] * up[1] - 1.0).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn up_is_the_vertical_seen_from_the_base(q in orientation()) {
            let up = up_from_orientation(q);
            let world = rotate(q, up);
            prop_assert!(world[0].abs() < 1e-5 && world[1].abs() < 1e-5 && (world[2] - 1.0).abs() < 1e-5);
        }

        #[test]
        fn fused_angles_and_up_are_inverse_in_the_upright_hemisphere(q in orientation()) {
            let up = up_from_orientation(q);
            prop_assume!(up[2] > 0.05);
            let again = up_from_fused(fused_from_orientation(q)).map(|x| x as f32);
            for axis in 0..3 {
                prop_assert!((again[axis] - up[axis]).abs() < 1e-5, "{again:?} {up:?}");
            }
        }

        #[test]
        fn yaw_after_tilt_is_the_orientation(q in orientation()) {
            let up = up_from_orientation(q);
            prop_assume!(up[2] > -0.9);
            let again = compose(axis_angle([0.0, 0.0, 1.0], fused_yaw(q)), tilt_from_up(up.map(f64::from)).map(|x| x as f32));
            let dot: f32 = again.iter().zip(&q).map(|(a, b)| a * b).sum();
            prop_assert!(dot.abs() > 1.0 - 1e-5, "{again:?} {q:?}");
        }

        #[test]
        fn yaw_rate_is_the_derivative_of_fused_yaw(q in orientation(), gyro in prop::array::uniform3(-2.0f32..2.0)) {
            let up = up_from_orientation(q);
            prop_assume!(up[2] > -0.5 && fused_yaw(q).abs() < 3.0);
            let speed = sqrtf(gyro.iter().map(|x| x * x).sum()).max(1e-3);
            let axis = gyro.map(|x| x / speed);
            let step = 5e-3;
            let ahead = fused_yaw(compose(q, axis_angle(axis, speed * step)));
            let behind = fused_yaw(compose(q, axis_angle(axis, -speed * step)));
            prop_assert!(((ahead - behind) / (2.0 * step) - yaw_rate(gyro.map(f64::from), up.map(f64::from)) as f32).abs() < 5e-3);
        }
    }
}
