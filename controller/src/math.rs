//! The little vector and quaternion algebra the controller needs. Quaternions are (x, y, z, w).

use libm::{cosf, sinf};

pub(crate) type Vec3 = [f32; 3];
pub(crate) type Quat = [f32; 4];

pub(crate) const IDENTITY: Quat = [0.0, 0.0, 0.0, 1.0];

pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn scale(a: Vec3, s: f32) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

pub(crate) fn dot(a: Vec3, b: Vec3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub(crate) fn is_finite(values: &[f32]) -> bool {
    values.iter().all(|value| value.is_finite())
}

/// The rotation `a` after `b`: `rotate(compose(a, b), v) = rotate(a, rotate(b, v))`.
pub(crate) fn compose(a: Quat, b: Quat) -> Quat {
    let [ax, ay, az, aw] = a;
    let [bx, by, bz, bw] = b;
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// `v` turned by the unit quaternion `q`.
pub(crate) fn rotate(q: Quat, v: Vec3) -> Vec3 {
    let axis = [q[0], q[1], q[2]];
    let twice = scale(cross(axis, v), 2.0);
    add(v, add(scale(twice, q[3]), cross(axis, twice)))
}

/// The turn by `angle` about the unit `axis`.
pub(crate) fn axis_angle(axis: Vec3, angle: f32) -> Quat {
    let [x, y, z] = scale(axis, sinf(0.5 * angle));
    [x, y, z, cosf(0.5 * angle)]
}

/// `v` turned by `angle` about z.
pub(crate) fn rotate_z(angle: f32, v: Vec3) -> Vec3 {
    let (sin, cos) = (sinf(angle), cosf(angle));
    [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[2]]
}
