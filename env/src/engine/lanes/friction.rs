//! Friction of contact points: an elliptic cone.
//!
//! The impulses along the tangents `f`, about the tangents `m` (rolling) and about the normal `t` (torsion) obey
//! `(f / mu_t)^2 + (m / mu_r)^2 + (t / mu_z)^2 <= n^2` with the normal impulse n; mu_r and mu_z are lengths. A foot's
//! total is the sum over its points. Divided by their coefficients the five components x lie in a ball of radius n. With
//! the block B of inverse inertias and the slip s at the old x, a point that slips along `-x` obeys `s = -lambda x` for a
//! multiplier `lambda > 0` and `|x| = n`, one that sticks `s = 0`. A visit takes `lambda = max(0, -s . x / n^2)` and then a
//! Newton step with it, `x - (B + lambda)^-1 (s + lambda x)`, shortened to the ball: sticking and slipping points of
//! maximum dissipation are its fixed points, and unlike a step along the gradient it does not care that sliding and
//! turning answer on different scales. [`SLIP_DAMPING`] and [`TURN_DAMPING`] make the split between points unique: a
//! loaded point creeps with `F / SLIP_DAMPING`.
//!
//! So a point that slides and spins at once is braked less in each than it would be in that alone. The engine of record has no such
//! cone: rapier's Coulomb friction takes its full tangential force whatever the link's spin, and torsional and rolling friction
//! are torques with clamps of their own (`engine::rapier`, module `contact`). Engines differ there, not where only one of the
//! three acts.

use super::group::ContactImpulse;
use super::lane::Lane;
use super::vector::{Sym3, Vec3};
use super::work::PointWork;

/// Force per slip speed of a sticking point, N s/m.
pub const SLIP_DAMPING: f64 = 2e6;
/// Moment per turning speed of a sticking point, N m s/rad.
pub const TURN_DAMPING: f64 = 2e3;
/// Added to the inverse inertia of every frictional component, so that one without friction has an inverse.
const LEAST_RESPONSE: f64 = 1e-9;
/// Largest multiplier of a slipping point, 1/kg: far beyond every inverse inertia, and its cube is still a single-precision number.
const LARGEST_MULTIPLIER: f64 = 1e6;

/// The cone's axes, for the five frictional components.
pub struct Cone<L> {
    /// Coefficients.
    scale: [L; 5],
    /// Slip speed per unit of impulse in coordinates divided by the coefficients.
    creep: [L; 5],
}

impl<L: Lane> Cone<L> {
    #[inline(always)]
    pub fn new(friction: &[L; 3], dt: f64) -> Self {
        let [tangential, torsional, rolling] = *friction;
        let scale = [tangential, tangential, rolling, rolling, torsional];
        let slip = L::of(1.0 / (dt * SLIP_DAMPING));
        let turn = L::of(1.0 / (dt * TURN_DAMPING));
        Self {
            scale,
            creep: scaled(&scaled(&scale, &scale), &[slip, slip, turn, turn, turn]),
        }
    }

    /// The components of an impulse, N s and N m s, from its scaled coordinates.
    #[inline(always)]
    pub fn components(&self, impulse: &[L; 5]) -> [L; 5] {
        scaled(impulse, &self.scale)
    }

    /// Turning velocity per unit of moment in scaled coordinates, from what it is in the point's axes.
    #[inline(always)]
    pub fn turning_block(&self, turning: &Sym3<L>) -> Sym3<L> {
        let [_, _, a, b, c] = self.scale;
        let [_, _, creep_a, creep_b, creep_c] = self.creep;
        let least = L::of(LEAST_RESPONSE);
        Sym3 {
            xx: (a * a).mul_add(turning.xx, creep_a + least),
            xy: a * b * turning.xy,
            xz: a * c * turning.xz,
            yy: (b * b).mul_add(turning.yy, creep_b + least),
            yz: b * c * turning.yz,
            zz: (c * c).mul_add(turning.zz, creep_c + least),
        }
    }

    /// The point's inverse inertias in scaled coordinates: how friction answers to the normal impulse, and sliding to
    /// sliding and turning. `rows` are the point's motions along x, y and the normal per wrench at the point.
    #[inline(always)]
    pub fn couple(&self, point: &mut PointWork<L>, rows: &[[L; 6]; 3]) {
        let [along_x, along_y, normal] = *rows;
        point.coupling = scaled(&frictional(&normal), &self.scale);

        let [mu, _, a, b, c] = self.scale;
        let square_mu = mu * mu;
        let diagonal = self.creep[0] + L::of(LEAST_RESPONSE);
        point.sliding = [
            square_mu.mul_add(along_x[0], diagonal),
            square_mu * along_y[0],
            square_mu.mul_add(along_y[1], diagonal),
        ];
        let turn = [mu * a, mu * b, mu * c];
        point.mixed = [mixed(&along_x, &turn), mixed(&along_y, &turn)];
    }
}

/// A row's turning part, scaled.
#[inline(always)]
fn mixed<L: Lane>(row: &[L; 6], turn: &[L; 3]) -> Vec3<L> {
    Vec3::new(turn[0] * row[3], turn[1] * row[4], turn[2] * row[5])
}

/// The twist's components that friction opposes: along x and y, about x, y and z.
#[inline(always)]
fn frictional<L: Lane>(twist: &[L; 6]) -> [L; 5] {
    let [x, y, _, a, b, c] = *twist;
    [x, y, a, b, c]
}

#[inline(always)]
fn scaled<L: Lane>(a: &[L; 5], s: &[L; 5]) -> [L; 5] {
    [a[0] * s[0], a[1] * s[1], a[2] * s[2], a[3] * s[3], a[4] * s[4]]
}

/// Projects the frictional impulses onto the cone, `normal` after the normal one has changed; returns their change.
#[inline(always)]
pub fn rub<L: Lane>(
    point: &PointWork<L>,
    turning: &Sym3<L>,
    impulse: &mut ContactImpulse<L>,
    velocity: &[L; 6],
    normal: L,
    cone: &Cone<L>,
) -> [L; 5] {
    let old = impulse.friction;
    let mut slip = scaled(&frictional(velocity), &cone.scale);
    for r in 0..5 {
        slip[r] = point.coupling[r].mul_add(normal, cone.creep[r].mul_add(old[r], slip[r]));
    }
    let radius = impulse.normal;
    let multiplier = (-product(&slip, &old) * (radius * radius).max(L::of(1e-20)).recip())
        .max(L::zero())
        .min(L::of(LARGEST_MULTIPLIER));
    for r in 0..5 {
        slip[r] = multiplier.mul_add(old[r], slip[r]);
    }
    let step = newton(point, turning, multiplier, &slip);
    let mut next = old;
    for r in 0..5 {
        next[r] = old[r] - step[r];
    }
    let shrink = (radius / product(&next, &next).max(L::of(1e-30)).sqrt()).min(L::of(1.0));
    let mut change = old;
    for r in 0..5 {
        // The sum turns a negative zero positive: a point out of reach leaves the same bits as a skipped one.
        let next = next[r].mul_add(shrink, L::zero());
        impulse.friction[r] = next;
        change[r] = next - old[r];
    }
    change
}

/// `(B + multiplier)^-1 slip`
///
/// With the block `[T C; C^T W]` of sliding and turning, D = C W^-1 and S = T - D C^T, the solution for (t, w) is
/// `x = S^-1 (t - D w)` and `W^-1 w - D^T x`. A visit waits for this: products with the adjugate of W do not wait for the
/// division by its determinant.
#[inline(always)]
fn newton<L: Lane>(point: &PointWork<L>, turning: &Sym3<L>, multiplier: L, slip: &[L; 5]) -> [L; 5] {
    let turning = Sym3 {
        xx: turning.xx + multiplier,
        yy: turning.yy + multiplier,
        zz: turning.zz + multiplier,
        ..*turning
    };
    let adjugate = turning.adjugate();
    let scale = turning.determinant(&adjugate).recip();
    let [mixed_x, mixed_y] = point.mixed;
    let (lever_x, lever_y) = (adjugate.apply(mixed_x), adjugate.apply(mixed_y));
    let [x, y, a, b, c] = *slip;
    let turn = Vec3::new(a, b, c);

    let [xx, xy, yy] = point.sliding;
    let least = L::of(LEAST_RESPONSE);
    let xx = scale.neg_mul_add(lever_x.dot(mixed_x), xx + multiplier).max(least);
    let xy = scale.neg_mul_add(lever_x.dot(mixed_y), xy);
    let yy = scale.neg_mul_add(lever_y.dot(mixed_y), yy + multiplier).max(least);
    let inverse = xy.neg_mul_add(xy, xx * yy).max(least * least).recip();

    let x = scale.neg_mul_add(lever_x.dot(turn), x);
    let y = scale.neg_mul_add(lever_y.dot(turn), y);
    let (x, y) = (xy.neg_mul_add(y, yy * x) * inverse, xy.neg_mul_add(x, xx * y) * inverse);
    let levers = lever_x.times(x).plus_scaled(lever_y, y);
    let turn = adjugate.apply(turn).minus(levers).times(scale);
    [x, y, turn.x, turn.y, turn.z]
}

#[inline(always)]
fn product<L: Lane>(a: &[L; 5], b: &[L; 5]) -> L {
    let tangential = a[0].mul_add(b[0], a[1] * b[1]);
    tangential + a[2].mul_add(b[2], a[3].mul_add(b[3], a[4] * b[4]))
}
