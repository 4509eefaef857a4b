//! Drives, dry friction and limits: one visit per degree of freedom and sweep.
//!
//! With the velocity change x of the step, the drive's impulse is `P(x) = clamp(P0 - c x)`, where P0 is the impulse at
//! the old velocity and `c = dt (dt stiffness + damping)`. Where P0 lies within the clamp, c goes to the diagonal of
//! the mass matrix and the solve is exact; where it does not, the clamped impulse is a constant. A row corrects both
//! where the clamp turns out otherwise: an extra impulse e, at a joint whose velocity answers with `g e`, changes the
//! drive's total impulse by `e (1 - c g)` in the implicit and by e in the constant case.

use super::factor::half_solve_unit;
use super::group::Group;
use super::lane::Lane;
use super::model::Model;
use super::work::{JointRow, Work};

/// Share of a limit's violation that is undone in a step.
const LIMIT_RECOVERY: f64 = 0.2;
/// Fastest recovery from a violated limit, rad/s or m/s.
const LIMIT_RECOVERY_SPEED: f64 = 2.0;

/// Before the factorisation: the drives' impulses and their part of the diagonal.
#[inline(always)]
pub fn apply_drives<L: Lane>(model: &Model<L>, group: &Group<L>, work: &mut Work<L>) {
    let dt = L::of(model.dt);
    for (d, drive) in group.drive.iter().enumerate() {
        let (q, v) = (group.state.joint_position[d], group.state.joint_velocity[d]);
        let row = &mut work.rows[d];
        let error = drive.target - dt.mul_add(v, q);
        let torque = drive
            .stiffness
            .mul_add(error, drive.damping.neg_mul_add(v, drive.feed_forward));
        row.drive_impulse = dt * torque;
        row.drive_slope = dt * dt.mul_add(drive.stiffness, drive.damping);
        row.drive_min = dt * drive.torque_min;
        row.drive_max = dt * drive.torque_max;
        row.drive_start = row.drive_impulse.clamp(row.drive_min, row.drive_max);
        let (saturated, free) = (L::zero(), L::of(1.0));
        let below = row.drive_max.select_lt(row.drive_impulse, saturated, free);
        row.implicit = row.drive_impulse.select_lt(row.drive_min, saturated, below);
        work.change[model.root + d] += row.drive_start;
        work.mass_matrix[model.rows[model.root + d].diagonal()] += row.implicit * row.drive_slope;
        row.drive_extra = L::zero();
        row.friction = dt * drive.friction;
        let (lower, upper) = model.limits[d];
        row.velocity_min = -allowed_speed(q - L::splat(lower), model.dt);
        row.velocity_max = allowed_speed(L::splat(upper) - q, model.dt);
    }
}

/// The speed towards a limit at distance `gap` that just reaches it in a step; negative to come back to it.
#[inline(always)]
fn allowed_speed<L: Lane>(gap: L, dt: f64) -> L {
    let back = (gap * L::of(LIMIT_RECOVERY / dt)).max(L::of(-LIMIT_RECOVERY_SPEED));
    gap.select_lt(L::zero(), back, gap * L::of(1.0 / dt))
}

/// After the factorisation: every joint's answer to an impulse, and the warm start.
#[inline(always)]
pub fn prepare_rows<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    let one = L::of(1.0);
    for d in 0..model.limits.len() {
        let k = model.root + d;
        let path = &model.rows[k];
        let column = &mut work.columns[path.start..=path.diagonal()];
        half_solve_unit(&model.rows, &work.mass_matrix, &work.inverse_diagonal, k, column);
        let mut response = L::zero();
        for y in &*column {
            response = y.mul_add(*y, response);
        }
        let row = &mut work.rows[d];
        row.response = response;
        row.inverse_response = response.recip();
        let answer = row.drive_slope * response;
        // Implicit on the diagonal, `answer` is below one but for rounding.
        let left = (row.implicit.neg_mul_add(answer, one)).max(L::of(1e-6));
        row.drive_gain = left.recip();
        row.drive_relax = left / (one - row.implicit).mul_add(answer, one);
        let state = &mut group.state;
        state.friction_impulse[d] = state.friction_impulse[d].clamp(-row.friction, row.friction);
        let warm = state.friction_impulse[d] + state.limit_impulse[d];
        add_impulse(&path.ancestors, k, column, warm, &mut work.change);
    }
}

/// Projects the drive, friction and limit impulses of every joint onto their bounds in turn.
#[inline(always)]
pub fn sweep<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    let state = &mut group.state;
    for d in 0..model.limits.len() {
        let k = model.root + d;
        let path = &model.rows[k];
        let column = &work.columns[path.start..=path.diagonal()];
        let row = &mut work.rows[d];
        let before = velocity_change(&path.ancestors, k, column, &work.change);
        let mut x = before;
        x = row.response.mul_add(project_drive(row, x), x);
        let v = state.joint_velocity[d];

        let friction = &mut state.friction_impulse[d];
        let next = row
            .inverse_response
            .neg_mul_add(v + x, *friction)
            .clamp(-row.friction, row.friction);
        x = row.response.mul_add(next - *friction, x);
        *friction = next;

        let limit = &mut state.limit_impulse[d];
        let free = row.response.neg_mul_add(*limit, v + x);
        let next = (free.clamp(row.velocity_min, row.velocity_max) - free) * row.inverse_response;
        x = row.response.mul_add(next - *limit, x);
        *limit = next;

        add_impulse(
            &path.ancestors,
            k,
            column,
            (x - before) * row.inverse_response,
            &mut work.change,
        );
    }
}

/// The drive's impulse at a velocity change of `x`, the extra one included.
#[inline(always)]
fn drive_total<L: Lane>(row: &JointRow<L>, x: L) -> L {
    let linear = row.drive_slope.neg_mul_add(x, row.drive_impulse);
    L::of(0.5).select_lt(row.implicit, linear, row.drive_start) + row.drive_extra
}

/// Corrects the drive at a velocity change of `x`; returns the change of its impulse.
#[inline(always)]
fn project_drive<L: Lane>(row: &mut JointRow<L>, x: L) -> L {
    let total = drive_total(row, x);
    let linear = row.drive_slope.neg_mul_add(x, row.drive_impulse);
    let next = (linear - total)
        .mul_add(row.drive_relax, total)
        .clamp(row.drive_min, row.drive_max);
    let change = (next - total) * row.drive_gain;
    row.drive_extra += change;
    change
}

/// The drives' torques at the end of the sweeps.
#[inline(always)]
pub fn store_torques<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &Work<L>) {
    let rate = L::of(1.0 / model.dt);
    for (d, row) in work.rows.iter().enumerate() {
        let k = model.root + d;
        let path = &model.rows[k];
        let column = &work.columns[path.start..=path.diagonal()];
        let x = velocity_change(&path.ancestors, k, column, &work.change);
        let drive = &group.drive[d];
        group.state.torque[d] = (drive_total(row, x) * rate).clamp(drive.torque_min, drive.torque_max);
    }
}

/// `y . u`
#[inline(always)]
fn velocity_change<L: Lane>(ancestors: &[usize], k: usize, column: &[L], change: &[L]) -> L {
    // Four sums at once: one would wait for every product.
    let [mut p, mut q, mut r, mut s] = [column[ancestors.len()] * change[k], L::zero(), L::zero(), L::zero()];
    for (y, a) in column.chunks_exact(4).zip(ancestors.chunks_exact(4)) {
        p = y[0].mul_add(change[a[0]], p);
        q = y[1].mul_add(change[a[1]], q);
        r = y[2].mul_add(change[a[2]], r);
        s = y[3].mul_add(change[a[3]], s);
    }
    let whole = ancestors.len() & !3;
    for (y, &a) in column[whole..].iter().zip(&ancestors[whole..]) {
        q = y.mul_add(change[a], q);
    }
    (p + q) + (r + s)
}

/// `u = u + y impulse`
#[inline(always)]
fn add_impulse<L: Lane>(ancestors: &[usize], k: usize, column: &[L], impulse: L, change: &mut [L]) {
    for (y, &a) in column.iter().zip(ancestors) {
        change[a] = y.mul_add(impulse, change[a]);
    }
    change[k] = column[ancestors.len()].mul_add(impulse, change[k]);
}
