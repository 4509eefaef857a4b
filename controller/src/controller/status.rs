//! What a step says beside its targets, as data and in words.

use alloc::string::{String, ToString};
use core::fmt;

use crate::{spec::Spec, walker::OutOfRange};

/// What the controller is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The policy moves the joints.
    Walking,
    /// The last targets are held.
    Holding,
    /// The targets move to the nominal pose.
    Ramping,
    /// The targets are the nominal pose.
    Resting,
}

/// Why the policy does not move the joints in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The newest reading is too old, or from the future.
    Stale {
        /// Its age, s; negative from the future.
        age: f32,
    },
    /// A reading is not a finite number.
    NotFinite {
        /// Which.
        reading: Reading,
        /// Index within it.
        index: usize,
    },
    /// A reading that no working sensor gives: a position beyond the joint's limits by more than a tenth of its range and 0.02 rad
    /// or m, an angle of the base beyond half a turn, or a rate beyond 1000 rad/s or m/s.
    Absurd {
        /// Which.
        reading: Reading,
        /// Index within it.
        index: usize,
        /// What it says.
        value: f32,
    },
    /// The base tilts, or has tilted since the last reset, by more than the policy was trained to survive.
    Fallen,
    /// The step came sooner than the control rate allows: nothing was done.
    OverRate,
}

/// What a fault is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Position of a joint.
    Position,
    /// Velocity of a joint.
    Velocity,
    /// Fused roll or pitch of the base.
    Attitude,
    /// An axis of the angular velocity of the base.
    Gyro,
    /// An axis of the velocity of the base, where it is given.
    BaseVelocity,
}

impl Reading {
    /// Its name among [`crate::Sensors`].
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Attitude => "attitude",
            Self::Gyro => "gyro",
            Self::BaseVelocity => "base_velocity",
        }
    }

    /// What its entries are called, where there is not one for each joint.
    fn entries(self) -> &'static [&'static str] {
        match self {
            Self::Position | Self::Velocity => &[],
            Self::Attitude => &["roll", "pitch"],
            Self::Gyro | Self::BaseVelocity => &["x", "y", "z"],
        }
    }
}

/// What became of the desired velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Taken as it is.
    Taken,
    /// Clipped to the range that was trained.
    Clipped,
    /// Not a number: its axis stayed what it was.
    NotFinite,
}

/// What a step says beside its targets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Status {
    /// What the targets are.
    pub mode: Mode,
    /// What kept the policy from this step.
    pub fault: Option<Fault>,
    /// An observation that training did not see; it was clipped.
    pub out_of_range: Option<OutOfRange>,
    /// What became of the desired velocity.
    pub command: Command,
    /// How much later the step came than its period after the one before, s; 0 if within half a period.
    pub late: f32,
}

impl Status {
    /// True if the policy walks on readings and a command like those of training, in time.
    pub fn is_ok(&self) -> bool {
        self.mode == Mode::Walking
            && self.fault.is_none()
            && self.out_of_range.is_none()
            && self.command == Command::Taken
            && self.late == 0.0
    }
}

impl Status {
    /// What is not as it should be, in words, with the names of `spec`; empty if all is.
    pub fn sentence<'a>(&'a self, spec: &'a Spec) -> Sentence<'a> {
        Sentence { status: self, spec }
    }
}

/// A [`Status`] in words.
#[derive(Clone, Copy, Debug)]
pub struct Sentence<'a> {
    status: &'a Status,
    spec: &'a Spec,
}

impl fmt::Display for Sentence<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { status, spec } = self;
        let mut between = "";
        if let Some(fault) = status.fault {
            fault.write(spec, f)?;
            between = "; ";
        }
        if let Some(beyond) = status.out_of_range {
            let name = spec.entry_name(beyond.entry).unwrap_or_default();
            let (value, excess) = (beyond.value, beyond.excess);
            write!(f, "{between}{name} is {value}, beyond training by {excess}")?;
            if beyond.entries > 1 {
                write!(f, ", as are {} more readings", beyond.entries - 1)?;
            }
            between = "; ";
        }
        match status.command {
            Command::Taken => {}
            Command::Clipped => {
                write!(f, "{between}the desired velocity is clipped to what was trained")?;
                between = "; ";
            }
            Command::NotFinite => {
                write!(f, "{between}the desired velocity is not a number and stays what it was")?;
                between = "; ";
            }
        }
        if status.late > 0.0 {
            write!(f, "{between}the step came {:.3} s late", status.late)?;
            between = "; ";
        }
        match status.mode {
            Mode::Walking | Mode::Holding => Ok(()),
            Mode::Ramping => write!(f, "{between}the targets move to the nominal pose"),
            Mode::Resting => write!(
                f,
                "{between}waiting in the nominal pose for good readings and for joints to be there"
            ),
        }
    }
}

impl Fault {
    /// In words, with the names of `spec`.
    pub fn sentence(self, spec: &Spec) -> String {
        let status = Status {
            mode: Mode::Holding,
            fault: Some(self),
            out_of_range: None,
            command: Command::Taken,
            late: 0.0,
        };
        status.sentence(spec).to_string()
    }

    fn write(self, spec: &Spec, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stale { age } if age < 0.0 => write!(f, "the newest reading is {:.3} s from the future", -age),
            Self::Stale { age } => write!(f, "the newest reading is {age:.3} s old"),
            Self::NotFinite { reading, index } => {
                write_reading(reading, index, spec, f)?;
                write!(f, " is not a finite number")
            }
            Self::Absurd { reading, index, value } => {
                write_reading(reading, index, spec, f)?;
                write!(f, " is {value}, which cannot be")?;
                match spec.joints.get(index).filter(|_| reading == Reading::Position) {
                    Some(joint) => write!(f, ": its limits are {} and {}", joint.lower, joint.upper),
                    None => Ok(()),
                }
            }
            Self::Fallen => write!(f, "the robot has fallen; reset the controller"),
            Self::OverRate => write!(f, "the step came sooner than the control rate allows"),
        }
    }
}

fn write_reading(reading: Reading, index: usize, spec: &Spec, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let joint = || spec.joints.get(index).map_or("", |joint| joint.name.as_str());
    let entry = reading.entries().get(index).copied().unwrap_or_else(joint);
    write!(f, "{}[{entry}]", reading.name())
}
