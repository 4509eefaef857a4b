//! Linear velocity of the base from the stance leg on flat ground (thesis 7.3.1).
//!
//! Whatever part of a sole touches flat ground is the lowest, and if it does not slip it is at rest in the world. With a
//! sole corner at p and its velocity p' seen from the base, and the base turning at omega, a resting corner means
//!
//! ```text
//! v_base = -(omega x p + p')          (base frame)
//! ```
//!
//! Every corner of every sole gives such a velocity; the estimate is their mean with weights `exp(-E)`,
//!
//! ```text
//! E = h^2 / (2 s_h^2) + d^2 / (2 s_v^2 + d^2 / E_max)
//! ```
//!
//! h is the corner's height over the lowest along gravity, s_h = [`HEIGHT_SCALE`]; d is the difference of its velocity from the
//! previous estimate, s_v = [`VELOCITY_SCALE`]. Height alone is not enough: around touchdown the foot in swing is within millimetres of
//! the ground while it still moves, and joint offsets of 0.01 rad make it look like the lower one. Its velocity gives it away, as a base
//! does not jump. The velocity term is bounded by E_max = [`VELOCITY_TERM_MAX`], so that a corner higher than
//! `s_h sqrt(2 E_max)` (16 mm) never outvotes the lowest: a wrong previous estimate cannot keep itself alive. Only differences of E count: a push that
//! changes the velocity at once raises the E of all resting corners alike.

use crate::{
    kinematics::Sole,
    math::{Vec3, add, cross, dot, scale},
    number::Number,
};

/// Height over the lowest corner at which a corner counts 0.6 as much, m: above what encoder noise of 1e-3 rad does at
/// the end of a leg, below the clearance of a step.
pub const HEIGHT_SCALE: f64 = 4e-3;

/// Difference from the previous estimate at which a corner's velocity counts 0.6 as much, m/s.
pub const VELOCITY_SCALE: f64 = 0.05;

/// Largest reduction of a corner's weight for its velocity, as an exponent.
pub const VELOCITY_TERM_MAX: f64 = 8.0;

/// Velocity of the base origin in the base frame, m/s, from the soles of all legs, the gyro (base frame, rad/s),
/// the unit vector against gravity in the base frame and the previous velocity of the base (base frame, m/s).
/// `None` without legs or when the readings give nothing finite.
pub fn base_velocity(soles: &[Sole], gyro: [f64; 3], up: [f64; 3], previous: [f64; 3]) -> Option<[f64; 3]> {
    finite(mean_velocity(soles, gyro, up, previous))
}

/// An estimate, if it is one.
pub(crate) fn finite(velocity: Vec3<f64>) -> Option<Vec3<f64>> {
    velocity.iter().all(|x| x.is_finite()).then_some(velocity)
}

/// [`base_velocity`], not finite where that is `None`.
pub(crate) fn mean_velocity<N: Number>(soles: &[Sole<N>], gyro: Vec3<N>, up: Vec3<N>, previous: Vec3<N>) -> Vec3<N> {
    let infinity = N::of(f64::INFINITY);
    let corners = soles
        .iter()
        .flat_map(|sole| sole.corners.iter().map(move |&corner| (sole, corner)));
    let lowest = corners
        .clone()
        .map(|(_, corner)| dot(up, corner))
        .fold(infinity, Number::min);
    let votes = corners.map(|(sole, corner)| {
        let velocity = resting(sole, corner, gyro);
        let height = (dot(up, corner) - lowest) * N::of(1.0 / HEIGHT_SCALE);
        let change = add(velocity, scale(previous, N::of(-1.0)));
        let square = dot(change, change);
        let bound = N::of(2.0 * VELOCITY_SCALE * VELOCITY_SCALE) + square * N::of(1.0 / VELOCITY_TERM_MAX);
        (velocity, N::of(0.5) * height * height + square / bound)
    });
    let least = votes.clone().map(|(_, energy)| energy).fold(infinity, Number::min);
    let (mut sum, mut total) = ([N::of(0.0); 3], N::of(0.0));
    for (velocity, energy) in votes {
        let weight = (least - energy).exp();
        sum = add(sum, scale(velocity, weight));
        total = total + weight;
    }
    scale(sum, N::of(1.0) / total)
}

/// Velocity of the base in the base frame if `point` of `sole` is at rest in the world.
#[inline(always)]
fn resting<N: Number>(sole: &Sole<N>, point: Vec3<N>, gyro: Vec3<N>) -> Vec3<N> {
    scale(add(cross(gyro, point), sole.velocity_at(point)), N::of(-1.0))
}

#[cfg(test)]
mod tests;
