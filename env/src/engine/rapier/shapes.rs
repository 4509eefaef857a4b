//! What of a robot and of the ground touches.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::parry::shape::HeightFieldFlags;
use rapier3d_f64::parry::utils::Array2;
use rapier3d_f64::prelude::*;

use super::convert;
use super::scene::{State, root_offset};
use crate::ground::{CELLS, Ground};
use crate::robot::{Geometry, Link, Robot, Shape};

/// Collision groups: robots collide with the ground and with nothing else.
const GROUND: Group = Group::GROUP_1;
const ROBOT: Group = Group::GROUP_2;

/// A link that may touch the ground.
#[derive(Clone, Debug)]
pub(super) struct Toucher {
    /// Index into `Robot::links`.
    pub link: usize,
    pub colliders: Vec<ColliderHandle>,
    /// Poses of the colliders in the link frame.
    pub poses: Vec<Isometry3<f64>>,
}

/// The shapes of every link that has some, on the links' `bodies` in `state`.
pub(super) fn touchers(robot: &Robot, state: &mut State, bodies: &[RigidBodyHandle]) -> Vec<Toucher> {
    let toucher = |(link, data): (usize, &Link)| {
        let offset = root_offset(robot.base, link, &data.inertial);
        let poses: Vec<_> = data.shapes.iter().map(shape_pose).collect();
        let add = |(shape, pose): (&Shape, &Isometry3<f64>)| {
            let collider = collider(shape).position(convert::pose(&(offset.inverse() * pose)));
            state
                .colliders
                .insert_with_parent(collider, bodies[link], &mut state.bodies)
        };
        let colliders = data.shapes.iter().zip(&poses).map(add).collect();
        Toucher { link, colliders, poses }
    };
    let with_shapes = |(_, link): &(usize, &Link)| !link.shapes.is_empty();
    robot
        .links
        .iter()
        .enumerate()
        .filter(with_shapes)
        .map(toucher)
        .collect()
}

/// Pose of the shape as rapier has it: its cylinders and capsules lie along y.
fn shape_pose(shape: &Shape) -> Isometry3<f64> {
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    match shape.geometry {
        Geometry::Cylinder(..) | Geometry::Capsule(..) => shape.pose * upright,
        Geometry::Box(_) | Geometry::Sphere(_) => shape.pose,
    }
}

/// The ground, which robots touch.
pub(super) fn ground(ground: &Ground) -> ColliderBuilder {
    let surface = match ground {
        Ground::Plane => ColliderBuilder::halfspace(nalgebra::Unit::new_unchecked(Vector::Z)),
        Ground::Slope(_) => {
            let normal = convert::vector(&ground.at(0.0, 0.0).normal());
            ColliderBuilder::halfspace(nalgebra::Unit::new_unchecked(normal))
        }
        Ground::Field(field) => {
            // rapier's height field lies in its x and z with heights along y; turned about x its z axis is our -y.
            let mut heights = Array2::repeat(CELLS + 1, CELLS + 1, 0.0);
            for (at, &height) in field.heights.iter().enumerate() {
                let (i, j) = (at / (CELLS + 1), at % (CELLS + 1));
                heights[(CELLS - j, i)] = height;
            }
            let side = field.cell * CELLS as f64;
            let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
            let pose = Isometry3::from_parts(Translation3::identity(), upright);
            ColliderBuilder::heightfield_with_flags(
                heights,
                Vector::new(side, 1.0, side),
                HeightFieldFlags::FIX_INTERNAL_EDGES,
            )
            .position(convert::pose(&pose))
        }
    };
    surface.collision_groups(groups(GROUND, ROBOT))
}

fn collider(shape: &Shape) -> ColliderBuilder {
    let builder = match shape.geometry {
        Geometry::Box(half) => ColliderBuilder::cuboid(half.x, half.y, half.z),
        Geometry::Sphere(radius) => ColliderBuilder::ball(radius),
        Geometry::Cylinder(radius, half) => ColliderBuilder::cylinder(half, radius),
        Geometry::Capsule(radius, half) => ColliderBuilder::capsule_y(half, radius),
    };
    builder.density(0.0).collision_groups(groups(ROBOT, GROUND))
}

fn groups(own: Group, others: Group) -> InteractionGroups {
    InteractionGroups::new(own, others, InteractionTestMode::And)
}
