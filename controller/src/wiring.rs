//! Does a policy fit a robot? Joint names and their order, gains, limits, rates.

use alloc::{format, string::String, vec::Vec};

use libm::fabsf;
use thiserror::Error;

use crate::spec::{JointSpec, Spec};

/// Largest relative difference of two numbers that mean the same: they may have been through a text file.
const SAME: f32 = 1e-5;

/// Most names of a robot's joints in a message: enough to see how the robot calls them.
const SHOWN: usize = 8;

/// Why a policy does not fit a robot.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Misfit {
    /// The robot has no joint of this name.
    #[error("the policy moves joint `{joint}`, which the robot does not have; its joints are {known}")]
    Missing {
        /// The joint.
        joint: String,
        /// The robot's joints.
        known: String,
    },
    /// Two joints of the robot have one name.
    #[error("the robot has joint `{joint}` twice")]
    Twice {
        /// The joint.
        joint: String,
    },
    /// The robot's joints are in another order.
    #[error(
        "joint `{joint}` expected at index {expected}, robot has it at {found}; take the policy's joints from the robot's indices {mapping:?}"
    )]
    Order {
        /// The first joint that is elsewhere.
        joint: String,
        /// Its index in the policy.
        expected: usize,
        /// Its index in the robot.
        found: usize,
        /// Index in the robot of each of the policy's joints.
        mapping: Vec<usize>,
    },
    /// The robot has more joints than the policy moves, behind those it does.
    #[error(
        "the robot has {found} joints, the policy moves {expected} of them, not {others}; take the policy's joints from the robot's indices {mapping:?}"
    )]
    Number {
        /// The policy's.
        expected: usize,
        /// The robot's.
        found: usize,
        /// Joints of the robot that the policy does not move.
        others: String,
        /// Index in the robot of each of the policy's joints.
        mapping: Vec<usize>,
    },
    /// Other things differ; all of them.
    #[error("the policy was trained for another robot: {}", .0.join("; "))]
    Differs(Vec<String>),
}

impl Spec {
    /// Index among `names`, the robot's joints, of each of the policy's joints. The robot may have more.
    ///
    /// # Errors
    /// [`Misfit::Missing`] or [`Misfit::Twice`].
    pub fn joint_map<S: AsRef<str>>(&self, names: &[S]) -> Result<Vec<usize>, Misfit> {
        let place = |joint: &str| {
            let mut places = names.iter().enumerate().filter(|(_, name)| name.as_ref() == joint);
            match (places.next(), places.next()) {
                (Some((index, _)), None) => Ok(index),
                (None, _) => Err(Misfit::Missing {
                    joint: joint.into(),
                    known: list(names),
                }),
                _ => Err(Misfit::Twice { joint: joint.into() }),
            }
        };
        self.joints.iter().map(|joint| place(&joint.name)).collect()
    }

    /// Checks that `names`, the order in which readings are given and targets taken, is the policy's.
    ///
    /// # Errors
    /// The first joint that is elsewhere, with the mapping if the names allow one.
    pub fn check_order<S: AsRef<str>>(&self, names: &[S]) -> Result<(), Misfit> {
        let mapping = self.joint_map(names)?;
        match (0..mapping.len()).find(|&i| mapping[i] != i) {
            Some(expected) => Err(Misfit::Order {
                joint: self.joints[expected].name.clone(),
                expected,
                found: mapping[expected],
                mapping,
            }),
            None if names.len() != self.joints.len() => Err(Misfit::Number {
                expected: self.joints.len(),
                found: names.len(),
                others: list(&names[mapping.len()..]),
                mapping,
            }),
            None => Ok(()),
        }
    }

    /// Checks that this policy's description is that of the robot `robot`: joints in order, limits, gains, nominal pose, action,
    /// rates, kinematics.
    ///
    /// # Errors
    /// What is different.
    pub fn check_robot(&self, robot: &Spec) -> Result<(), Misfit> {
        let names: Vec<&str> = robot.joints.iter().map(|joint| joint.name.as_str()).collect();
        self.check_order(&names)?;
        let mut found = Vec::new();
        let fields: [(&str, Field); 7] = [
            ("nominal", |joint| joint.nominal),
            ("lower", |joint| joint.lower),
            ("upper", |joint| joint.upper),
            ("kp", |joint| joint.kp),
            ("kd", |joint| joint.kd),
            ("torque_limit", |joint| joint.torque_limit),
            ("action_scale", |joint| joint.action_scale),
        ];
        for (field, of) in fields {
            let joints = self.joints.iter().zip(&robot.joints);
            let mut different = joints.filter(|(ours, theirs)| !near(of(ours), of(theirs)));
            if let Some((ours, theirs)) = different.next() {
                let (name, a, b) = (&ours.name, of(ours), of(theirs));
                let others = match different.count() {
                    0 => String::new(),
                    more => format!(", and that of {more} more joints"),
                };
                found.push(format!(
                    "joint `{name}`: {field} is {a} in the policy and {b} in the robot{others}"
                ));
            }
        }
        let numbers = [
            ("control_hz", self.control_hz, robot.control_hz),
            (
                "inertial_frame_period",
                self.inertial_frame_period,
                robot.inertial_frame_period,
            ),
        ];
        for (what, ours, theirs) in numbers {
            if !near(ours, theirs) {
                found.push(format!("{what} is {ours} in the policy and {theirs} in the robot"));
            }
        }
        for (what, same) in [
            ("blocks of the observation are", self.observation == robot.observation),
            ("action law, filter or clamp is", self.action == robot.action),
            ("clock is", self.clock == robot.clock),
            ("left-right mirror is", self.symmetry == robot.symmetry),
            ("bounds or rates of the command are", self.command == robot.command),
            ("angles of a fall are", self.upright == robot.upright),
            ("kinematics of the legs are", self.legs == robot.legs),
        ] {
            if !same {
                found.push(format!("the {what} not the same"));
            }
        }
        if found.is_empty() {
            Ok(())
        } else {
            Err(Misfit::Differs(found))
        }
    }
}

/// A number of a joint.
type Field = fn(&JointSpec) -> f32;

fn near(ours: f32, theirs: f32) -> bool {
    fabsf(ours - theirs) <= SAME * fabsf(ours).max(fabsf(theirs)).max(1.0) || ours == theirs
}

/// The first names, and how many more there are.
fn list<S: AsRef<str>>(names: &[S]) -> String {
    let (shown, others) = names.split_at(names.len().min(SHOWN));
    let shown: Vec<&str> = shown.iter().map(AsRef::as_ref).collect();
    match (shown.len(), others.len()) {
        (0, _) => "none".into(),
        (_, 0) => shown.join(", "),
        (_, others) => format!("{} and {others} more", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;
    use crate::testing::biped;

    fn names(spec: &Spec) -> Vec<String> {
        spec.joints.iter().map(|joint| joint.name.clone()).collect()
    }

    #[test]
    fn a_joint_in_the_wrong_place_is_named_and_the_mapping_is_given() {
        let spec = biped();
        let mut robot = names(&spec);
        assert_eq!(spec.check_order(&robot), Ok(()));
        robot.swap(3, 8);
        let error = spec.check_order(&robot).expect_err("another order");
        assert_eq!(
            error.to_string(),
            "joint `left_knee` expected at index 3, robot has it at 8; take the policy's joints from the robot's \
             indices [0, 1, 2, 8, 4, 5, 6, 7, 3, 9]"
        );
        assert_eq!(spec.joint_map(&robot), Ok(alloc::vec![0, 1, 2, 8, 4, 5, 6, 7, 3, 9]));
    }

    #[test]
    fn missing_doubled_and_additional_joints_are_told() {
        let spec = biped();
        let mut robot = names(&spec);
        robot.push("head".into());
        assert_eq!(
            spec.check_order(&robot).expect_err("another number").to_string(),
            "the robot has 11 joints, the policy moves 10 of them, not head; take the policy's joints from the robot's \
             indices [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]"
        );
        robot.rotate_right(1);
        assert_eq!(
            spec.check_order(&robot).expect_err("another place").to_string(),
            "joint `left_hip_yaw` expected at index 0, robot has it at 1; take the policy's joints from the robot's \
             indices [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]"
        );
        robot.rotate_left(1);
        assert!(spec.joint_map(&robot).is_ok(), "by name a robot may have more");
        robot.push("left_knee".into());
        assert!(matches!(spec.joint_map(&robot), Err(Misfit::Twice { joint }) if joint == "left_knee"));
        robot.retain(|name| name != "left_knee");
        assert_eq!(
            spec.joint_map(&robot).expect_err("a joint is missing").to_string(),
            "the policy moves joint `left_knee`, which the robot does not have; its joints are left_hip_yaw, \
             left_hip_roll, left_hip_pitch, left_ankle_roll, right_hip_yaw, right_hip_roll, right_hip_pitch, right_knee and \
             2 more"
        );
        assert_eq!(
            spec.check_order::<&str>(&[]).expect_err("no joints").to_string(),
            "the policy moves joint `left_hip_yaw`, which the robot does not have; its joints are none"
        );
    }

    #[test]
    fn everything_that_differs_is_listed_and_what_differs_in_many_joints_once() {
        let spec = biped();
        assert_eq!(spec.check_robot(&spec), Ok(()));
        let mut robot = spec.clone();
        robot.joints[3].kp = 80.0;
        robot.joints.iter_mut().for_each(|joint| joint.kd = 1.0);
        robot.control_hz = 50.0;
        robot.action.filter = None;
        let text = spec.check_robot(&robot).expect_err("another robot").to_string();
        for part in [
            "joint `left_knee`: kp is 120 in the policy and 80 in the robot",
            "control_hz is 40 in the policy and 50",
            "joint `left_hip_yaw`: kd is 3 in the policy and 1 in the robot, and that of 9 more joints",
            "the action law, filter or clamp is not the same",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
    }
}
