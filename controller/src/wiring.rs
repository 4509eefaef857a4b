//! Does a policy fit a robot? Joint names and their order, gains, limits, rates.

use alloc::{format, string::String, vec::Vec};
use core::fmt::{Debug, Write};

use libm::fabsf;
use thiserror::Error;

use crate::spec::Spec;

/// Largest relative difference of two numbers that mean the same: they may have been through a text file.
const SAME: f32 = 1e-5;

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
    #[error("the robot has {found} joints, the policy moves {expected}; give it those alone, or give the names")]
    Number {
        /// The policy's.
        expected: usize,
        /// The robot's.
        found: usize,
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
        let mut number = |what: &dyn Fn() -> String, ours: f32, theirs: f32| {
            let near = fabsf(ours - theirs) <= SAME * fabsf(ours).max(fabsf(theirs)).max(1.0) || ours == theirs;
            if !near {
                found.push(format!("{} is {ours} in the policy and {theirs} in the robot", what()));
            }
        };
        for (ours, theirs) in self.joints.iter().zip(&robot.joints) {
            let fields = [
                ("nominal", ours.nominal, theirs.nominal),
                ("lower", ours.lower, theirs.lower),
                ("upper", ours.upper, theirs.upper),
                ("kp", ours.kp, theirs.kp),
                ("kd", ours.kd, theirs.kd),
                ("torque_limit", ours.torque_limit, theirs.torque_limit),
                ("action_scale", ours.action_scale, theirs.action_scale),
            ];
            for (field, a, b) in fields {
                number(&|| format!("joint `{}`: {field}", ours.name), a, b);
            }
        }
        number(&|| "control_hz".into(), self.control_hz, robot.control_hz);
        let period = |spec: &Spec| spec.inertial_frame_period;
        number(&|| "inertial_frame_period".into(), period(self), period(robot));
        compare(&mut found, "observation", &self.observation, &robot.observation);
        compare(&mut found, "action", &self.action, &robot.action);
        compare(&mut found, "clock", &self.clock, &robot.clock);
        compare(&mut found, "symmetry", &self.symmetry, &robot.symmetry);
        compare(&mut found, "command", &self.command, &robot.command);
        compare(&mut found, "upright", &self.upright, &robot.upright);
        if self.legs != robot.legs {
            found.push("the legs' kinematics are not the same".into());
        }
        if found.is_empty() {
            Ok(())
        } else {
            Err(Misfit::Differs(found))
        }
    }
}

fn compare<T: PartialEq + Debug>(found: &mut Vec<String>, what: &str, ours: &T, theirs: &T) {
    if ours != theirs {
        found.push(format!("{what} is {ours:?} in the policy and {theirs:?} in the robot"));
    }
}

/// The names, at most 64 of them.
fn list<S: AsRef<str>>(names: &[S]) -> String {
    let mut text = String::new();
    for (i, name) in names.iter().take(64).enumerate() {
        // Writing to a string does not fail.
        let _ = write!(text, "{}{}", if i > 0 { ", " } else { "" }, name.as_ref());
    }
    text
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
            spec.check_order(&robot),
            Err(Misfit::Number {
                expected: 10,
                found: 11
            })
        );
        assert!(spec.joint_map(&robot).is_ok(), "by name a robot may have more");
        robot.push("left_knee".into());
        assert!(matches!(spec.joint_map(&robot), Err(Misfit::Twice { joint }) if joint == "left_knee"));
        robot.retain(|name| name != "left_knee");
        assert!(matches!(spec.joint_map(&robot), Err(Misfit::Missing { joint, .. }) if joint == "left_knee"));
    }

    #[test]
    fn everything_that_differs_is_listed() {
        let spec = biped();
        assert_eq!(spec.check_robot(&spec), Ok(()));
        let mut robot = spec.clone();
        robot.joints[3].kp = 80.0;
        robot.control_hz = 50.0;
        robot.action.filter = None;
        let text = spec.check_robot(&robot).expect_err("another robot").to_string();
        for part in [
            "joint `left_knee`: kp is 120 in the policy and 80 in the robot",
            "control_hz is 40 in the policy and 50",
            "action is",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
    }
}
