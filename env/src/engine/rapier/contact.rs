//! Ground contact: forces as rapier solved them, and the torsional and rolling friction it does not have.
//!
//! Where a link presses on the ground with a normal force N, torsional friction is a torque about the normal of
//! at most `torsional * N`, rolling friction one about the tangents of at most `rolling * N`, against the link's
//! angular velocity (thesis 7.4). N is that of the last step. Neither may turn the rotation round within a step:
//! a torque on a link changes its angular velocity by at most what it would change the free link's, so
//! `|w| / (dt n' I^-1 n)` with the link's own inertia is a safe bound.

use nalgebra::Vector3;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

use super::convert;
use super::scene::{State, Toucher};
use crate::engine::Friction;

/// Force of the ground on a link, averaged over the last step, world frame, N.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct GroundForce(pub Vector3<f64>);

/// The ground's force on `toucher` in the last step.
pub(super) fn ground_force(state: &State, toucher: &Toucher, dt: f64) -> GroundForce {
    let mut impulse = Vector::ZERO;
    for &collider in &toucher.colliders {
        for pair in state.narrow_phase.contact_pairs_with(collider) {
            let side = if pair.collider1 == collider { -1.0 } else { 1.0 };
            for manifold in pair.solver_manifolds() {
                for point in &manifold.points {
                    impulse += side * (point.data.impulse * manifold.data.normal - point.data.warmstart_tangent_world);
                }
            }
        }
    }
    GroundForce(convert::from_vector(impulse) / dt)
}

/// Torque of torsional and rolling friction on a body turning with `angular_velocity`, world frame, N m.
pub(super) fn spin_friction(
    body: &RigidBody,
    angular_velocity: &Vector3<f64>,
    friction: &Friction,
    force: &GroundForce,
    dt: f64,
) -> Vector3<f64> {
    let normal_force = force.0.z.max(0.0);
    let spin = Vector3::z() * angular_velocity.z;
    let roll = angular_velocity - spin;
    brake(body, &spin, friction.torsional * normal_force, dt) + brake(body, &roll, friction.rolling * normal_force, dt)
}

/// A torque of at most `limit` against `velocity` that does not reverse it within `dt`.
fn brake(body: &RigidBody, velocity: &Vector3<f64>, limit: f64, dt: f64) -> Vector3<f64> {
    let speed = velocity.norm();
    if speed == 0.0 || limit == 0.0 {
        return Vector3::zeros();
    }
    let axis = velocity / speed;
    let inverse = body.mass_properties().effective_world_inv_inertia;
    let response = axis.dot(&convert::from_vector(inverse * convert::vector(&axis)));
    axis * -limit.min(speed / (dt * response))
}
