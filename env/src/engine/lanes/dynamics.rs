//! Bias forces by the recursive Newton-Euler algorithm and the mass matrix by the composite-rigid-body algorithm
//! (Featherstone, Rigid Body Dynamics Algorithms, chapters 5 and 6), in world axes about the base link's origin.

use super::group::{Group, LinkInertia, Parameters};
use super::kinematics::{add_subspaces, place_base, place_link};
use super::lane::Lane;
use super::model::Model;
use super::spatial::{Force, Inertia, Motion};
use super::vector::Vec3;
use super::work::{LinkWork, Work};

/// Places the links and fills their inertias and the forces that hold all generalised accelerations at zero: gravity and
/// velocity products. One pass, so that a link's numbers are still at hand.
#[inline(always)]
pub fn outward<L: Lane>(model: &Model<L>, group: &Group<L>, work: &mut Work<L>) {
    let Group { state, parameters, .. } = group;
    let base = &mut work.links[0];
    place_base(state, base);
    // The generalised acceleration of a floating base is that of its origin, a point: the spatial one is less by w x v.
    let Motion { linear, angular } = base.velocity;
    base.acceleration = Motion {
        linear: Vec3::zero().minus(parameters.gravity).minus(angular.cross(linear)),
        angular: Vec3::zero(),
    };
    // What a fixed base weighs moves nothing.
    if model.floating {
        own_force(&parameters.links[0], base);
    }
    for (j, joint) in model.joints.iter().enumerate() {
        place_link(model, state, work, j);
        let above = work.links[joint.parent].acceleration;
        let speed = state.joint_velocity[joint.dof - model.root];
        let link = &mut work.links[j + 1];
        link.acceleration = above.plus(link.velocity.cross(work.subspaces[j].times(speed)));
        own_force(&parameters.links[j + 1], link);
    }
    add_subspaces(model, work);
}

/// Inertia of the link in world axes, and the force of its acceleration: by Newton and Euler at its centre of mass.
#[inline(always)]
fn own_force<L: Lane>(own: &LinkInertia<L>, link: &mut LinkWork<L>) {
    let com = link.position.plus(link.rotation.apply(own.com));
    let about_com = own.about_com.rotated(&link.rotation);
    link.inertia = Inertia::new(own.mass, com, &about_com);
    let (velocity, acceleration) = (link.velocity.at(com), link.acceleration.at(com));
    // The spatial acceleration is that of the place, through which the body moves on.
    let own_acceleration = acceleration.linear.plus_cross(velocity.angular, velocity.linear);
    let force = own_acceleration.times(own.mass);
    let spin = about_com.apply(velocity.angular);
    let moment = about_com
        .apply(acceleration.angular)
        .plus_cross(velocity.angular, spin)
        .plus_cross(com, force);
    link.force = Force { force, moment };
}

/// Fills `work.bias` with the generalised force of the links' forces and `work.mass_matrix` with the rigid bodies' part, from
/// what [`outward`] has left.
#[inline(always)]
pub fn inward<L: Lane>(model: &Model<L>, work: &mut Work<L>) {
    work.bias.fill(L::zero());
    work.mass_matrix.fill(L::zero());
    for (j, joint) in model.joints.iter().enumerate().rev() {
        let (above, below) = work.links.split_at_mut(j + 1);
        let (parent, link) = (&mut above[joint.parent], &below[0]);
        let subspace = work.subspaces[j];
        work.bias[joint.dof] += subspace.dot(link.force);
        let carries = model.floating || joint.parent > 0;
        if carries {
            parent.force = parent.force.plus(link.force);
        }
        let force = link.inertia.apply(subspace);
        if model.floating {
            let row = &mut work.mass_matrix[joint.row..joint.row + 6];
            for (entry, f) in row.iter_mut().zip(force.array()) {
                *entry += f;
            }
        }
        for product in &joint.products {
            work.mass_matrix[product.entry] += work.subspaces[product.subspace].dot(force);
        }
        if carries {
            parent.inertia = parent.inertia.plus(&link.inertia);
        }
    }
    if model.floating {
        work.bias[..6].copy_from_slice(&work.links[0].force.array());
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
