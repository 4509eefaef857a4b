//! Contact points against the ground: regularised normal impulses and an elliptic cone of friction.
//!
//! **Normal.** A point at gap `phi < 0` is pushed by a spring and a damper, `F = -k phi' - d v'`, with gap and
//! velocity at the end of the step; as a row, `v' + F dt / (dt (dt k + d)) = -phi k / (dt k + d)`, where the
//! push-out speed on the right is bounded. A point within reach above the ground may not move by more than its gap in a
//! step. k and d are [`STIFFNESS`] and [`DAMPING`] of one point: a 17 kg robot on eight points sinks in by 0.2 mm.
//!
//! **Friction.** The impulses along the tangents `f`, about the tangents `m` (rolling) and about the normal `t`
//! (torsion) obey `(f / mu_t)^2 + (m / mu_r)^2 + (t / mu_z)^2 <= n^2` with the normal impulse n; mu_r and mu_z are lengths. A foot's
//! total is the sum over its points. Divided by their coefficients the five components lie in a ball of radius n. A
//! point that sticks takes a Newton step of its 5 x 5 block; where that leaves the ball, the point slips and takes a
//! projected-gradient step, whose fixed points are those of maximum dissipation. [`SLIP_DAMPING`] and
//! [`TURN_DAMPING`] make the split between points unique: a loaded point creeps with `F / SLIP_DAMPING`.

use super::factor::half_solve_path;
use super::group::{ContactImpulse, Group};
use super::lane::Lane;
use super::model::{ContactBody, Model, ROOT};
use super::spatial::{Force, Motion, Vec3};
use super::work::{BodyWork, PointWork, Work};

/// Normal stiffness of a contact point, N/m.
const STIFFNESS: f64 = 1e5;
/// Normal damping of a contact point, N s/m.
const DAMPING: f64 = 1e3;
/// Fastest push-out of a point below the ground, m/s.
const PUSH_OUT: f64 = 1.0;
/// Points farther above the ground than this do not take part, m: a point that falls at 10 m/s meets the ground in time at 200 Hz.
const REACH: f64 = 0.05;
/// Force per slip speed of a sticking point, N s/m.
const SLIP_DAMPING: f64 = 2e6;
/// Moment per turning speed of a sticking point, N m s/rad.
const TURN_DAMPING: f64 = 2e3;
/// Share of the inverse of the block's norm that a slipping point's gradient step takes.
const SLIP_STEP: f64 = 1.5;

/// Height of a point above the ground. The ground is the plane z = 0: its normal is the z axis everywhere, and the tangents
/// are x and y.
#[inline(always)]
fn gap<L: Lane>(base_height: L, position: Vec3<L>) -> L {
    base_height + position.z
}

/// After the factorisation: every body's response, its points, and the warm start.
#[inline(always)]
pub fn prepare<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    let base_height = L::load(&group.state.position[2]);
    for (b, body) in model.bodies.iter().enumerate() {
        let link = work.links[body.link];
        let centre = link.position.plus(link.rotation.apply(Vec3::splat(body.centre)));
        let target = &mut work.bodies[b];
        target.active = false;
        for (point, &position) in target.points.iter_mut().zip(&body.points) {
            let position = link.position.plus(link.rotation.apply(Vec3::splat(position)));
            point.arm = position.minus(centre);
            let gap = gap(base_height, position);
            target.active |= gap.any_lt(L::of(REACH));
            place_point(point, gap, model.dt);
        }
        let impulses = &mut group.state.contacts[body.first_point..][..body.points.len()];
        if !target.active {
            impulses.fill(ContactImpulse {
                normal: L::zero(),
                friction: [L::zero(); 5],
            });
            continue;
        }
        target.velocity = link.velocity.at(centre).array();
        unit_wrenches(model, body, centre, &work.subspaces, &mut target.columns);
        half_solve_path(
            &model.rows,
            &work.mass_matrix,
            &work.inverse_diagonal,
            &body.path,
            &mut target.columns,
        );
        target.response = gram(&target.columns);
        let cone = Cone::new(&group.parameters.friction, model.dt);
        let mut wrench = Force::zero();
        for (point, impulse) in target.points.iter_mut().zip(impulses) {
            point_response(&target.response, point, &cone, model.dt);
            let [o, reach] = [L::zero(), point.normal_max];
            impulse.normal = o.select_lt(reach, impulse.normal, o);
            for f in &mut impulse.friction {
                *f = o.select_lt(reach, *f, o);
            }
            wrench = wrench.plus(point_wrench(point, impulse, &cone));
        }
        add_wrench(body, target, wrench.array(), &mut work.change);
    }
}

/// The normal row's bias and bound.
#[inline(always)]
fn place_point<L: Lane>(point: &mut PointWork<L>, gap: L, dt: f64) {
    let recovery = (gap * L::of(STIFFNESS / (dt * STIFFNESS + DAMPING))).max(L::of(-PUSH_OUT));
    point.bias = gap.select_lt(L::zero(), recovery, gap * L::of(1.0 / dt));
    point.normal_max = gap.select_lt(L::of(REACH), L::of(f32::MAX.into()), L::zero());
}

/// The transposed Jacobian of the body's twist at `centre`: one row a degree of freedom of its path.
#[inline(always)]
fn unit_wrenches<L: Lane>(
    model: &Model<L>,
    body: &ContactBody<L>,
    centre: Vec3<L>,
    subspaces: &[Motion<L>],
    columns: &mut [[L; 6]],
) {
    let (o, i) = (L::zero(), L::of(1.0));
    for (column, subspace) in columns.iter_mut().zip(&body.subspaces) {
        *column = match *subspace {
            Some(s) => subspaces[s].at(centre).array(),
            None => [o; 6],
        };
    }
    if model.floating {
        let c = centre;
        columns[..ROOT].copy_from_slice(&[
            [i, o, o, o, o, o],
            [o, i, o, o, o, o],
            [o, o, i, o, o, o],
            [o, -c.z, c.y, i, o, o],
            [c.z, o, -c.x, o, i, o],
            [-c.y, c.x, o, o, o, i],
        ]);
    }
}

/// `Y^T Y`
#[inline(always)]
fn gram<L: Lane>(columns: &[[L; 6]]) -> [[L; 6]; 6] {
    let mut sum = [[L::zero(); 6]; 6];
    for y in columns {
        for r in 0..6 {
            for c in 0..6 {
                sum[r][c] = y[r].mul_add(y[c], sum[r][c]);
            }
        }
    }
    sum
}

/// The cone's axes, for the five frictional components.
struct Cone<L> {
    /// Coefficients.
    scale: [L; 5],
    /// Slip speed per unit of impulse in coordinates divided by the coefficients.
    creep: [L; 5],
}

impl<L: Lane> Cone<L> {
    #[inline(always)]
    fn new(friction: &[L; 3], dt: f64) -> Self {
        let [tangential, torsional, rolling] = *friction;
        let scale = [tangential, tangential, rolling, rolling, torsional];
        let slip = L::of(1.0 / (dt * SLIP_DAMPING));
        let turn = L::of(1.0 / (dt * TURN_DAMPING));
        Self {
            scale,
            creep: scaled(&scaled(&scale, &scale), &[slip, slip, turn, turn, turn]),
        }
    }
}

/// Twist at the point from the twist at the reference point: linear, then angular.
#[inline(always)]
fn at_point<L: Lane>(twist: &[L; 6], arm: Vec3<L>) -> [L; 6] {
    let [x, y, z, a, b, c] = *twist;
    Motion {
        linear: Vec3::new(x, y, z),
        angular: Vec3::new(a, b, c),
    }
    .at(arm)
    .array()
}

/// The point's inverse inertias: its normal row, the inverse of its frictional block, the step when it slips.
#[inline(always)]
fn point_response<L: Lane>(response: &[[L; 6]; 6], point: &mut PointWork<L>, cone: &Cone<L>, dt: f64) {
    // Rows of the response to a wrench at the reference point, of the twist at the contact point.
    let mut rows = [[L::zero(); 6]; 6];
    for c in 0..6 {
        let mut column = [L::zero(); 6];
        for r in 0..6 {
            column[r] = response[r][c];
        }
        let shifted = at_point(&column, point.arm);
        for r in 0..6 {
            rows[r][c] = shifted[r];
        }
    }
    // A force at the contact point acts at the reference point with moment arm x force: the columns shift like the rows.
    let shifted = at_point(&rows[2], point.arm);
    point.normal_step = (shifted[2] + L::of(softness(dt))).recip();
    point.coupling = scaled(&frictional(&shifted), &cone.scale);

    let mut block = [[L::zero(); 5]; 5];
    let mut squares = L::zero();
    for r in 0..5 {
        let shifted = frictional(&at_point(&rows[FRICTIONAL[r]], point.arm));
        for c in 0..5 {
            block[r][c] = shifted[c] * (cone.scale[r] * cone.scale[c]);
        }
        block[r][r] += cone.creep[r] + L::of(1e-9);
        for entry in block[r] {
            squares = entry.mul_add(entry, squares);
        }
    }
    // The Frobenius norm bounds the largest eigenvalue; the gradient step is stable below 2.
    point.slip_step = L::of(SLIP_STEP) / squares.sqrt();
    point.friction_inverse = inverse(&block);
}

/// The twist's components that friction opposes: along x and y, about x, y and z.
const FRICTIONAL: [usize; 5] = [0, 1, 3, 4, 5];

#[inline(always)]
fn frictional<L: Lane>(twist: &[L; 6]) -> [L; 5] {
    let [x, y, _, a, b, c] = *twist;
    [x, y, a, b, c]
}

/// Approach speed of the normal row per unit of impulse.
#[inline(always)]
fn softness(dt: f64) -> f64 {
    1.0 / (dt * (dt * STIFFNESS + DAMPING))
}

/// `x - a . b`
#[inline(always)]
fn less_products<L: Lane>(x: L, a: &[L], b: &[L]) -> L {
    let mut rest = x;
    for (a, b) in a.iter().zip(b) {
        rest = a.neg_mul_add(*b, rest);
    }
    rest
}

/// The inverse of a symmetric positive definite matrix by Cholesky factorisation.
#[inline(always)]
fn inverse<L: Lane, const N: usize>(m: &[[L; N]; N]) -> [[L; N]; N] {
    let o = L::zero();
    let mut factor = *m;
    // w = factor^-1, lower triangular
    let mut w = [[o; N]; N];
    for r in 0..N {
        let (above, own) = factor.split_at_mut(r);
        let row = &mut own[0];
        for (c, above) in above.iter().enumerate() {
            row[c] = less_products(row[c], &row[..c], &above[..c]) * w[c][c];
        }
        w[r][r] = less_products(row[r], &row[..r], &row[..r]).sqrt().recip();
        for c in 0..r {
            let mut sum = o;
            for k in c..r {
                sum = row[k].neg_mul_add(w[k][c], sum);
            }
            w[r][c] = sum * w[r][r];
        }
    }
    let mut result = [[o; N]; N];
    for r in 0..N {
        for c in 0..=r {
            let mut sum = o;
            for row in &w[r..] {
                sum = row[r].mul_add(row[c], sum);
            }
            result[r][c] = sum;
            result[c][r] = sum;
        }
    }
    result
}

/// The wrench of a point's impulse about the body's reference point.
#[inline(always)]
fn point_wrench<L: Lane>(point: &PointWork<L>, impulse: &ContactImpulse<L>, cone: &Cone<L>) -> Force<L> {
    let [x, y, a, b, c] = scaled(&impulse.friction, &cone.scale);
    let force = Vec3::new(x, y, impulse.normal);
    Force {
        force,
        moment: Vec3::new(a, b, c).plus_cross(point.arm, force),
    }
}

#[inline(always)]
fn scaled<L: Lane>(a: &[L; 5], s: &[L; 5]) -> [L; 5] {
    [a[0] * s[0], a[1] * s[1], a[2] * s[2], a[3] * s[3], a[4] * s[4]]
}

/// `u = u + Y wrench`
#[inline(always)]
fn add_wrench<L: Lane>(body: &ContactBody<L>, work: &BodyWork<L>, wrench: [L; 6], change: &mut [L]) {
    for (column, &k) in work.columns.iter().zip(&body.path) {
        change[k] += dot6(column, &wrench);
    }
}

#[inline(always)]
fn dot6<L: Lane>(a: &[L; 6], b: &[L; 6]) -> L {
    let linear = a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]));
    linear + a[3].mul_add(b[3], a[4].mul_add(b[4], a[5] * b[5]))
}

/// Visits every body that may touch: its points see the body's twist, the rest of the robot the body's total wrench.
#[inline(always)]
pub fn sweep<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    let cone = Cone::new(&group.parameters.friction, model.dt);
    for (body, target) in model.bodies.iter().zip(&work.bodies) {
        if !target.active {
            continue;
        }
        let mut twist = target.velocity;
        for (column, &k) in target.columns.iter().zip(&body.path) {
            let u = work.change[k];
            for (v, y) in twist.iter_mut().zip(column) {
                *v = y.mul_add(u, *v);
            }
        }
        let impulses = &mut group.state.contacts[body.first_point..][..body.points.len()];
        let mut wrench = Force::zero();
        for (point, impulse) in target.points.iter().zip(impulses) {
            let velocity = at_point(&twist, point.arm);
            let normal = push(point, impulse, velocity[2], model.dt);
            let friction = rub(point, impulse, &velocity, normal, &cone);
            let change = point_wrench(point, &ContactImpulse { normal, friction }, &cone);
            wrench = wrench.plus(change);
            let change = change.array();
            for (v, response) in twist.iter_mut().zip(&target.response) {
                *v += dot6(response, &change);
            }
        }
        add_wrench(body, target, wrench.array(), &mut work.change);
    }
}

/// Projects the normal impulse; returns its change.
#[inline(always)]
fn push<L: Lane>(point: &PointWork<L>, impulse: &mut ContactImpulse<L>, velocity: L, dt: f64) -> L {
    let old = impulse.normal;
    let approach = velocity + L::of(softness(dt)).mul_add(old, point.bias);
    impulse.normal = point
        .normal_step
        .neg_mul_add(approach, old)
        .clamp(L::zero(), point.normal_max);
    impulse.normal - old
}

/// Projects the frictional impulses onto the cone, `normal` after the normal one has changed; returns their change.
#[inline(always)]
fn rub<L: Lane>(
    point: &PointWork<L>,
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
    let (mut stick, mut slide) = (old, old);
    for r in 0..5 {
        let [a, b, c, d, e] = point.friction_inverse[r];
        let tangential = a.mul_add(slip[0], b * slip[1]);
        let turning = c.neg_mul_add(slip[2], d.neg_mul_add(slip[3], e.neg_mul_add(slip[4], old[r])));
        stick[r] = turning - tangential;
        slide[r] = point.slip_step.neg_mul_add(slip[r], old[r]);
    }
    let radius = impulse.normal;
    let shrink = (radius / square(&slide).max(L::of(1e-30)).sqrt()).min(L::of(1.0));
    let outside = square(&stick);
    let mut change = old;
    for r in 0..5 {
        // The sum turns a negative zero positive: a point out of reach leaves the same bits as a skipped one.
        let next = (radius * radius).select_lt(outside, slide[r] * shrink, stick[r]) + L::zero();
        impulse.friction[r] = next;
        change[r] = next - old[r];
    }
    change
}

#[inline(always)]
fn square<L: Lane>(a: &[L; 5]) -> L {
    let tangential = a[0].mul_add(a[0], a[1] * a[1]);
    tangential + a[2].mul_add(a[2], a[3].mul_add(a[3], a[4] * a[4]))
}

/// Ground force on every body, averaged over the step.
#[inline(always)]
pub fn store_forces<L: Lane>(model: &Model<L>, group: &mut Group<L>) {
    let rate = L::of(1.0 / model.dt);
    let scale = group.parameters.friction[0] * rate;
    for (body, force) in model.bodies.iter().zip(&mut group.state.ground_force) {
        *force = Vec3::zero();
        for impulse in &group.state.contacts[body.first_point..][..body.points.len()] {
            let [x, y, ..] = impulse.friction;
            *force = force.plus(Vec3::new(x * scale, y * scale, impulse.normal * rate));
        }
    }
}
