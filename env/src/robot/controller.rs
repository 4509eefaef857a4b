//! The robot as the controller knows it: policy joints and the kinematics of the legs, in single precision.

use nalgebra::{UnitQuaternion, Vector3};
use omniwalk_controller::{JointSpec, Leg, Segment};

use super::{Foot, JointKind, Robot};

impl Robot {
    /// The policy's joints with the half range of the action (rad or m) of each.
    ///
    /// A policy joint has an actuator and finite limits: [`super::load`] refuses others.
    pub fn joint_specs(&self, action_scale: f64) -> Vec<JointSpec> {
        let spec = |i| {
            let joint = self.policy_joint(i);
            let (kp, kd, torque) = joint.actuator.map_or((0.0, 0.0, 0.0), |a| (a.kp, a.kd, a.torque_limit));
            JointSpec {
                name: joint.name.clone(),
                nominal: joint.nominal as f32,
                lower: joint.limits.0 as f32,
                upper: joint.limits.1 as f32,
                kp: kp as f32,
                kd: kd as f32,
                torque_limit: torque as f32,
                action_scale: action_scale as f32,
            }
        };
        (0..self.policy.len()).map(spec).collect()
    }

    /// The chain from the base link to the sole of each foot, in the order of [`Robot::feet`].
    ///
    /// Couplings are resolved to the policy joint they follow; joints the policy does not move stand at their
    /// nominal position.
    pub fn legs(&self) -> Vec<Leg> {
        let drivers = self.drivers();
        self.feet.iter().map(|foot| self.leg(foot, &drivers)).collect()
    }

    fn leg(&self, foot: &Foot, drivers: &[(usize, f64, f64)]) -> Leg {
        let mut segments = Vec::new();
        let mut link = foot.link;
        while let Some(parent) = self.links[link].parent {
            segments.push(self.segment(link - 1, drivers[link - 1]));
            link = parent;
        }
        segments.reverse();
        Leg {
            name: foot.name.clone(),
            segments,
            corners: foot.corners().map(|corner| vector(&corner.coords)),
            sole_rotation: quaternion(&foot.sole.rotation),
        }
    }

    fn segment(&self, index: usize, (dof, multiplier, offset): (usize, f64, f64)) -> Segment {
        let joint = &self.joints[index];
        let policy = self.policy.iter().position(|&other| other == dof);
        let (multiplier, offset) = match policy {
            Some(_) => (multiplier, offset),
            None => (0.0, multiplier * self.dof(dof).nominal + offset),
        };
        Segment {
            translation: vector(&joint.origin.translation.vector),
            rotation: quaternion(&joint.origin.rotation),
            axis: vector(&joint.axis),
            prismatic: joint.kind == JointKind::Prismatic,
            joint: policy.map(|i| i as u16),
            multiplier: multiplier as f32,
            offset: offset as f32,
        }
    }
}

fn vector(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn quaternion(q: &UnitQuaternion<f64>) -> [f32; 4] {
    [q.i as f32, q.j as f32, q.k as f32, q.w as f32]
}
