//! What a [`Spec`] must be before anything is built from it.

use alloc::string::String;

use thiserror::Error;

use crate::{
    math::dot,
    spec::{Block, FilterSpec, Leg, Spec},
};

/// Most joints of a policy; they are compared in pairs.
pub const MAX_JOINTS: usize = 256;

/// Largest gain and torque limit, in their units: stiffer and stronger than any machine, and their products are still numbers.
const LARGEST_GAIN: f32 = 1e9;

/// Largest position and action, rad or m: what a joint that turns on and on still has as its limit, and more.
const LARGEST_POSITION: f32 = 1e4;

/// Largest length of a leg's part, m, and largest share of a joint in a coupled one's motion.
const LARGEST_LENGTH: f32 = 1e3;

/// Largest control rate, Hz, and desired velocity, m/s or rad/s.
const LARGEST_RATE: f32 = 1e5;

/// Most legs of a robot, and joints of a leg.
const MAX_LEGS: usize = 64;

/// Why a [`Spec`] cannot be used. Fields named `joint` and `leg` hold names.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SpecError {
    /// There is nothing to control.
    #[error("the policy has no joints")]
    NoJoints,
    /// More than any robot has.
    #[error("{found} {what}; at most {most} are possible")]
    TooMany {
        /// `joints`, `legs` or `segments of a leg`.
        what: &'static str,
        /// How many.
        found: usize,
        /// How many there may be.
        most: usize,
    },
    /// A joint without a name, or with one that no robot can give.
    #[error("a joint is called {joint:?}: names have at least one character and no control characters")]
    Name {
        /// The name.
        joint: String,
    },
    /// Two joints share a name, so readings by name would be ambiguous.
    #[error("joint `{joint}` appears twice")]
    DuplicateJoint {
        /// The name.
        joint: String,
    },
    /// A joint's number is missing, infinite or outside what it may be.
    #[error("joint `{joint}`: {field} is {value}, {expected}")]
    Joint {
        /// The joint.
        joint: String,
        /// The field of `JointSpec`.
        field: &'static str,
        /// What it holds.
        value: f32,
        /// What would be right.
        expected: &'static str,
    },
    /// A number outside the joints is not what it may be.
    #[error("{field} is {value}, {expected}")]
    Value {
        /// The field of `Spec`.
        field: &'static str,
        /// What it holds.
        value: f32,
        /// What would be right.
        expected: &'static str,
    },
    /// A block appears twice.
    #[error("observation block {block:?} appears twice")]
    DuplicateBlock {
        /// The block.
        block: Block,
    },
    /// The clock is observed but there is none.
    #[error("the observation has the block Clock but the policy has no clock")]
    NoClock,
    /// A symmetric policy changes sides by the clock, but there is none.
    #[error("the policy is symmetric but has no clock to change sides by")]
    NoClockForSymmetry,
    /// A leg's chain follows a joint the policy does not have.
    #[error("leg `{leg}`, segment {segment}: follows joint {joint}, but the policy has {joints} joints")]
    UnknownJoint {
        /// The leg.
        leg: String,
        /// Index of the segment from the base.
        segment: usize,
        /// The joint it refers to.
        joint: u16,
        /// How many there are.
        joints: usize,
    },
    /// A leg's geometry is not finite, or an axis or rotation is not of unit length.
    #[error("leg `{leg}`: {field} must be finite and {expected}")]
    Geometry {
        /// The leg.
        leg: String,
        /// What is wrong.
        field: &'static str,
        /// What would be right.
        expected: &'static str,
    },
    /// A mirror map that is not a symmetry of the policy's joints.
    #[error(
        "joint `{joint}`: the mirror map must be its own inverse, with nominal pose, limits and action scale symmetric under it"
    )]
    Mirror {
        /// The joint.
        joint: String,
    },
}

impl Spec {
    /// Checks everything [`crate::Pipeline`] relies on.
    ///
    /// # Errors
    /// The first field that is wrong and what would be right.
    pub fn validate(&self) -> Result<(), SpecError> {
        positive("control_hz", self.control_hz)?;
        if self.control_hz > LARGEST_RATE {
            return Err(SpecError::Value {
                field: "control_hz",
                value: self.control_hz,
                expected: "but must be at most 1e5",
            });
        }
        if self.inertial_frame_period.is_nan() || self.inertial_frame_period <= 0.0 {
            return Err(SpecError::Value {
                field: "inertial_frame_period",
                value: self.inertial_frame_period,
                expected: "but must be positive (infinite to never set the frame again)",
            });
        }
        for &angle in &self.upright {
            positive("upright", angle)?;
        }
        self.validate_sizes()?;
        self.validate_joints()?;
        self.validate_filter()?;
        self.validate_command()?;
        for (i, &block) in self.observation.iter().enumerate() {
            if self.observation[..i].contains(&block) {
                return Err(SpecError::DuplicateBlock { block });
            }
        }
        match self.clock {
            Some(clock) => {
                positive("clock.period", clock.period)?;
                phase("clock.reset_phase", clock.reset_phase)?;
            }
            None if self.observation.contains(&Block::Clock) => return Err(SpecError::NoClock),
            None if self.symmetry.is_some() => return Err(SpecError::NoClockForSymmetry),
            None => {}
        }
        if let Some(joints) = &self.symmetry {
            self.validate_mirror(joints)?;
        }
        self.legs
            .iter()
            .try_for_each(|leg| validate_leg(leg, self.joints.len()))
    }

    /// Before anything that takes longer for more of them.
    fn validate_sizes(&self) -> Result<(), SpecError> {
        let segments = self.legs.iter().map(|leg| leg.segments.len()).max().unwrap_or(0);
        let sizes = [
            ("joints", self.joints.len(), MAX_JOINTS),
            ("legs", self.legs.len(), MAX_LEGS),
            ("segments of a leg", segments, MAX_LEGS),
            ("observation blocks", self.observation.len(), Block::ALL.len()),
        ];
        match sizes.into_iter().find(|(_, found, most)| found > most) {
            Some((what, found, most)) => Err(SpecError::TooMany { what, found, most }),
            None => Ok(()),
        }
    }

    fn validate_joints(&self) -> Result<(), SpecError> {
        if self.joints.is_empty() {
            return Err(SpecError::NoJoints);
        }
        for (i, joint) in self.joints.iter().enumerate() {
            if self.joints[..i].iter().any(|other| other.name == joint.name) {
                return Err(SpecError::DuplicateJoint {
                    joint: joint.name.clone(),
                });
            }
            if joint.name.is_empty() || joint.name.chars().any(char::is_control) {
                return Err(SpecError::Name {
                    joint: joint.name.clone(),
                });
            }
            let checks = [
                (
                    "lower",
                    joint.lower,
                    joint.lower.abs() <= LARGEST_POSITION,
                    "but must be -1e4 to 1e4",
                ),
                (
                    "upper",
                    joint.upper,
                    joint.upper <= LARGEST_POSITION && joint.upper >= joint.lower,
                    "but must be at most 1e4 and not below the lower limit",
                ),
                (
                    "nominal",
                    joint.nominal,
                    joint.nominal >= joint.lower && joint.nominal <= joint.upper,
                    "but must be within the joint's limits",
                ),
                (
                    "kp",
                    joint.kp,
                    joint.kp > 0.0 && joint.kp <= LARGEST_GAIN,
                    "but must be positive and at most 1e9",
                ),
                (
                    "kd",
                    joint.kd,
                    (0.0..=LARGEST_GAIN).contains(&joint.kd),
                    "but must be 0 to 1e9",
                ),
                (
                    "torque_limit",
                    joint.torque_limit,
                    joint.torque_limit > 0.0
                        && (joint.torque_limit <= LARGEST_GAIN || joint.torque_limit.is_infinite()),
                    "but must be positive and at most 1e9, or infinite for none",
                ),
                (
                    "action_scale",
                    joint.action_scale,
                    joint.action_scale > 0.0 && joint.action_scale <= LARGEST_POSITION,
                    "but must be positive and at most 1e4",
                ),
            ];
            for (field, value, right, expected) in checks {
                if !right {
                    return Err(SpecError::Joint {
                        joint: joint.name.clone(),
                        field,
                        value,
                        expected,
                    });
                }
            }
        }
        Ok(())
    }

    fn validate_filter(&self) -> Result<(), SpecError> {
        let (field, value, right, expected) = match self.action.filter {
            None => return Ok(()),
            Some(FilterSpec::Exponential { gain }) => (
                "action.filter.gain",
                gain,
                gain > 0.0 && gain <= 1.0,
                "but must be above 0 and at most 1",
            ),
            Some(FilterSpec::Butterworth { cutoff_hz }) => (
                "action.filter.cutoff_hz",
                cutoff_hz,
                cutoff_hz > 0.0 && cutoff_hz < 0.5 * self.control_hz,
                "but must be above 0 and below half the control rate",
            ),
        };
        if right {
            Ok(())
        } else {
            Err(SpecError::Value { field, value, expected })
        }
    }

    fn validate_command(&self) -> Result<(), SpecError> {
        let command = &self.command;
        for axis in 0..3 {
            let (lower, upper, rate) = (command.lower[axis], command.upper[axis], command.rate[axis]);
            let checks = [
                ("command.rate", rate, rate > 0.0, "but must be positive"),
                (
                    "command.lower",
                    lower,
                    lower.abs() <= LARGEST_RATE,
                    "but must be -1e5 to 1e5",
                ),
                (
                    "command.upper",
                    upper,
                    upper <= LARGEST_RATE && upper >= lower,
                    "but must be at most 1e5 and not below command.lower",
                ),
            ];
            for (field, value, right, expected) in checks {
                if !right {
                    return Err(SpecError::Value { field, value, expected });
                }
            }
        }
        Ok(())
    }
}

fn positive(field: &'static str, value: f32) -> Result<(), SpecError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(SpecError::Value {
            field,
            value,
            expected: "but must be finite and positive",
        })
    }
}

fn phase(field: &'static str, value: f32) -> Result<(), SpecError> {
    if (0.0..1.0).contains(&value) {
        Ok(())
    } else {
        Err(SpecError::Value {
            field,
            value,
            expected: "but must be at least 0 and below 1",
        })
    }
}

fn validate_leg(leg: &Leg, joints: usize) -> Result<(), SpecError> {
    let unit = |square: f32| (square - 1.0).abs() < 1e-3;
    let turn = |q: [f32; 4]| unit(q.iter().map(|x| x * x).sum());
    let wrong = |field, expected| SpecError::Geometry {
        leg: leg.name.clone(),
        field,
        expected,
    };
    for (i, segment) in leg.segments.iter().enumerate() {
        if let Some(joint) = segment.joint.filter(|&joint| usize::from(joint) >= joints) {
            return Err(SpecError::UnknownJoint {
                leg: leg.name.clone(),
                segment: i,
                joint,
                joints,
            });
        }
        let [x, y, z] = segment.translation;
        if ![x, y, z, segment.multiplier].iter().all(|x| x.abs() <= LARGEST_LENGTH) {
            return Err(wrong("a segment's translation or multiplier", "at most 1e3"));
        }
        if segment.offset.is_nan() || segment.offset.abs() > LARGEST_POSITION {
            return Err(wrong("a segment's offset", "at most 1e4"));
        }
        if !turn(segment.rotation) {
            return Err(wrong("a segment's rotation", "a unit quaternion"));
        }
        if !unit(dot(segment.axis, segment.axis)) {
            return Err(wrong("a segment's axis", "a unit vector"));
        }
    }
    if !leg.corners.iter().flatten().all(|x| x.abs() <= LARGEST_LENGTH) {
        return Err(wrong("a sole corner", "at most 1e3"));
    }
    if turn(leg.sole_rotation) {
        Ok(())
    } else {
        Err(wrong("the sole's rotation", "a unit quaternion"))
    }
}
