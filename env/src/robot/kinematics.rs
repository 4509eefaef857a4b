//! Forward kinematics: poses and velocities of the links from those of the base and the degrees of freedom.
//!
//! Nothing allocates after construction.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{Inertial, Joint, JointKind, Link, Robot};

/// Poses and velocities of a robot's links in the world.
#[derive(Clone, Debug)]
pub struct Kinematics {
    poses: Vec<Isometry3<f64>>,
    linear: Vec<Vector3<f64>>,
    angular: Vec<Vector3<f64>>,
    /// Degree of freedom, multiplier and offset behind each joint.
    drivers: Vec<(usize, f64, f64)>,
}

impl Joint {
    /// Pose of the child link in the parent link's frame at `position` (rad or m).
    pub fn pose(&self, position: f64) -> Isometry3<f64> {
        self.origin
            * match self.kind {
                JointKind::Revolute => Isometry3::from_parts(
                    Translation3::identity(),
                    UnitQuaternion::from_axis_angle(&self.axis, position),
                ),
                JointKind::Prismatic => Translation3::from(self.axis.into_inner() * position).into(),
            }
    }
}

impl Kinematics {
    /// The robot in its nominal pose, at rest.
    pub fn new(robot: &Robot) -> Self {
        let links = robot.links.len();
        let zeros = vec![Vector3::zeros(); links];
        let poses = vec![Isometry3::identity(); links];
        let mut kinematics = Self {
            poses,
            linear: zeros.clone(),
            angular: zeros,
            drivers: robot.drivers(),
        };
        kinematics.set_pose(robot, &robot.base_pose, &robot.nominal());
        kinematics
    }

    /// Sets the link poses from the base's world pose and the positions of the degrees of freedom (rad or m).
    /// Velocities are left as they are.
    pub fn set_pose(&mut self, robot: &Robot, base: &Isometry3<f64>, positions: &[f64]) {
        self.poses[0] = *base;
        for (index, joint) in robot.joints.iter().enumerate() {
            let (dof, multiplier, offset) = self.drivers[index];
            self.poses[index + 1] = self.poses[joint.parent] * joint.pose(multiplier * positions[dof] + offset);
        }
    }

    /// Sets the link velocities from the velocity of the base link's origin (m/s), the base's angular velocity
    /// (rad/s), both in the world frame, and the velocities of the degrees of freedom. Poses must be set before.
    pub fn set_velocity(&mut self, robot: &Robot, linear: &Vector3<f64>, angular: &Vector3<f64>, velocities: &[f64]) {
        (self.linear[0], self.angular[0]) = (*linear, *angular);
        for (index, joint) in robot.joints.iter().enumerate() {
            let (dof, multiplier, _) = self.drivers[index];
            let pose = self.poses[index + 1];
            let axis = pose.rotation * joint.axis.into_inner() * (multiplier * velocities[dof]);
            let carried = self.velocity_at(joint.parent, &pose.translation.vector.into());
            (self.linear[index + 1], self.angular[index + 1]) = match joint.kind {
                JointKind::Revolute => (carried, self.angular[joint.parent] + axis),
                JointKind::Prismatic => (carried + axis, self.angular[joint.parent]),
            };
        }
    }

    /// Inertia (kg m^2 or kg) that degree of freedom `dof` moves in this pose, all others held. Velocities are lost.
    pub fn moved_inertia(&mut self, robot: &Robot, dof: usize) -> f64 {
        let mut rates = vec![0.0; robot.dofs.len()];
        rates[dof] = 1.0;
        self.set_velocity(robot, &Vector3::zeros(), &Vector3::zeros(), &rates);
        let of_link = |(i, link): (usize, &Link)| {
            let (pose, angular) = (self.pose(i), self.angular_velocity(i));
            let velocity = self.velocity_at(i, &(pose * Point3::from(link.inertial.com)));
            let spin = pose.rotation.inverse() * angular;
            link.inertial.mass * velocity.norm_squared() + spin.dot(&(link.inertial.inertia * spin))
        };
        robot.links.iter().enumerate().map(of_link).sum()
    }

    /// World pose of a link's frame.
    pub fn pose(&self, link: usize) -> &Isometry3<f64> {
        &self.poses[link]
    }

    /// Angular velocity of a link in the world frame, rad/s.
    pub fn angular_velocity(&self, link: usize) -> &Vector3<f64> {
        &self.angular[link]
    }

    /// World velocity of the point of a link that is at `point` (world frame, m) now, m/s.
    pub fn velocity_at(&self, link: usize, point: &Point3<f64>) -> Vector3<f64> {
        self.linear[link] + self.angular[link].cross(&(point.coords - self.poses[link].translation.vector))
    }

    /// World pose of a foot's sole.
    pub fn sole(&self, robot: &Robot, foot: usize) -> Isometry3<f64> {
        let foot = &robot.feet[foot];
        self.poses[foot.link] * foot.sole
    }

    /// World position of the whole robot's centre of mass, m; `links` are the mass properties of every link.
    pub fn center_of_mass<'a>(&self, links: impl IntoIterator<Item = &'a Inertial>) -> Point3<f64> {
        let (mut mass, mut moment) = (0.0, Vector3::zeros());
        for (pose, link) in self.poses.iter().zip(links) {
            mass += link.mass;
            moment += link.mass * (pose * Point3::from(link.com)).coords;
        }
        Point3::from(if mass > 0.0 {
            moment / mass
        } else {
            self.poses[0].translation.vector
        })
    }

    /// Momentum of all links together, without the rotors that armature stands for: linear, kg m/s, and angular about the centre
    /// of mass, kg m^2/s, in the world frame.
    pub fn momentum(&self, robot: &Robot) -> (Vector3<f64>, Vector3<f64>) {
        let center = self.center_of_mass(robot.links.iter().map(|link| &link.inertial));
        let (mut linear, mut angular) = (Vector3::zeros(), Vector3::zeros());
        for (index, link) in robot.links.iter().enumerate() {
            let pose = self.pose(index);
            let com = pose * Point3::from(link.inertial.com);
            let momentum = link.inertial.mass * self.velocity_at(index, &com);
            let spin = pose.rotation.inverse() * self.angular_velocity(index);
            linear += momentum;
            angular += (com - center).cross(&momentum) + pose.rotation * (link.inertial.inertia * spin);
        }
        (linear, angular)
    }
}
