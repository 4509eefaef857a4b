//! A robot of one joint on a fixed base that touches nothing: its inertia is constant and its weight's torque a sine of the angle (of
//! a slide's position not even that), so both are found once instead of in every step. A rig's servo costs half without its links.

use super::dynamics;
use super::group::Group;
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

/// Fills bias force and mass matrix as [`dynamics::outward`] and [`dynamics::inward`] do; links and subspaces stay as they are.
#[inline(always)]
pub fn fill<L: Lane>(model: &Model<L>, group: &mut Group<L>, work: &mut Work<L>) {
    if group.one_joint.is_none() {
        group.one_joint = Some(look(model, group, work));
    }
    let Some(OneJoint { inertia, weight }) = &group.one_joint else {
        return;
    };
    work.mass_matrix[0] = *inertia;
    work.bias[0] = match model.joints[0].kind {
        JointKind::Revolute => {
            let (sin, cos) = sin_cos(group.state.joint_position[0]);
            sin.mul_add(weight[1], cos * weight[0])
        }
        JointKind::Prismatic => weight[0],
    };
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
