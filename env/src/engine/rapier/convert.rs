//! Between nalgebra, which this crate speaks, and the vector types of rapier.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::math::{Pose, Rotation, Vector};

/// A vector for rapier.
pub(super) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// A vector from rapier.
pub(super) fn from_vector(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// A rotation for rapier.
pub(super) fn rotation(q: &UnitQuaternion<f64>) -> Rotation {
    Rotation::from_xyzw(q.i, q.j, q.k, q.w)
}

/// A rotation from rapier, renormalised.
pub(super) fn from_rotation(q: Rotation) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z))
}

/// A pose for rapier.
pub(super) fn pose(p: &Isometry3<f64>) -> Pose {
    Pose::from_parts(vector(&p.translation.vector), rotation(&p.rotation))
}

/// A pose from rapier.
pub(super) fn from_pose(p: &Pose) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(from_vector(p.translation)),
        from_rotation(p.rotation),
    )
}
