//! Ground contact: forces as rapier solved them, and the torsional and rolling friction it does not have.
//!
//! Where a link presses on the ground with a normal force N, torsional friction is a torque about the normal of
//! at most `torsional * N`, rolling friction one about the tangents of at most `rolling * N`, against the link's
//! rotation (thesis 7.4). N is that of the last step. Unlike MuJoCo's elliptic cone and the engine `lanes`, each torque
//! has a clamp of its own, not one cone shared with the tangential force, and is one for the whole link, not a sum over
//! points.
//!
//! - **Torsion** sticks below its limit: a spring and damper hold the sole where it came to rest, as stiff as an explicit
//!   torque can be, with the inertia I that the link feels in the whole robot: stiffness `I / (5 dt^2)`, damping
//!   `I / (2 dt)`. At the limit the resting place slides along. A bound by the link's own inertia is ten times softer: soles
//!   creep round under the hip's torque, and policies from `lanes` fall.
//! - **Rolling** is a brake that may stop the link's rotation within a step but not turn it round, with the inertia the link
//!   feels in the whole robot about the horizontal axis that turns most easily: below its limit the link creeps by
//!   `torque dt / I`. With the foot's own inertia alone the brake is too weak to be rolling friction, and feet roll over
//!   their edges. A spring here would hold a sole tilted as it touched down: near-rigid impacts make N, and with it the limit,
//!   ten times the weight for a step.

use nalgebra::Vector3;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

use super::convert;
use super::inertia::Turning;
use super::scene::State;
use super::shapes::Toucher;
use crate::engine::Friction;

/// Force of the ground on a link, averaged over the last step, world frame, N.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct GroundForce(pub Vector3<f64>);

/// The ground's force on `toucher` in the last step: of the points that the solver saw. It takes four of a manifold, and on a height
/// field there are more; the others keep the impulse of the step in which they were last taken.
pub(super) fn ground_force(state: &State, toucher: &Toucher, dt: f64) -> GroundForce {
    let mut impulse = Vector::ZERO;
    for &collider in &toucher.colliders {
        for pair in state.narrow_phase.contact_pairs_with(collider) {
            let side = if pair.collider1 == collider { -1.0 } else { 1.0 };
            for manifold in pair.solver_manifolds() {
                for contact in &manifold.data.solver_contacts {
                    let [id] = contact.contact_indices();
                    let point = &manifold.points[id as usize];
                    impulse += side * (point.data.impulse * manifold.data.normal - point.data.warmstart_tangent_world);
                }
            }
        }
    }
    GroundForce(convert::from_vector(impulse) / dt)
}

/// How a link touches the ground.
pub(super) struct Touch<'a> {
    pub friction: &'a Friction,
    pub force: &'a GroundForce,
    /// The ground's normal there.
    pub normal: Vector3<f64>,
}

/// Rotation of a sticking link about the ground's normal away from where it came to rest, rad.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Stick(f64);

/// Shares of `I / dt^2` and `I / dt` that stiffness and damping of a sticking contact take. An explicit
/// spring-damper is stable while `stiffness dt^2 / I + 2 damping dt / I < 4`.
const STIFFNESS: f64 = 0.2;
const DAMPING: f64 = 0.5;

impl Stick {
    /// Torque of torsional and rolling friction on a link that turns with `angular_velocity` and feels `inertia`, world axes,
    /// N m. Spin about a ground's normal that is not vertical takes the vertical's inertia, rolling across it the horizontal one.
    pub(super) fn torque(
        &mut self,
        angular_velocity: &Vector3<f64>,
        inertia: &Turning,
        touch: &Touch,
        dt: f64,
    ) -> Vector3<f64> {
        let Touch {
            friction,
            force,
            normal,
        } = touch;
        let normal_force = force.0.dot(normal).max(0.0);
        if normal_force == 0.0 {
            self.0 = 0.0;
            return Vector3::zeros();
        }
        let spin = angular_velocity.dot(normal);
        let roll = angular_velocity - normal * spin;
        let rolling = brake(&roll, inertia.horizontal, friction.rolling * normal_force, dt);
        self.0 += spin * dt;
        let (stiffness, damping) = (
            STIFFNESS * inertia.vertical / (dt * dt),
            DAMPING * inertia.vertical / dt,
        );
        let (wanted, limit) = (
            -(stiffness * self.0 + damping * spin),
            friction.torsional * normal_force,
        );
        let torque = wanted.clamp(-limit, limit);
        if wanted.abs() > limit {
            // Where the spring would have to rest to give just this torque.
            let reach = limit / stiffness;
            self.0 = (-(torque + damping * spin) / stiffness).clamp(-reach, reach);
        }
        rolling + normal * torque
    }
}

/// A torque of at most `limit` against `velocity` that does not reverse the rotation of a body that feels `inertia` within `dt`.
fn brake(velocity: &Vector3<f64>, inertia: f64, limit: f64, dt: f64) -> Vector3<f64> {
    let speed = velocity.norm();
    if speed == 0.0 || limit == 0.0 {
        return Vector3::zeros();
    }
    velocity * -(limit / speed).min(inertia / dt)
}
