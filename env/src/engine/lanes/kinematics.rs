//! Poses, motion subspaces and velocities from the base outward.

use super::group::State;
use super::lane::Lane;
use super::model::{JointModel, Model};
use super::series::sin_cos;
use super::spatial::Motion;
use super::vector::{Mat3, Vec3};
use super::work::{LinkWork, Work};
use crate::robot::JointKind;

/// Fills pose and velocity of every link, and the subspaces.
#[inline(always)]
pub fn place_links<L: Lane>(model: &Model<L>, state: &State<L>, work: &mut Work<L>) {
    place_base(state, &mut work.links[0]);
    for j in 0..model.joints.len() {
        place_link(model, state, work, j);
    }
    add_subspaces(model, work);
}

/// Fills pose and velocity of the base link.
#[inline(always)]
pub fn place_base<L: Lane>(state: &State<L>, base: &mut LinkWork<L>) {
    base.rotation = Mat3::rotation(&state.orientation);
    base.position = Vec3::zero();
    base.velocity = state.velocity;
}

/// Fills pose and velocity of the link that joint `j` carries, and the joint's subspace; the parent is done.
#[inline(always)]
pub fn place_link<L: Lane>(model: &Model<L>, state: &State<L>, work: &mut Work<L>, j: usize) {
    let joint = &model.joints[j];
    let d = joint.dof - model.root;
    let position = L::splat(joint.ratio).mul_add(state.joint_position[d], L::splat(joint.offset));
    let (above, below) = work.links.split_at_mut(j + 1);
    let (parent, link) = (&above[joint.parent], &mut below[0]);
    let subspace = place(joint, position, parent, link);
    work.subspaces[j] = subspace;
    link.velocity = parent.velocity.plus(subspace.times(state.joint_velocity[d]));
}

/// Fills the subspaces that are sums of joints' own.
#[inline(always)]
pub fn add_subspaces<L: Lane>(model: &Model<L>, work: &mut Work<L>) {
    for (k, &(a, b)) in model.sums.iter().enumerate() {
        work.subspaces[model.joints.len() + k] = work.subspaces[a].plus(work.subspaces[b]);
    }
}

/// Places the joint's link and returns the joint's subspace.
#[inline(always)]
fn place<L: Lane>(joint: &JointModel<L>, position: L, parent: &LinkWork<L>, link: &mut LinkWork<L>) -> Motion<L> {
    let origin = parent
        .position
        .plus(parent.rotation.apply(Vec3::splat(joint.translation)));
    let axis = parent.rotation.apply(Vec3::splat(joint.axis));
    let scaled = axis.times(L::splat(joint.ratio));
    match joint.kind {
        JointKind::Revolute => {
            link.rotation = parent.rotation.multiply(&turned(joint, position));
            link.position = origin;
            Motion {
                linear: origin.cross(scaled),
                angular: scaled,
            }
        }
        JointKind::Prismatic => {
            link.rotation = parent.rotation.multiply(&constant(&joint.rest));
            link.position = origin.plus_scaled(axis, position);
            Motion {
                linear: scaled,
                angular: Vec3::zero(),
            }
        }
    }
}

/// The child's rotation in the parent at `angle` (Rodrigues' formula).
#[inline(always)]
fn turned<L: Lane>(joint: &JointModel<L>, angle: L) -> Mat3<L> {
    let (sin, cos) = sin_cos(angle);
    let versine = L::of(1.0) - cos;
    Mat3([
        turned_row(joint, 0, sin, versine),
        turned_row(joint, 1, sin, versine),
        turned_row(joint, 2, sin, versine),
    ])
}

#[inline(always)]
fn turned_row<L: Lane>(joint: &JointModel<L>, i: usize, sin: L, versine: L) -> Vec3<L> {
    Vec3::splat(joint.rest[i])
        .plus_scaled(Vec3::splat(joint.turn_sin[i]), sin)
        .plus_scaled(Vec3::splat(joint.turn_cos[i]), versine)
}

#[inline(always)]
fn constant<L: Lane>(m: &[[L::Scalar; 3]; 3]) -> Mat3<L> {
    Mat3([Vec3::splat(m[0]), Vec3::splat(m[1]), Vec3::splat(m[2])])
}
