//! Bias forces by the recursive Newton-Euler algorithm and the mass matrix by the composite-rigid-body algorithm
//! (Featherstone, Rigid Body Dynamics Algorithms, chapters 5 and 6), in world axes about the base link's origin.

use super::group::{Group, LinkInertia, Parameters};
use super::lane::Lane;
use super::model::Model;
use super::spatial::{Inertia, Motion};
use super::vector::Vec3;
use super::work::{LinkWork, Work};

/// Fills `work.bias` with the generalised force that holds all accelerations at zero: gravity and velocity products.
#[inline(always)]
pub fn bias_force<L: Lane>(model: &Model<L>, group: &Group<L>, work: &mut Work<L>) {
    let parameters = &group.parameters;
    let base = &mut work.links[0];
    // The generalised acceleration of a floating base is that of its origin, a point: the spatial one is less by w x v.
    let Motion { linear, angular } = base.velocity;
    let rest = Vec3::zero().minus(parameters.gravity).minus(angular.cross(linear));
    base.acceleration = Motion {
        linear: rest,
        angular: Vec3::zero(),
    };
    own_force(&parameters.links[0], base);
    for (j, joint) in model.joints.iter().enumerate() {
        let above = work.links[joint.parent].acceleration;
        let speed = group.state.joint_velocity[joint.dof - model.root];
        let link = &mut work.links[j + 1];
        link.acceleration = above.plus(link.velocity.cross(work.subspaces[j].times(speed)));
        own_force(&parameters.links[j + 1], link);
    }
    work.bias.fill(L::zero());
    for (j, joint) in model.joints.iter().enumerate().rev() {
        let force = work.links[j + 1].force;
        work.bias[joint.dof] += work.subspaces[j].dot(force);
        let parent = &mut work.links[joint.parent].force;
        *parent = parent.plus(force);
    }
    if model.floating {
        work.bias[..6].copy_from_slice(&work.links[0].force.array());
    }
}

/// Inertia of the link in world axes, and the force of its acceleration.
#[inline(always)]
fn own_force<L: Lane>(own: &LinkInertia<L>, link: &mut LinkWork<L>) {
    let com = link.position.plus(link.rotation.apply(own.com));
    link.inertia = Inertia::new(own.mass, com, &own.about_com.rotated(&link.rotation));
    let momentum = link.inertia.apply(link.velocity);
    link.force = link
        .inertia
        .apply(link.acceleration)
        .plus(link.velocity.cross_force(momentum));
}

/// Fills `work.mass_matrix` with the rigid bodies' part; [`bias_force`] has left the links' inertias.
#[inline(always)]
pub fn mass_matrix<L: Lane>(model: &Model<L>, work: &mut Work<L>) {
    work.mass_matrix.fill(L::zero());
    for (j, joint) in model.joints.iter().enumerate().rev() {
        let inertia = work.links[j + 1].inertia;
        let force = inertia.apply(work.subspaces[j]);
        if model.floating {
            let row = &mut work.mass_matrix[joint.row..joint.row + 6];
            for (entry, f) in row.iter_mut().zip(force.array()) {
                *entry += f;
            }
        }
        for product in &joint.products {
            work.mass_matrix[product.entry] += work.subspaces[product.subspace].dot(force);
        }
        let parent = &mut work.links[joint.parent].inertia;
        *parent = parent.plus(&inertia);
    }
    if model.floating {
        root_block(&work.links[0].inertia, &mut work.mass_matrix[..21]);
    }
}

/// The whole robot's inertia as lower triangle: `[m 1, -h x; h x, I]` with the first moment h.
#[inline(always)]
fn root_block<L: Lane>(inertia: &Inertia<L>, block: &mut [L]) {
    let (o, m) = (L::zero(), inertia.mass);
    let (h, i) = (inertia.first_moment, inertia.second_moment);
    let rows = [
        [m, o, o, o, o, o],
        [o, m, o, o, o, o],
        [o, o, m, o, o, o],
        [o, -h.z, h.y, i.xx, o, o],
        [h.z, o, -h.x, i.xy, i.yy, o],
        [-h.y, h.x, o, i.xz, i.yz, i.zz],
    ];
    let mut entry = 0;
    for (r, row) in rows.iter().enumerate() {
        block[entry..=entry + r].copy_from_slice(&row[..=r]);
        entry += r + 1;
    }
}

/// Adds armature and the damping that is implicit on the diagonal, and writes the impulse of all smooth forces but the drives.
#[inline(always)]
pub fn smooth_impulse<L: Lane>(model: &Model<L>, group: &Group<L>, work: &mut Work<L>) {
    let dt = L::of(model.dt);
    let Parameters {
        armature,
        damping,
        push,
        ..
    } = &group.parameters;
    for (change, bias) in work.change.iter_mut().zip(&work.bias) {
        *change = -(dt * *bias);
    }
    if model.floating {
        for (change, force) in work.change.iter_mut().zip(push.array()) {
            *change = dt.mul_add(force, *change);
        }
    }
    for (d, row) in model.rows[model.root..].iter().enumerate() {
        let viscous = dt * damping[d];
        work.mass_matrix[row.diagonal()] += armature[d] + viscous;
        let change = &mut work.change[model.root + d];
        *change = viscous.neg_mul_add(group.state.joint_velocity[d], *change);
    }
}
