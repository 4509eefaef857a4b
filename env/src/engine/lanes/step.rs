//! One physics step of a group of worlds.

use crate::engine::MAX_SPEED;

use super::contact;
use super::dynamics;
use super::factor;
use super::group::Group;
use super::joint;
use super::lane::{Lane, MAX_WIDTH};
use super::model::Model;
use super::one_joint;
use super::vector::Vec3;
use super::work::{
    CONTACT_SETUP, CONTACT_SWEEPS, FACTORISATION, FINISH, INWARD, JOINT_SETUP, JOINT_SWEEPS, OUTWARD, Timer, Work,
};

/// Semi-implicit Euler: velocities from the forces at the old positions (springs, dampers and constraints at the new
/// ones), then positions from the new velocities.
#[inline(always)]
pub fn step<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>, timer: &mut Timer) {
    timer.begin::<L>();
    if model.one_joint {
        let change = one_joint::change(model, group, work);
        timer.lap::<L>(JOINT_SWEEPS);
        integrate(model, group, &[change]);
        timer.lap::<L>(FINISH);
        return;
    }
    dynamics::outward(model, group, work);
    timer.lap::<L>(OUTWARD);
    dynamics::inward(model, work);
    dynamics::smooth_impulse(model, group, work);
    joint::apply_drives(model, group, work);
    timer.lap::<L>(INWARD);
    factor::factor(
        &model.rows,
        &model.outward,
        &mut work.mass_matrix,
        &mut work.inverse_diagonal,
    );
    factor::invert(
        &model.rows,
        &model.outward,
        &work.mass_matrix,
        &work.inverse_diagonal,
        &mut work.inverse,
    );
    factor::multiply_transposed(&model.rows, &work.inverse, &mut work.change);
    // Adding a zero impulse must not change a bit, so there is no negative zero to turn positive.
    for u in &mut work.change {
        *u += L::zero();
    }
    timer.lap::<L>(FACTORISATION);
    contact::prepare(model, group, work);
    timer.lap::<L>(CONTACT_SETUP);
    joint::prepare_rows(model, group, work);
    timer.lap::<L>(JOINT_SETUP);
    for _ in 0..model.sweeps {
        contact::sweep(model, group, work);
        timer.lap::<L>(CONTACT_SWEEPS);
        joint::sweep(model, group, work);
        timer.lap::<L>(JOINT_SWEEPS);
    }
    contact::store_forces(model, group, work);
    factor::multiply(&model.rows, &work.inverse, &mut work.change);
    joint::store_torques(model, group, work);
    integrate(model, group, &work.change);
    timer.lap::<L>(FINISH);
}

/// Adds the change of velocity and moves the positions.
#[inline(always)]
fn integrate<L: Lane>(model: &Model<L>, group: &mut Group<L>, change: &[L]) {
    let dt = L::of(model.dt);
    let state = &mut group.state;
    let mut fastest = L::zero();
    for (d, x) in change[model.root..].iter().enumerate() {
        let v = state.joint_velocity[d] + *x;
        state.joint_velocity[d] = v;
        state.joint_position[d] = dt.mul_add(v, state.joint_position[d]);
        fastest = exceeding(v, fastest);
    }
    if model.floating {
        let velocity = &mut state.velocity;
        velocity.linear = velocity.linear.plus(Vec3::new(change[0], change[1], change[2]));
        velocity.angular = velocity.angular.plus(Vec3::new(change[3], change[4], change[5]));
        for v in velocity.array() {
            fastest = exceeding(v, fastest);
        }
        state.orientation = state.orientation.turned(velocity.angular.times(dt));
        let mut speed = [0.0; MAX_WIDTH];
        for (position, v) in state.position.iter_mut().zip(velocity.linear.array()) {
            v.store(&mut speed);
            for (x, v) in position[..L::WIDTH].iter_mut().zip(&speed) {
                *x += model.dt * v;
            }
        }
    }
    state.broken = state.broken.max(fastest);
}

/// 1 where `v` is too fast or not a number, else `worst`.
#[inline(always)]
fn exceeding<L: Lane>(v: L, worst: L) -> L {
    v.abs().select_lt(L::of(MAX_SPEED), worst, L::of(1.0))
}
