//! Linear velocity of the base from the stance leg on flat ground (thesis 7.3.1).
//!
//! Whatever part of a sole touches flat ground is the lowest, and if it does not slip it is at rest in the world. With a
//! sole corner at p and its velocity p' seen from the base, and the base turning at omega, a resting corner means
//!
//! ```text
//! v_base = -(omega x p + p')          (base frame)
//! ```
//!
//! Which corners rest is not all or nothing: at heel strike, on an edge and in double support several share the lowest
//! place, and encoder noise of 1e-3 rad at the end of a leg is a millimetre of height. So every corner of every sole votes with
//! the weight `exp(-(h / s)^2 / 2)` of its height h over the lowest corner along gravity, [`HEIGHT_SCALE`] = s: equal within noise, gone for
//! a foot in swing, and smooth in between.

use libm::expf;

use crate::{
    kinematics::Sole,
    math::{Vec3, add, cross, dot, scale},
};

/// Height over the lowest corner at which a corner counts 0.6 as much, m.
pub const HEIGHT_SCALE: f32 = 4e-3;

/// Velocity of the base origin in the base frame, m/s, from the soles of all legs, the gyro (base frame, rad/s)
/// and the unit vector against gravity in the base frame. `None` without legs or when the readings give nothing finite.
pub fn base_velocity(soles: impl Iterator<Item = Sole> + Clone, gyro: [f32; 3], up: [f32; 3]) -> Option<[f32; 3]> {
    let corners = soles.flat_map(|sole| sole.corners.map(|corner| (sole, corner)));
    let lowest = corners
        .clone()
        .map(|(_, corner)| dot(up, corner))
        .fold(f32::INFINITY, f32::min);
    let mut sum: Vec3 = [0.0; 3];
    let mut total = 0.0;
    for (sole, corner) in corners {
        let height = (dot(up, corner) - lowest) / HEIGHT_SCALE;
        let weight = expf(-0.5 * height * height);
        let velocity = add(cross(gyro, corner), sole.velocity_at(corner));
        sum = add(sum, scale(velocity, -weight));
        total += weight;
    }
    let mean = scale(sum, 1.0 / total);
    (total >= 1.0 && crate::math::is_finite(&mean)).then_some(mean)
}
