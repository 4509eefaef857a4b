//! Drives, dry friction and limits: one visit per degree of freedom and sweep.
//!
//! **Drive.** With the velocity change x of the step, the drive's impulse is `P(x) = clamp(P0 - c x)`, where P0 is the impulse
//! at the old velocity and `c = dt (dt stiffness + damping)`. Where P0 lies within the clamp, c goes to the diagonal of
//! the mass matrix and the drive holds `P0 - c x` of itself; where it does not, it holds the clamped P0. A visit finds
//! the extra impulse e that makes up for what the clamp turns out to be. With g the joint's velocity per unit of
//! impulse and y the velocity change without e, the implicit drive needs `e = (clamp(P0 - c y) - (P0 - c y)) / (1 - c g)`,
//! the held one `e = clamp((P0 - c (y - g S)) / (1 + c g)) - S` with its impulse S: both are
//! `(clamp(wanted - wanted_slope y) - (held - held_slope y)) gain`, and the gain is in all six numbers.
//!
//! **Dry friction and limits** are one impulse: of the velocity without it, friction takes up to g times its bound, and
//! what the limits do not allow of the rest is taken as well (the proximal map of the sum of both potentials).
//!
//! A row that has nothing to do changes no bit of anything, so it ends where its impulses are seen to stay: most joints
//! of most robots cost the product that finds their velocity.

use super::factor::row_product;
use super::group::{Group, JointDrive};
use super::lane::Lane;
use super::model::Model;
use super::work::{JointRow, Work};

/// Share of a limit's violation that is undone in a step.
pub const LIMIT_RECOVERY: f64 = 0.2;
/// Fastest recovery from a violated limit, rad/s or m/s.
const LIMIT_RECOVERY_SPEED: f64 = 2.0;

/// Before the factorisation: the drives' impulses and their part of the diagonal.
#[inline(always)]
pub fn apply_drives<L: Lane>(model: &Model<L>, group: &Group<L>, work: &mut Work<L>) {
    for (d, drive) in group.drive.iter().enumerate() {
        let state = (group.state.joint_position[d], group.state.joint_velocity[d]);
        let row = &mut work.rows[d];
        let start = begin_row(row, drive, state, model.limits[d], model.dt);
        work.change[model.root + d] += start;
        work.mass_matrix[model.rows[model.root + d].diagonal()] += row.held_slope;
    }
}

/// Fills what of a row does not depend on its response, at position and velocity `(q, v)` between the limits; returns the drive's impulse
/// and leaves its part of the diagonal in `held_slope`.
#[inline(always)]
pub fn begin_row<L: Lane>(
    row: &mut JointRow<L>,
    drive: &JointDrive<L>,
    (q, v): (L, L),
    (lower, upper): (L::Scalar, L::Scalar),
    step: f64,
) -> L {
    let dt = L::of(step);
    let error = drive.target - dt.mul_add(v, q);
    let torque = drive
        .stiffness
        .mul_add(error, drive.damping.neg_mul_add(v, drive.feed_forward));
    row.wanted = dt * torque;
    row.wanted_slope = dt * dt.mul_add(drive.stiffness, drive.damping);
    row.drive_min = dt * drive.torque_min;
    row.drive_max = dt * drive.torque_max;
    let start = row.wanted.clamp(row.drive_min, row.drive_max);
    let start = whole(drive, torque, start);
    row.held = start;
    row.held_slope = implicit(row, row.wanted_slope, L::zero());
    row.drive_extra = L::zero();
    row.friction_speed = dt * drive.friction;
    row.velocity_min = -allowed_speed(q - L::splat(lower), step);
    row.velocity_max = allowed_speed(L::splat(upper) - q, step);
    start
}

/// `impulse`, or not a number where a number of the drive is none: the clamps would swallow it and the world stand as if sound.
#[inline(always)]
fn whole<L: Lane>(drive: &JointDrive<L>, torque: L, impulse: L) -> L {
    let sound = L::zero() * torque + (drive.torque_max - drive.torque_min) + drive.friction;
    L::of(f64::NEG_INFINITY).select_lt(sound, impulse, L::of(f64::NAN))
}

/// `yes` where the drive's impulse lies within its clamp at the old velocity, else `no`.
#[inline(always)]
fn implicit<L: Lane>(row: &JointRow<L>, yes: L, no: L) -> L {
    let below = row.drive_max.select_lt(row.wanted, no, yes);
    row.wanted.select_lt(row.drive_min, no, below)
}

/// The speed towards a limit at distance `gap` that just reaches it in a step; negative to come back to it.
#[inline(always)]
fn allowed_speed<L: Lane>(gap: L, dt: f64) -> L {
    let back = (gap * L::of(LIMIT_RECOVERY / dt)).max(L::of(-LIMIT_RECOVERY_SPEED));
    gap.select_lt(L::zero(), back, gap * L::of(1.0 / dt))
}

/// After the factorisation: every joint's answer to an impulse, and the warm start.
#[inline(always)]
pub fn prepare_rows<L: Lane>(model: &Model<L>, group: &Group<L>, work: &mut Work<L>) {
    for d in 0..model.limits.len() {
        let k = model.root + d;
        let path = &model.rows[k];
        let column = &work.inverse[path.start..=path.diagonal()];
        let mut response = L::zero();
        for y in column {
            response = y.mul_add(*y, response);
        }
        finish_row(&mut work.rows[d], response);
        let warm = group.state.joint_impulse[d];
        if warm.any_ne(L::zero()) {
            add_impulse(&path.ancestors, k, column, warm, &mut work.change);
        }
    }
}

/// What of a row depends on its response.
#[inline(always)]
pub fn finish_row<L: Lane>(row: &mut JointRow<L>, response: L) {
    let one = L::of(1.0);
    let answer = row.wanted_slope * response;
    // Implicit on the diagonal, `answer` is below one but for rounding.
    let divisor = implicit(row, (one - answer).max(L::of(1e-6)), one + answer);
    let inverse = divisor.recip();
    let (gain, inverse_gain) = (implicit(row, inverse, one), implicit(row, divisor, one));
    let share = implicit(row, one, inverse);
    let held = implicit(row, L::zero(), row.held);
    row.wanted = gain * (share * answer.mul_add(held, row.wanted));
    row.wanted_slope = gain * (share * row.wanted_slope);
    row.held = gain * row.held;
    row.held_slope = gain * row.held_slope;
    row.inverse_gain = inverse_gain;
    row.drive_min = gain * row.drive_min;
    row.drive_max = gain * row.drive_max;
    row.response = response;
    row.inverse_response = response.recip();
    row.friction_speed = response * row.friction_speed;
}

/// Projects the impulses of every joint's drive, dry friction and limits onto their bounds in turn.
#[inline(always)]
pub fn sweep<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    let state = &mut group.state;
    for d in 0..model.limits.len() {
        let k = model.root + d;
        let path = &model.rows[k];
        let x = row_product(path, k, &work.inverse, &work.change);
        let change = project(
            &mut work.rows[d],
            &mut state.joint_impulse[d],
            state.joint_velocity[d],
            x,
        );
        if change.any_ne(L::zero()) {
            let column = &work.inverse[path.start..=path.diagonal()];
            add_impulse(&path.ancestors, k, column, change, &mut work.change);
        }
    }
}

/// Projects a row's impulses at a velocity change of `x` from `velocity`; returns their total change, exactly zero where
/// they were zero and stay so.
#[inline(always)]
pub fn project<L: Lane>(row: &mut JointRow<L>, impulse: &mut L, velocity: L, x: L) -> L {
    // The next row waits for x to come through, so what does not need it stands apart.
    let g = row.response;
    let taken = g * row.drive_extra;
    let wanted = row.wanted_slope.mul_add(taken, row.wanted);
    let held = row.held_slope.mul_add(taken, row.held);
    let still = g.neg_mul_add(*impulse + row.drive_extra, velocity);

    let wanted = row.wanted_slope.neg_mul_add(x, wanted);
    let held = row.held_slope.neg_mul_add(x, held);
    let extra = wanted.clamp(row.drive_min, row.drive_max) - held;

    let still = x + still;
    let free = g.mul_add(extra, still);
    let forward = g.mul_add(extra, still - row.friction_speed);
    let backward = g.mul_add(extra, still + row.friction_speed);
    let slid = backward.min(L::zero()).max(forward);
    let missing = slid.clamp(row.velocity_min, row.velocity_max) - free;

    let change = missing.mul_add(row.inverse_response, (extra - row.drive_extra) - *impulse);
    row.drive_extra = extra;
    *impulse = missing * row.inverse_response;
    change
}

/// The drives' torques at the end of the step, from the change of velocity.
#[inline(always)]
pub fn store_torques<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &Work<L>) {
    for (d, row) in work.rows.iter().enumerate() {
        group.state.torque[d] = torque(row, &group.drive[d], work.change[model.root + d], model.dt);
    }
}

/// The drive's torque at the end of the step, whose velocity change is `x`.
#[inline(always)]
pub fn torque<L: Lane>(row: &JointRow<L>, drive: &JointDrive<L>, x: L, step: f64) -> L {
    let held = row.held_slope.neg_mul_add(x, row.held);
    let total = row.inverse_gain.mul_add(held, row.drive_extra);
    (total * L::of(1.0 / step)).clamp(drive.torque_min, drive.torque_max)
}

/// `u = u + y impulse`
#[inline(always)]
fn add_impulse<L: Lane>(ancestors: &[usize], k: usize, column: &[L], impulse: L, change: &mut [L]) {
    for (y, &a) in column.iter().zip(ancestors) {
        change[a] = y.mul_add(impulse, change[a]);
    }
    change[k] = column[ancestors.len()].mul_add(impulse, change[k]);
}
