//! Contact points against the ground: regularised normal impulses; `friction` has the rest.
//!
//! A point at gap `phi < 0` is pushed by a spring and a damper, `F = -k phi' - d v'`, with gap and
//! velocity at the end of the step; as a row, `v' + F dt / (dt (dt k + d)) = -phi k / (dt k + d)`, where the
//! push-out speed on the right is bounded. A point within reach above the ground may not move by more than its gap in a
//! step. k and d are [`STIFFNESS`] and [`DAMPING`] of one point: a 17 kg robot on eight points sinks in by 0.2 mm.

use super::factor::plus_column;
use super::friction::{Cone, rub};
use super::group::{ContactImpulse, Group};
use super::lane::Lane;
use super::model::{ContactBody, Model, ROOT};
use super::spatial::{Force, Motion};
use super::tilt::Tilt;
use super::vector::{Sym3, Vec3};
use super::work::{BodyWork, LinkWork, PointWork, Work};
use crate::ground::Ground;

/// Normal stiffness of a contact point, N/m.
pub const STIFFNESS: f64 = 1e5;
/// Normal damping of a contact point, N s/m.
pub const DAMPING: f64 = 1e3;
/// Fastest push-out of a point below the ground, m/s.
const PUSH_OUT: f64 = 1.0;
/// Points farther above the ground than this do not take part, m: a point that falls at 10 m/s meets the ground in time at 200 Hz.
const REACH: f64 = 0.05;

/// How the spring and damper of a point give way over a step.
#[derive(Clone, Copy)]
pub struct Give {
    /// Push-out speed per depth, 1/s.
    recovery: f64,
    /// Approach speed per unit of impulse, 1/kg.
    softness: f64,
}

impl Give {
    /// Over a step of `dt` s, with contacts `hardness` times as hard: as hard as a step that is shorter by that factor allows.
    pub fn new(dt: f64, hardness: f64) -> Self {
        let (stiffness, damping) = (hardness * hardness * STIFFNESS, hardness * DAMPING);
        Self {
            recovery: stiffness / (dt * stiffness + damping),
            softness: 1.0 / (dt * (dt * stiffness + damping)),
        }
    }
}

/// After the factorisation: every body's response, its points, and the warm start.
#[inline(always)]
pub fn prepare<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    if model.ground == Ground::Plane {
        prepare_on::<L, false>(model, group, work);
    } else {
        prepare_on::<L, true>(model, group, work);
    }
}

/// The level plane has its own copy of everything that is done often: its normal is the z axis everywhere, and the tangents are
/// x and y.
#[inline(always)]
fn prepare_on<L: Lane, const TILTED: bool>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    let base_height = L::load(&group.state.position[2]);
    for (b, body) in model.bodies.iter().enumerate() {
        let link = work.links[body.link];
        let centre = centre(&link, body);
        let target = &mut work.bodies[b];
        target.active = false;
        for (p, (point, &position)) in target.points.iter_mut().zip(&body.points).enumerate() {
            let position = link.position.plus(link.rotation.apply(Vec3::splat(position)));
            point.arm = position.minus(centre);
            let gap = if TILTED {
                target.tilts[p].place(&model.ground, &group.state, position)
            } else {
                base_height + position.z
            };
            target.active |= gap.any_lt(L::of(REACH));
            place_point(point, gap, model);
        }
        let impulses = &mut group.state.contacts[body.first_point..][..body.points.len()];
        if !target.active {
            for impulse in impulses {
                impulse.normal = L::zero();
                impulse.friction = [L::zero(); 5];
            }
            continue;
        }
        target.velocity = link.velocity.at(centre).array();
        half_solve_wrenches(model, body, centre, &work.subspaces, &work.inverse, &mut target.columns);
        target.response = gram(&target.columns);
        let cone = Cone::new(&group.parameters.friction, model.dt);
        let turning = turning(&target.response);
        if !TILTED {
            target.turning = cone.turning_block(&turning);
        }
        let mut wrench = Force::zero();
        for (p, (point, impulse)) in target.points.iter_mut().zip(impulses).enumerate() {
            let tilt = if TILTED {
                let tilt = &mut target.tilts[p];
                tilt.turning = cone.turning_block(&tilt.matrix(&turning));
                Some(&*tilt)
            } else {
                None
            };
            point_response(&target.response, point, tilt, &cone, model.give.softness);
            let [o, reach] = [L::zero(), point.normal_max];
            impulse.normal = o.select_lt(reach, impulse.normal, o);
            for f in &mut impulse.friction {
                *f = o.select_lt(reach, *f, o);
            }
            wrench = wrench.plus(point_wrench(point, tilt, impulse, &cone));
        }
        add_wrench(body, target, wrench.array(), &mut work.change);
    }
}

/// The normal row's bias and bound.
#[inline(always)]
fn place_point<L: Lane>(point: &mut PointWork<L>, gap: L, model: &Model<L>) {
    let recovery = (gap * L::of(model.give.recovery)).max(L::of(-PUSH_OUT));
    point.bias = gap.select_lt(L::zero(), recovery, gap * L::of(1.0 / model.dt));
    point.normal_max = gap.select_lt(L::of(REACH), L::of(f32::MAX.into()), L::zero());
}

/// The transposed Jacobian of the body's twist at its reference point, one row a degree of freedom of its path: what
/// [`half_solve_wrenches`] makes of it with the identity for an inverse.
#[cfg(test)]
pub fn body_jacobian<L: Lane>(model: &Model<L>, body: &ContactBody<L>, work: &Work<L>) -> Vec<[L; 6]> {
    let mut columns = vec![[L::zero(); 6]; body.path.len()];
    let mut identity = vec![L::zero(); model.entries];
    for row in &model.rows {
        identity[row.diagonal()] = L::of(1.0);
    }
    let centre = centre(&work.links[body.link], body);
    half_solve_wrenches(model, body, centre, &work.subspaces, &identity, &mut columns);
    columns
}

/// The body's reference point, relative to the base link's origin.
#[inline(always)]
fn centre<L: Lane>(link: &LinkWork<L>, body: &ContactBody<L>) -> Vec3<L> {
    link.position.plus(link.rotation.apply(Vec3::splat(body.centre)))
}

/// The unit wrenches at `centre`, half-solved: `X^T J^T` with the Jacobian J of the body's twist there, one row a degree of
/// freedom of its path.
#[inline(always)]
fn half_solve_wrenches<L: Lane>(
    model: &Model<L>,
    body: &ContactBody<L>,
    centre: Vec3<L>,
    subspaces: &[Motion<L>],
    inverse: &[L],
    columns: &mut [[L; 6]],
) {
    jacobian(model, body, centre, subspaces, columns);
    let path = &body.path;
    for j in 0..path.len() {
        let (from, root) = if j < model.root {
            (model.root, base_twist(inverse, j).at(centre).array())
        } else {
            (j, [L::zero(); 6])
        };
        columns[j] = plus_column(&model.rows, inverse, path, j, from, columns, root);
    }
}

/// The base's part of column `j` of the inverse: with the base's own velocities for degrees of freedom, its Jacobian is the
/// identity.
#[inline(always)]
fn base_twist<L: Lane>(inverse: &[L], j: usize) -> Motion<L> {
    let mut column = [L::zero(); ROOT];
    for (i, entry) in (j..).zip(&mut column[j..]) {
        *entry = inverse[i * (i + 1) / 2 + j];
    }
    let [x, y, z, a, b, c] = column;
    Motion {
        linear: Vec3::new(x, y, z),
        angular: Vec3::new(a, b, c),
    }
}

/// The transposed Jacobian of the body's twist at `centre`: one row a degree of freedom of its path. The base's rows are left
/// out.
#[inline(always)]
fn jacobian<L: Lane>(
    model: &Model<L>,
    body: &ContactBody<L>,
    centre: Vec3<L>,
    subspaces: &[Motion<L>],
    columns: &mut [[L; 6]],
) {
    for (column, subspace) in columns[model.root..].iter_mut().zip(&body.subspaces[model.root..]) {
        *column = match *subspace {
            Some(s) => subspaces[s].at(centre).array(),
            None => [L::zero(); 6],
        };
    }
}

/// `Y^T Y`
#[inline(always)]
fn gram<L: Lane>(columns: &[[L; 6]]) -> [[L; 6]; 6] {
    let mut lower = [[L::zero(); 6]; 6];
    for y in columns {
        for (r, row) in lower.iter_mut().enumerate() {
            for (sum, x) in row[..=r].iter_mut().zip(y) {
                *sum = y[r].mul_add(*x, *sum);
            }
        }
    }
    let mut whole = lower;
    for (r, row) in lower.iter().enumerate() {
        for (c, x) in row[..r].iter().enumerate() {
            whole[c][r] = *x;
        }
    }
    whole
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

/// Turning velocity per unit of moment.
#[inline(always)]
fn turning<L: Lane>(response: &[[L; 6]; 6]) -> Sym3<L> {
    Sym3 {
        xx: response[3][3],
        xy: response[4][3],
        xz: response[5][3],
        yy: response[4][4],
        yz: response[5][4],
        zz: response[5][5],
    }
}

/// The point's inverse inertias: its normal row, and in scaled coordinates how sliding answers to sliding and turning.
#[inline(always)]
fn point_response<L: Lane>(
    response: &[[L; 6]; 6],
    point: &mut PointWork<L>,
    tilt: Option<&Tilt<L>>,
    cone: &Cone<L>,
    softness: f64,
) {
    let arm = point.arm;
    // Motion of the point per wrench at the reference point: rows shift, linear += angular x arm.
    let mut rows = [[L::zero(); 6]; 3];
    for c in 0..6 {
        let linear = Vec3::new(response[0][c], response[1][c], response[2][c]);
        let angular = Vec3::new(response[3][c], response[4][c], response[5][c]);
        let shifted = linear.plus_cross(angular, arm);
        rows[0][c] = shifted.x;
        rows[1][c] = shifted.y;
        rows[2][c] = shifted.z;
    }
    // A force at the point acts at the reference point with moment arm x force: the columns shift like the rows.
    let mut rows = [
        at_point(&rows[0], arm),
        at_point(&rows[1], arm),
        at_point(&rows[2], arm),
    ];
    if let Some(tilt) = tilt {
        rows = tilt.rows(&rows);
        rows = [tilt.twist(&rows[0]), tilt.twist(&rows[1]), tilt.twist(&rows[2])];
    }
    let [along_x, along_y, normal] = rows;
    point.normal_step = (normal[2] + L::of(softness)).recip();
    cone.couple(point, &[along_x, along_y, normal]);
}

/// The wrench of a point's impulse about the body's reference point.
#[inline(always)]
fn point_wrench<L: Lane>(
    point: &PointWork<L>,
    tilt: Option<&Tilt<L>>,
    impulse: &ContactImpulse<L>,
    cone: &Cone<L>,
) -> Force<L> {
    let [x, y, a, b, c] = cone.components(&impulse.friction);
    let mut own = Force {
        force: Vec3::new(x, y, impulse.normal),
        moment: Vec3::new(a, b, c),
    };
    if let Some(tilt) = tilt {
        own = tilt.force(own);
    }
    Force {
        force: own.force,
        moment: own.moment.plus_cross(point.arm, own.force),
    }
}

/// `u = u + Y wrench`
#[inline(always)]
fn add_wrench<L: Lane>(body: &ContactBody<L>, work: &BodyWork<L>, wrench: [L; 6], change: &mut [L]) {
    for (column, &k) in work.columns.iter().zip(&body.path) {
        change[k] = plus_dot6(change[k], column, &wrench);
    }
}

/// `sum + a . b`
#[inline(always)]
fn plus_dot6<L: Lane>(sum: L, a: &[L; 6], b: &[L; 6]) -> L {
    let linear = a[0].mul_add(b[0], a[1].mul_add(b[1], a[2].mul_add(b[2], sum)));
    linear + a[3].mul_add(b[3], a[4].mul_add(b[4], a[5] * b[5]))
}

/// Visits every body that may touch: its points see the body's twist, the rest of the robot the body's total wrench.
#[inline(always)]
pub fn sweep<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    if model.ground == Ground::Plane {
        sweep_on::<L, false>(model, group, work);
    } else {
        sweep_on::<L, true>(model, group, work);
    }
}

#[inline(always)]
fn sweep_on<L: Lane, const TILTED: bool>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
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
        let last = body.points.len() - 1;
        for (p, (point, impulse)) in target.points.iter().zip(impulses).enumerate() {
            let tilt = if TILTED { Some(&target.tilts[p]) } else { None };
            let mut velocity = at_point(&twist, point.arm);
            let mut turning = &target.turning;
            if let Some(tilt) = tilt {
                velocity = tilt.twist(&velocity);
                turning = &tilt.turning;
            }
            let normal = push(point, impulse, velocity[2], model.give.softness);
            let friction = rub(point, turning, impulse, &velocity, normal, &cone);
            let change = point_wrench(point, tilt, &ContactImpulse { normal, friction }, &cone);
            wrench = wrench.plus(change);
            // Nobody looks at the twist after the last point.
            if p < last {
                let change = change.array();
                for (v, response) in twist.iter_mut().zip(&target.response) {
                    *v = plus_dot6(*v, response, &change);
                }
            }
        }
        add_wrench(body, target, wrench.array(), &mut work.change);
    }
}

/// Projects the normal impulse; returns its change.
#[inline(always)]
fn push<L: Lane>(point: &PointWork<L>, impulse: &mut ContactImpulse<L>, velocity: L, softness: f64) -> L {
    let old = impulse.normal;
    let approach = velocity + L::of(softness).mul_add(old, point.bias);
    impulse.normal = point
        .normal_step
        .neg_mul_add(approach, old)
        .clamp(L::zero(), point.normal_max);
    impulse.normal - old
}

/// Ground force on every body, averaged over the step.
#[inline(always)]
pub fn store_forces<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &Work<L>) {
    let rate = L::of(1.0 / model.dt);
    let scale = group.parameters.friction[0] * rate;
    for ((body, target), force) in model.bodies.iter().zip(&work.bodies).zip(&mut group.state.ground_force) {
        *force = Vec3::zero();
        for (p, impulse) in group.state.contacts[body.first_point..][..body.points.len()]
            .iter()
            .enumerate()
        {
            let [x, y, ..] = impulse.friction;
            let own = Vec3::new(x * scale, y * scale, impulse.normal * rate);
            *force = force.plus(target.tilts.get(p).map_or(own, |tilt| tilt.in_world(own)));
        }
    }
}
