//! Rigid-body dynamics by geometric Jacobians in plain vectors: no spatial algebra, no recursion over forces, no
//! sparsity. Slow and obvious, to compare with.

use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};

use crate::engine::{Start, World};
use crate::robot::{Base, JointKind, Robot};

/// A link's motion with all generalised accelerations at zero.
struct LinkMotion {
    pose: Isometry3<f64>,
    angular: Vector3<f64>,
    /// Acceleration of the link's origin and angular acceleration.
    acceleration: Vector3<f64>,
    angular_acceleration: Vector3<f64>,
    velocity: Vector3<f64>,
}

/// Everything about a state.
pub struct Reference {
    pub mass_matrix: DMatrix<f64>,
    /// Generalised force that holds all accelerations at zero.
    pub bias: DVector<f64>,
    pub kinetic: f64,
    pub potential: f64,
    pub momentum: Vector3<f64>,
    /// About the world's origin.
    pub angular_momentum: Vector3<f64>,
    pub com: Vector3<f64>,
    /// Of the twist of every link with contact points at their mean, linear above angular.
    pub contact_jacobians: Vec<DMatrix<f64>>,
}

impl Reference {
    pub fn new(robot: &Robot, start: &Start, world: &World) -> Self {
        let links = motions(robot, start);
        let root = if robot.base == Base::Floating { 6 } else { 0 };
        let dofs = root + robot.dofs.len();
        let mut r = Self {
            mass_matrix: DMatrix::zeros(dofs, dofs),
            bias: DVector::zeros(dofs),
            kinetic: 0.0,
            potential: 0.0,
            momentum: Vector3::zeros(),
            angular_momentum: Vector3::zeros(),
            com: Vector3::zeros(),
            contact_jacobians: vec![],
        };
        let total: f64 = world.links.iter().map(|l| l.mass).sum();
        for (l, own) in links.iter().enumerate() {
            let inertial = &world.links[l];
            let arm = own.pose.rotation * inertial.com;
            let com = own.pose.translation.vector + arm;
            let turn = own.pose.rotation.to_rotation_matrix();
            let inertia = turn.matrix() * inertial.inertia * turn.matrix().transpose();
            let w = own.angular;
            let velocity = own.velocity + w.cross(&arm);
            let acceleration = own.acceleration + own.angular_acceleration.cross(&arm) + w.cross(&w.cross(&arm));
            let force = inertial.mass * (acceleration - world.gravity);
            let moment = inertia * own.angular_acceleration + w.cross(&(inertia * w));
            let (jv, jw) = jacobians(robot, &links, l, com);
            r.mass_matrix += inertial.mass * jv.transpose() * &jv + jw.transpose() * inertia * &jw;
            r.bias += jv.transpose() * force + jw.transpose() * moment;
            r.kinetic += 0.5 * inertial.mass * velocity.norm_squared() + 0.5 * w.dot(&(inertia * w));
            r.potential -= inertial.mass * world.gravity.dot(&com);
            r.momentum += inertial.mass * velocity;
            r.angular_momentum += inertial.mass * com.cross(&velocity) + inertia * w;
            r.com += com * (inertial.mass / total);
            let points = &robot.links[l].contact_points;
            if !points.is_empty() && (l > 0 || root > 0) {
                let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
                let (jv, jw) = jacobians(robot, &links, l, (own.pose * Point3::from(mean)).coords);
                let mut both = DMatrix::zeros(6, dofs);
                both.rows_mut(0, 3).copy_from(&jv);
                both.rows_mut(3, 3).copy_from(&jw);
                r.contact_jacobians.push(both);
            }
        }
        r
    }
}

fn motions(robot: &Robot, start: &Start) -> Vec<LinkMotion> {
    let fixed = robot.base == Base::Fixed;
    let base = if fixed {
        LinkMotion {
            pose: robot.base_pose,
            angular: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            angular_acceleration: Vector3::zeros(),
            velocity: Vector3::zeros(),
        }
    } else {
        LinkMotion {
            pose: Isometry3::from_parts(start.position.into(), start.orientation),
            angular: start.angular_velocity,
            acceleration: Vector3::zeros(),
            angular_acceleration: Vector3::zeros(),
            velocity: start.linear_velocity,
        }
    };
    let mut links = vec![base];
    for (j, joint) in robot.joints.iter().enumerate() {
        let (d, ratio, offset) = follows(robot, j);
        let (q, speed) = (ratio * start.joints[d] + offset, ratio * start.joint_velocities[d]);
        let parent = &links[joint.parent];
        let frame = parent.pose * joint.origin;
        let axis = frame.rotation * joint.axis.into_inner();
        let (motion, spin, slide) = match joint.kind {
            JointKind::Revolute => (
                Isometry3::rotation(joint.axis.into_inner() * q),
                axis * speed,
                Vector3::zeros(),
            ),
            JointKind::Prismatic => {
                let along = joint.axis.into_inner() * q;
                (
                    Isometry3::translation(along.x, along.y, along.z),
                    Vector3::zeros(),
                    axis * speed,
                )
            }
        };
        let pose = frame * motion;
        let arm = pose.translation.vector - parent.pose.translation.vector;
        let (w, alpha) = (parent.angular, parent.angular_acceleration);
        links.push(LinkMotion {
            pose,
            angular: w + spin,
            velocity: parent.velocity + w.cross(&arm) + slide,
            acceleration: parent.acceleration + alpha.cross(&arm) + w.cross(&w.cross(&arm)) + 2.0 * w.cross(&slide),
            angular_acceleration: alpha + w.cross(&spin),
        });
    }
    links
}

/// Degree of freedom, ratio and offset of a joint.
fn follows(robot: &Robot, j: usize) -> (usize, f64, f64) {
    let (leader, ratio, offset) = robot.joints[j]
        .mimic
        .map_or((j, 1.0, 0.0), |m| (m.joint, m.multiplier, m.offset));
    let d = robot.dofs.iter().position(|&d| d == leader).expect("leader is free");
    (d, ratio, offset)
}

/// Linear Jacobian of `point` on link `l` and the angular one.
fn jacobians(robot: &Robot, links: &[LinkMotion], l: usize, point: Vector3<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
    let root = if robot.base == Base::Floating { 6 } else { 0 };
    let mut jv = DMatrix::zeros(3, root + robot.dofs.len());
    let mut jw = jv.clone();
    if root == 6 {
        let arm = point - links[0].pose.translation.vector;
        for i in 0..3 {
            let axis = Vector3::ith(i, 1.0);
            jv.set_column(i, &axis);
            jv.set_column(3 + i, &axis.cross(&arm));
            jw.set_column(3 + i, &axis);
        }
    }
    let mut link = l;
    while link > 0 {
        let joint = &robot.joints[link - 1];
        let (d, ratio, _) = follows(robot, link - 1);
        let frame = links[joint.parent].pose * joint.origin;
        let axis = frame.rotation * joint.axis.into_inner() * ratio;
        let mut linear = jv.column_mut(root + d);
        match joint.kind {
            JointKind::Revolute => {
                linear += axis.cross(&(point - frame.translation.vector));
                let mut angular = jw.column_mut(root + d);
                angular += axis;
            }
            JointKind::Prismatic => linear += axis,
        }
        link = joint.parent;
    }
    (jv, jw)
}
