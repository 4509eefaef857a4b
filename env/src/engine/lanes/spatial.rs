//! Vectors, matrices and spatial quantities over lanes.
//!
//! Spatial quantities use world axes and the base link's origin O as reference point: a motion is the velocity of
//! the body's point at O and the angular velocity, a force is the force and its moment about O, so that motions and
//! inertias of different links add without transforms (Featherstone, Rigid Body Dynamics Algorithms, chapter 2).

use super::lane::Lane;

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
    /// The inverse of a positive definite matrix, by cofactors.
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let Self { xx, xy, xz, yy, yz, zz } = *self;
        let a = yz.neg_mul_add(yz, yy * zz);
        let b = xy.neg_mul_add(zz, xz * yz);
        let c = xz.neg_mul_add(yy, xy * yz);
        let scale = xx.mul_add(a, xy.mul_add(b, xz * c)).recip();
        Self {
            xx: a * scale,
            xy: b * scale,
            xz: c * scale,
            yy: xz.neg_mul_add(xz, xx * zz) * scale,
            yz: xx.neg_mul_add(yz, xy * xz) * scale,
            zz: xy.neg_mul_add(xy, xx * yy) * scale,
        }
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

/// A spatial velocity or acceleration.
#[derive(Clone, Copy)]
pub struct Motion<L> {
    /// Of the body's point at the reference point.
    pub linear: Vec3<L>,
    pub angular: Vec3<L>,
}

impl<L: Lane> Motion<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            linear: Vec3::zero(),
            angular: Vec3::zero(),
        }
    }
    #[inline(always)]
    pub fn plus(self, b: Self) -> Self {
        Self {
            linear: self.linear.plus(b.linear),
            angular: self.angular.plus(b.angular),
        }
    }
    #[inline(always)]
    pub fn times(self, s: L) -> Self {
        Self {
            linear: self.linear.times(s),
            angular: self.angular.times(s),
        }
    }
    /// Power of a force along this motion.
    #[inline(always)]
    pub fn dot(self, f: Force<L>) -> L {
        self.linear.dot(f.force) + self.angular.dot(f.moment)
    }
    /// `self x b`, the rate of change of a motion `b` carried by a body that moves with `self`.
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        Self {
            linear: self.angular.cross(b.linear).plus_cross(self.linear, b.angular),
            angular: self.angular.cross(b.angular),
        }
    }
    /// `self x* f`, the rate of change of a momentum `f` carried by a body that moves with `self`.
    #[inline(always)]
    pub fn cross_force(self, f: Force<L>) -> Force<L> {
        Force {
            force: self.angular.cross(f.force),
            moment: self.angular.cross(f.moment).plus_cross(self.linear, f.force),
        }
    }
    /// The same motion seen at `point` (relative to the reference point).
    #[inline(always)]
    pub fn at(self, point: Vec3<L>) -> Self {
        Self {
            linear: self.linear.plus_cross(self.angular, point),
            angular: self.angular,
        }
    }
    /// Linear, then angular components.
    #[inline(always)]
    pub fn array(self) -> [L; 6] {
        let ([a, b, c], [d, e, f]) = (self.linear.array(), self.angular.array());
        [a, b, c, d, e, f]
    }
}

/// A spatial force, impulse or momentum.
#[derive(Clone, Copy)]
pub struct Force<L> {
    pub force: Vec3<L>,
    /// About the reference point.
    pub moment: Vec3<L>,
}

impl<L: Lane> Force<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            force: Vec3::zero(),
            moment: Vec3::zero(),
        }
    }
    #[inline(always)]
    pub fn plus(self, b: Self) -> Self {
        Self {
            force: self.force.plus(b.force),
            moment: self.moment.plus(b.moment),
        }
    }
    /// Force, then moment components.
    #[inline(always)]
    pub fn array(self) -> [L; 6] {
        let ([a, b, c], [d, e, f]) = (self.force.array(), self.moment.array());
        [a, b, c, d, e, f]
    }
}

/// A spatial inertia about the reference point.
#[derive(Clone, Copy)]
pub struct Inertia<L> {
    pub mass: L,
    /// Mass times centre of mass.
    pub first_moment: Vec3<L>,
    /// Rotational inertia about the reference point.
    pub second_moment: Sym3<L>,
}

impl<L: Lane> Inertia<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            mass: L::zero(),
            first_moment: Vec3::zero(),
            second_moment: Sym3::zero(),
        }
    }
    /// From mass, centre of mass and the inertia about it (parallel-axis theorem).
    #[inline(always)]
    pub fn new(mass: L, com: Vec3<L>, about_com: &Sym3<L>) -> Self {
        let h = com.times(mass);
        let second_moment = Sym3 {
            xx: about_com.xx + h.y.mul_add(com.y, h.z * com.z),
            xy: h.x.neg_mul_add(com.y, about_com.xy),
            xz: h.x.neg_mul_add(com.z, about_com.xz),
            yy: about_com.yy + h.x.mul_add(com.x, h.z * com.z),
            yz: h.y.neg_mul_add(com.z, about_com.yz),
            zz: about_com.zz + h.x.mul_add(com.x, h.y * com.y),
        };
        Self {
            mass,
            first_moment: h,
            second_moment,
        }
    }
    #[inline(always)]
    pub fn plus(&self, b: &Self) -> Self {
        Self {
            mass: self.mass + b.mass,
            first_moment: self.first_moment.plus(b.first_moment),
            second_moment: self.second_moment.plus(&b.second_moment),
        }
    }
    /// The momentum of a motion, or the force of an acceleration.
    #[inline(always)]
    pub fn apply(&self, m: Motion<L>) -> Force<L> {
        Force {
            force: m.linear.times(self.mass).plus_cross(m.angular, self.first_moment),
            moment: self
                .second_moment
                .apply(m.angular)
                .plus_cross(self.first_moment, m.linear),
        }
    }
}

/// Horner's rule, the highest power first.
#[inline(always)]
fn polynomial<L: Lane, const N: usize>(x: L, coefficients: [f64; N]) -> L {
    let mut sum = L::of(coefficients[0]);
    for c in &coefficients[1..] {
        sum = sum.mul_add(x, L::of(*c));
    }
    sum
}

/// Sine and cosine: Cody-Waite reduction to a quarter turn, then the fdlibm (f64) or Cephes (f32) polynomials.
#[inline(always)]
pub fn sin_cos<L: Lane>(angle: L) -> (L, L) {
    let quarter = (angle * L::of(std::f64::consts::FRAC_2_PI)).round();
    // pi / 2 in three parts whose products with the quarter count are exact.
    let parts = if L::DOUBLE {
        [
            1.570_796_326_734_125_6,
            6.077_100_506_303_966e-11,
            2.022_266_248_795_951e-21,
        ]
    } else {
        [1.570_312_5, 4.837_512_969_970_703e-4, 7.549_789_948_768_648e-8]
    };
    let mut r = angle;
    for part in parts {
        r = quarter.neg_mul_add(L::of(part), r);
    }
    let r2 = r * r;
    let (s, c) = if L::DOUBLE {
        (
            polynomial(
                r2,
                [
                    1.589_690_995_211_55e-10,
                    -2.505_076_025_340_686_3e-8,
                    2.755_731_370_707_006_8e-6,
                    -1.984_126_982_985_795e-4,
                    8.333_333_333_322_49e-3,
                    -1.666_666_666_666_663_2e-1,
                ],
            ),
            polynomial(
                r2,
                [
                    -1.135_964_755_778_819_5e-11,
                    2.087_572_321_298_175e-9,
                    -2.755_731_435_139_066_3e-7,
                    2.480_158_728_947_673e-5,
                    -1.388_888_888_887_411e-3,
                    4.166_666_666_666_66e-2,
                ],
            ),
        )
    } else {
        (
            polynomial(r2, [-1.951_529_6e-4, 8.332_161e-3, -1.666_665_5e-1]),
            polynomial(r2, [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2]),
        )
    };
    let sin = (r2 * r).mul_add(s, r);
    let cos = (r2 * r2).mul_add(c, r2.neg_mul_add(L::of(0.5), L::of(1.0)));
    // quadrant = quarter modulo 4 in -2..=2
    let quadrant = (quarter * L::of(0.25)).round().neg_mul_add(L::of(4.0), quarter);
    let turns = quadrant.abs();
    let odd = (turns - L::of(1.0)).abs(); // 0 for an odd quadrant
    let half = L::of(0.5);
    let (a, b) = (odd.select_lt(half, cos, sin), odd.select_lt(half, sin, cos));
    // sin changes sign in quadrants -1, 2, -2; cos in 1, 2, -2
    let opposite = L::of(1.5);
    let sin = opposite.select_lt(turns, -a, quadrant.select_lt(-half, -a, a));
    let cos = opposite.select_lt(turns, -b, half.select_lt(quadrant, -b, b));
    (sin, cos)
}
