//! Ground contact: forces as rapier solved them, and the torsional and rolling friction it does not have.
//!
//! Where a link presses on the ground with a normal force N, torsional friction is a torque about the normal of
//! at most `torsional * N`, rolling friction one about the tangents of at most `rolling * N`, against the link's
//! rotation (thesis 7.4). N is that of the last step. Below the limit the sole sticks: a spring and damper hold it where
//! it came to rest, as stiff as an explicit torque can be, with the inertia I that the link feels in the whole
//! robot: stiffness `I / (5 dt^2)`, damping `I / (2 dt)`. At the limit the resting place slides along. A bound by the
//! link's own inertia would be ten times softer: soles then creep round under the hip's torque and a policy that
//! turns its feet on the ground in one engine falls in the other.

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

/// Rotation of a sticking link away from where it came to rest, world axes, rad.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Stick(Vector3<f64>);

/// Shares of `I / dt^2` and `I / dt` that stiffness and damping of a sticking contact take. An explicit
/// spring-damper is stable while `stiffness dt^2 / I + 2 damping dt / I < 4`.
const STIFFNESS: f64 = 0.2;
const DAMPING: f64 = 0.5;

impl Stick {
    /// Torque of torsional and rolling friction on a link that turns with `angular_velocity` and feels `inertia`, world
    /// axes, N m.
    pub(super) fn torque(
        &mut self,
        angular_velocity: &Vector3<f64>,
        inertia: &Vector3<f64>,
        friction: &Friction,
        force: &GroundForce,
        dt: f64,
    ) -> Vector3<f64> {
        let normal_force = force.0.z.max(0.0);
        if normal_force == 0.0 {
            self.0 = Vector3::zeros();
            return Vector3::zeros();
        }
        self.0 += angular_velocity * dt;
        let roll = Vector3::new(1.0, 1.0, 0.0);
        // Rolling is isotropic: both axes feel the inertia of the more mobile one.
        let parts = [
            (Vector3::z(), inertia.z, friction.torsional),
            (roll, inertia.x.min(inertia.y), friction.rolling),
        ];
        let mut total = Vector3::zeros();
        for (mask, inertia, coefficient) in parts {
            let (stiffness, damping) = (STIFFNESS * inertia / (dt * dt), DAMPING * inertia / dt);
            let (angle, velocity) = (self.0.component_mul(&mask), angular_velocity.component_mul(&mask));
            let wanted = -(stiffness * angle + damping * velocity);
            let limit = coefficient * normal_force;
            if wanted.norm() <= limit {
                total += wanted;
                continue;
            }
            let torque = wanted * (limit / wanted.norm());
            total += torque;
            // Where the spring would have to rest to give just this torque.
            let rest = -(torque + damping * velocity) / stiffness;
            let reach = limit / stiffness;
            self.0 += rest.cap_magnitude(reach) - angle;
        }
        total
    }
}
