//! A robot of one joint on a fixed base that touches nothing: its inertia is constant and its weight's torque a sine of the angle (of
//! a slide's position not even that), so both are found once instead of in every step. A rig's servo costs half without its links.

use super::dynamics;
use super::group::Group;
use super::joint;
use super::lane::Lane;
use super::model::Model;
use super::series::sin_cos;
use super::work::Work;
use crate::robot::JointKind;

/// What does not change while the worlds' parameters do not.
pub struct OneJoint<L> {
    inertia: L,
    /// Bias force at zero, and at a quarter turn.
    weight: [L; 2],
}

/// Change of velocity in a step, as [`super::step`] finds it of robots of more joints; links, subspaces and the rest of `work` stay as they
/// are. Every number is in a register: half a step's time went into finding the one entry of each list.
#[inline(always)]
pub fn change<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) -> L {
    let (inertia, bias) = mass_and_bias(model, group, work);
    let (dt, state) = (L::of(model.dt), &mut group.state);
    let (q, v) = (state.joint_position[0], state.joint_velocity[0]);
    let viscous = dt * group.parameters.damping[0];
    let (mut row, drive) = (work.rows[0], &group.drive[0]);
    let smooth = viscous.neg_mul_add(v, -(dt * bias));
    let impulse = smooth + joint::begin_row(&mut row, drive, (q, v), model.limits[0], model.dt);
    let mass = inertia + (group.parameters.armature[0] + viscous) + row.held_slope;
    // Velocities are scaled by the factor as with more joints, so that what both share is one.
    let inverse = mass.sqrt().recip();
    joint::finish_row(&mut row, inverse * inverse);
    // Adding a zero impulse must not change a bit, so there is no negative zero to turn positive.
    let mut scaled = inverse.mul_add(state.joint_impulse[0], inverse * impulse + L::zero());
    for _ in 0..model.sweeps {
        let x = inverse * scaled + L::zero();
        let more = joint::project(&mut row, &mut state.joint_impulse[0], v, x);
        scaled = inverse.mul_add(more, scaled);
    }
    let change = inverse * scaled + L::zero();
    state.torque[0] = joint::torque(&row, drive, change, model.dt);
    change
}

/// Mass and bias force as [`dynamics::outward`] and [`dynamics::inward`] find them.
#[inline(always)]
pub fn mass_and_bias<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) -> (L, L) {
    if group.one_joint.is_none() {
        group.one_joint = Some(look(model, group, work));
    }
    let Some(OneJoint { inertia, weight }) = &group.one_joint else {
        return (L::zero(), L::zero());
    };
    let bias = match model.joints[0].kind {
        JointKind::Revolute => {
            let (sin, cos) = sin_cos(group.state.joint_position[0]);
            sin.mul_add(weight[1], cos * weight[0])
        }
        JointKind::Prismatic => weight[0],
    };
    (*inertia, bias)
}

/// By the links' algorithms, with the joint at rest.
fn look<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) -> OneJoint<L> {
    let state = (group.state.joint_position[0], group.state.joint_velocity[0]);
    group.state.joint_velocity[0] = L::zero();
    let weight = [0.0, std::f64::consts::FRAC_PI_2].map(|angle| {
        group.state.joint_position[0] = L::of(angle);
        dynamics::outward(model, group, work);
        dynamics::inward(model, work);
        work.bias[0]
    });
    (group.state.joint_position[0], group.state.joint_velocity[0]) = state;
    OneJoint {
        inertia: work.mass_matrix[0],
        weight,
    }
}
