//! The little vector and quaternion algebra the controller needs. Quaternions are (x, y, z, w).

use crate::number::Number;

pub(crate) type Vec3<N = f32> = [N; 3];
pub(crate) type Quat<N = f32> = [N; 4];

pub(crate) const IDENTITY: Quat = [0.0, 0.0, 0.0, 1.0];

#[inline(always)]
pub(crate) fn add<N: Number>(a: Vec3<N>, b: Vec3<N>) -> Vec3<N> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(crate) fn scale<N: Number>(a: Vec3<N>, s: N) -> Vec3<N> {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
pub(crate) fn dot<N: Number>(a: Vec3<N>, b: Vec3<N>) -> N {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn cross<N: Number>(a: Vec3<N>, b: Vec3<N>) -> Vec3<N> {
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
#[inline(always)]
pub(crate) fn compose<N: Number>(a: Quat<N>, b: Quat<N>) -> Quat<N> {
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
#[inline(always)]
pub(crate) fn rotate<N: Number>(q: Quat<N>, v: Vec3<N>) -> Vec3<N> {
    let axis = [q[0], q[1], q[2]];
    let twice = scale(cross(axis, v), N::of(2.0));
    add(v, add(scale(twice, q[3]), cross(axis, twice)))
}

/// The turn by `angle` about the unit `axis`.
#[inline(always)]
pub(crate) fn axis_angle<N: Number>(axis: Vec3<N>, angle: N) -> Quat<N> {
    let (sin, cos) = (N::of(0.5) * angle).sin_cos();
    let [x, y, z] = scale(axis, sin);
    [x, y, z, cos]
}

/// `v` turned by `angle` about z.
pub(crate) fn rotate_z<N: Number>(angle: N, v: Vec3<N>) -> Vec3<N> {
    let (sin, cos) = angle.sin_cos();
    [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[2]]
}
