//! Vectors, matrices and rotations over lanes.

use super::lane::Lane;
use super::series::polynomial;

/// A vector, world axes unless said otherwise.
#[derive(Clone, Copy)]
pub struct Vec3<L> {
    pub x: L,
    pub y: L,
    pub z: L,
}

impl<L: Lane> Vec3<L> {
    #[inline(always)]
    pub fn new(x: L, y: L, z: L) -> Self {
        Self { x, y, z }
    }
    #[inline(always)]
    pub fn zero() -> Self {
        Self::splat([L::scalar(0.0); 3])
    }
    #[inline(always)]
    pub fn splat([x, y, z]: [L::Scalar; 3]) -> Self {
        Self::new(L::splat(x), L::splat(y), L::splat(z))
    }
    #[inline(always)]
    pub fn array(self) -> [L; 3] {
        [self.x, self.y, self.z]
    }
    #[inline(always)]
    pub fn plus(self, b: Self) -> Self {
        Self::new(self.x + b.x, self.y + b.y, self.z + b.z)
    }
    #[inline(always)]
    pub fn minus(self, b: Self) -> Self {
        Self::new(self.x - b.x, self.y - b.y, self.z - b.z)
    }
    #[inline(always)]
    pub fn times(self, s: L) -> Self {
        Self::new(self.x * s, self.y * s, self.z * s)
    }
    /// `self + b s`
    #[inline(always)]
    pub fn plus_scaled(self, b: Self, s: L) -> Self {
        Self::new(b.x.mul_add(s, self.x), b.y.mul_add(s, self.y), b.z.mul_add(s, self.z))
    }
    #[inline(always)]
    pub fn dot(self, b: Self) -> L {
        self.x.mul_add(b.x, self.y.mul_add(b.y, self.z * b.z))
    }
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        Self::new(
            self.z.neg_mul_add(b.y, self.y * b.z),
            self.x.neg_mul_add(b.z, self.z * b.x),
            self.y.neg_mul_add(b.x, self.x * b.y),
        )
    }
    /// `self + a x b`
    #[inline(always)]
    pub fn plus_cross(self, a: Self, b: Self) -> Self {
        Self::new(
            a.z.neg_mul_add(b.y, a.y.mul_add(b.z, self.x)),
            a.x.neg_mul_add(b.z, a.z.mul_add(b.x, self.y)),
            a.y.neg_mul_add(b.x, a.x.mul_add(b.y, self.z)),
        )
    }
}

/// A 3 x 3 matrix by rows.
#[derive(Clone, Copy)]
pub struct Mat3<L>(pub [Vec3<L>; 3]);

impl<L: Lane> Mat3<L> {
    #[inline(always)]
    pub fn identity() -> Self {
        let (o, i) = (L::zero(), L::of(1.0));
        Self([Vec3::new(i, o, o), Vec3::new(o, i, o), Vec3::new(o, o, i)])
    }
    /// `self v`
    #[inline(always)]
    pub fn apply(&self, v: Vec3<L>) -> Vec3<L> {
        let [a, b, c] = &self.0;
        Vec3::new(a.dot(v), b.dot(v), c.dot(v))
    }
    /// `self b`
    #[inline(always)]
    pub fn multiply(&self, b: &Self) -> Self {
        let [p, q, r] = self.0;
        Self([b.combined(p), b.combined(q), b.combined(r)])
    }
    /// The rows' sum weighted by `a`: `self^T a`.
    #[inline(always)]
    pub fn combined(&self, a: Vec3<L>) -> Vec3<L> {
        let [p, q, r] = self.0;
        p.times(a.x).plus_scaled(q, a.y).plus_scaled(r, a.z)
    }
    /// The rotation of a unit quaternion.
    #[inline(always)]
    pub fn rotation(q: &Quaternion<L>) -> Self {
        let two = L::of(2.0);
        let one = L::of(1.0);
        let (x2, y2, z2) = (q.x * two, q.y * two, q.z * two);
        let (xx, xy, xz) = (q.x * x2, q.x * y2, q.x * z2);
        let (yy, yz, zz) = (q.y * y2, q.y * z2, q.z * z2);
        let (wx, wy, wz) = (q.w * x2, q.w * y2, q.w * z2);
        Self([
            Vec3::new(one - (yy + zz), xy - wz, xz + wy),
            Vec3::new(xy + wz, one - (xx + zz), yz - wx),
            Vec3::new(xz - wy, yz + wx, one - (xx + yy)),
        ])
    }
}

/// A symmetric 3 x 3 matrix.
#[derive(Clone, Copy)]
pub struct Sym3<L> {
    pub xx: L,
    pub xy: L,
    pub xz: L,
    pub yy: L,
    pub yz: L,
    pub zz: L,
}

impl<L: Lane> Sym3<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        let o = L::zero();
        Self {
            xx: o,
            xy: o,
            xz: o,
            yy: o,
            yz: o,
            zz: o,
        }
    }
    /// `self v`
    #[inline(always)]
    pub fn apply(&self, v: Vec3<L>) -> Vec3<L> {
        self.rows().apply(v)
    }
    /// The cofactors: the inverse times the determinant.
    #[inline(always)]
    pub fn adjugate(&self) -> Self {
        let Self { xx, xy, xz, yy, yz, zz } = *self;
        Self {
            xx: yz.neg_mul_add(yz, yy * zz),
            xy: xy.neg_mul_add(zz, xz * yz),
            xz: xz.neg_mul_add(yy, xy * yz),
            yy: xz.neg_mul_add(xz, xx * zz),
            yz: xx.neg_mul_add(yz, xy * xz),
            zz: xy.neg_mul_add(xy, xx * yy),
        }
    }
    /// The determinant from the cofactors.
    #[inline(always)]
    pub fn determinant(&self, adjugate: &Self) -> L {
        let Self { xx, xy, xz, .. } = *self;
        xx.mul_add(adjugate.xx, xy.mul_add(adjugate.xy, xz * adjugate.xz))
    }
    #[inline(always)]
    pub fn plus(&self, b: &Self) -> Self {
        Self {
            xx: self.xx + b.xx,
            xy: self.xy + b.xy,
            xz: self.xz + b.xz,
            yy: self.yy + b.yy,
            yz: self.yz + b.yz,
            zz: self.zz + b.zz,
        }
    }
    #[inline(always)]
    pub fn rows(&self) -> Mat3<L> {
        Mat3([
            Vec3::new(self.xx, self.xy, self.xz),
            Vec3::new(self.xy, self.yy, self.yz),
            Vec3::new(self.xz, self.yz, self.zz),
        ])
    }
    /// `r self r^T`
    #[inline(always)]
    pub fn rotated(&self, r: &Mat3<L>) -> Self {
        let [a, b, c] = r.0;
        let rows = self.rows();
        let (ia, ib, ic) = (rows.apply(a), rows.apply(b), rows.apply(c));
        Self {
            xx: a.dot(ia),
            xy: a.dot(ib),
            xz: a.dot(ic),
            yy: b.dot(ib),
            yz: b.dot(ic),
            zz: c.dot(ic),
        }
    }
}

/// A unit quaternion.
#[derive(Clone, Copy)]
pub struct Quaternion<L> {
    pub w: L,
    pub x: L,
    pub y: L,
    pub z: L,
}

impl<L: Lane> Quaternion<L> {
    #[inline(always)]
    pub fn identity() -> Self {
        Self {
            w: L::of(1.0),
            x: L::zero(),
            y: L::zero(),
            z: L::zero(),
        }
    }

    /// `exp(rotation / 2) self`, normalised: `self` turned by the world-frame rotation vector, rad.
    #[inline(always)]
    pub fn turned(&self, rotation: Vec3<L>) -> Self {
        let half = rotation.times(L::of(0.5));
        let square = half.dot(half);
        // Taylor series of sin(a) / a and cos(a) in a^2: 1e-14 up to half a radian per step, normalised beyond.
        let sinc = [
            -1.0 / 39_916_800.0,
            1.0 / 362_880.0,
            -1.0 / 5040.0,
            1.0 / 120.0,
            -1.0 / 6.0,
            1.0,
        ];
        let cos = [-1.0 / 3_628_800.0, 1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0];
        let (v, c) = (half.times(polynomial(square, sinc)), polynomial(square, cos));
        let u = Vec3::new(self.x, self.y, self.z);
        let w = c * self.w - v.dot(u);
        let xyz = u.times(c).plus_scaled(v, self.w).plus_cross(v, u);
        let scale = w.mul_add(w, xyz.dot(xyz)).sqrt().recip();
        let xyz = xyz.times(scale);
        Self {
            w: w * scale,
            x: xyz.x,
            y: xyz.y,
            z: xyz.z,
        }
    }
}
