//! What a world starts with: its state and its parameters in one lane of a group.

use nalgebra::Vector3;

use super::group::{Group, LinkInertia};
use super::lane::Kernel;
use super::model::Model;
use super::vector::{Sym3, Vec3};
use crate::engine::{Friction, Start, World};
use crate::robot::{Passive, Robot};

/// The nominal pose out of reach of the ground.
pub fn resting(robot: &Robot) -> Start {
    let mut start = Start::nominal(robot);
    start.position.z += 10.0;
    start
}

/// The robot's own parameters without gravity.
pub fn idle(robot: &Robot) -> World {
    let frictionless = Friction {
        tangential: 0.0,
        torsional: 0.0,
        rolling: 0.0,
    };
    World {
        gravity: Vector3::zeros(),
        ..World::nominal(robot, frictionless)
    }
}

pub fn set_vector<L: Kernel>(vector: &mut Vec3<L>, lane: usize, value: Vector3<f64>) {
    vector.x.set(lane, value.x);
    vector.y.set(lane, value.y);
    vector.z.set(lane, value.z);
}

pub fn get_vector<L: Kernel>(vector: &Vec3<L>, lane: usize) -> Vector3<f64> {
    Vector3::new(vector.x.get(lane), vector.y.get(lane), vector.z.get(lane))
}

pub fn reset_lane<L: Kernel>(
    model: &Model<L>,
    group: &mut Group<L>,
    lane: usize,
    start: &Start,
    world: &World,
    followers: &[(usize, f64)],
) {
    for number in group.lanes_mut() {
        number.set(lane, 0.0);
    }
    let state = &mut group.state;
    let (position, orientation) = if model.floating {
        set_vector(&mut state.velocity.linear, lane, start.linear_velocity);
        set_vector(&mut state.velocity.angular, lane, start.angular_velocity);
        (start.position, start.orientation)
    } else {
        (model.base_pose.translation.vector, model.base_pose.rotation)
    };
    for (axis, x) in state.position.iter_mut().zip(position.iter()) {
        axis[lane] = *x;
    }
    let [x, y, z, w] = orientation.coords.into();
    let q = &mut state.orientation;
    for (number, value) in [(&mut q.x, x), (&mut q.y, y), (&mut q.z, z), (&mut q.w, w)] {
        number.set(lane, value);
    }
    for (number, q) in state.joint_position.iter_mut().zip(&start.joints) {
        number.set(lane, *q);
    }
    for (number, v) in state.joint_velocity.iter_mut().zip(&start.joint_velocities) {
        number.set(lane, *v);
    }
    set_parameters(group, lane, world, followers);
}

fn set_parameters<L: Kernel>(group: &mut Group<L>, lane: usize, world: &World, followers: &[(usize, f64)]) {
    let parameters = &mut group.parameters;
    for (link, own) in parameters.links.iter_mut().zip(&world.links) {
        let LinkInertia { mass, com, about_com } = link;
        mass.set(lane, own.mass);
        set_vector(com, lane, own.com);
        let Sym3 { xx, xy, xz, yy, yz, zz } = about_com;
        for (number, at) in [
            (xx, (0, 0)),
            (xy, (0, 1)),
            (xz, (0, 2)),
            (yy, (1, 1)),
            (yz, (1, 2)),
            (zz, (2, 2)),
        ] {
            number.set(lane, own.inertia[at]);
        }
    }
    for (d, (armature, damping)) in parameters.armature.iter_mut().zip(&mut parameters.damping).enumerate() {
        // A joint that follows with ratio r adds r^2 of its own.
        let sum = |own: fn(&Passive) -> f64| -> f64 {
            let all = world.joints.iter().zip(followers);
            all.filter(|(_, f)| f.0 == d)
                .map(|(joint, f)| f.1 * f.1 * own(joint))
                .sum()
        };
        armature.set(lane, sum(|joint| joint.armature));
        damping.set(lane, sum(|joint| joint.damping));
    }
    let Friction {
        tangential,
        torsional,
        rolling,
    } = world.friction;
    for (number, mu) in parameters.friction.iter_mut().zip([tangential, torsional, rolling]) {
        number.set(lane, mu);
    }
    set_vector(&mut parameters.gravity, lane, world.gravity);
}
