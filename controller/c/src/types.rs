//! What is passed between C and the controller.

use omniwalk_controller::{Command, Fault, Mode, Reading, Status};

/// What became of a call. `ow_message` says more of whatever is not OK.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwResult {
    /// It was done.
    Ok = 0,
    /// A pointer is null, a length is not the policy's, or a text is not UTF-8.
    Argument = 1,
    /// The file cannot be read.
    Io = 2,
    /// The bytes are no policy, or not one that this program runs as it was trained.
    Policy = 3,
    /// The policy does not fit the robot.
    Misfit = 4,
    /// A mistake in the controller itself; do not use it any more.
    Internal = 5,
    /// Readings that cannot be believed.
    Readings = 6,
}

/// What the controller is doing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwMode {
    /// The policy moves the joints.
    Walking = 0,
    /// The last targets are held.
    Holding = 1,
    /// The targets move to the nominal pose.
    Ramping = 2,
    /// The targets are the nominal pose.
    Resting = 3,
}

/// Why the policy does not move the joints in a step.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwFault {
    /// It does.
    None = 0,
    /// The newest reading is too old, or from the future.
    Stale = 1,
    /// A reading is not a finite number.
    NotFinite = 2,
    /// The base tilts, or has tilted since the last reset, beyond what training allowed.
    Fallen = 3,
    /// The step came sooner than the control rate allows: nothing was done.
    OverRate = 4,
    /// A reading is one that no working sensor gives: a position beyond the joint's limits by more than a tenth of its range and
    /// 0.02 rad or m, an angle of the base beyond half a turn, or a rate beyond 1000 rad/s or m/s.
    Absurd = 5,
}

/// Which reading a fault is about.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwReading {
    /// None alone.
    None = 0,
    /// Position of a joint.
    Position = 1,
    /// Velocity of a joint.
    Velocity = 2,
    /// Fused roll or pitch of the base.
    Attitude = 3,
    /// An axis of the angular velocity of the base.
    Gyro = 4,
    /// An axis of the velocity of the base.
    BaseVelocity = 5,
}

/// What became of the desired velocity.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwCommand {
    /// Taken as it is.
    Taken = 0,
    /// Clipped to the range that was trained.
    Clipped = 1,
    /// Not a number: its axis stayed what it was.
    NotFinite = 2,
}

/// Readings of one control step.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct OwReadings {
    /// When they were measured, ns on the clock of `ow_step`'s `now`.
    pub measured: u64,
    /// Positions of the policy's joints in its order, rad or m.
    pub position: *const f32,
    /// Velocities of the policy's joints in its order, rad/s or m/s.
    pub velocity: *const f32,
    /// Fused roll and pitch of the base, rad.
    pub attitude: [f32; 2],
    /// Angular velocity of the base in the base frame, rad/s.
    pub gyro: [f32; 3],
    /// Velocity of the base origin in the base frame, m/s, if `has_base_velocity`; otherwise it is estimated from the legs.
    pub base_velocity: [f32; 3],
    /// Whether `base_velocity` is given.
    pub has_base_velocity: bool,
}

/// What a step says beside its targets.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct OwStatus {
    /// What the targets are.
    pub mode: OwMode,
    /// What kept the policy from this step.
    pub fault: OwFault,
    /// Age of a stale reading, s; negative from the future.
    pub stale_age: f32,
    /// Which reading is not finite or absurd.
    pub reading: OwReading,
    /// Index of its joint or axis, or -1.
    pub reading_index: i32,
    /// What became of the desired velocity.
    pub command: OwCommand,
    /// Entry of the observation farthest beyond what training saw, or -1; `ow_entry_name` names it.
    pub out_of_range_entry: i32,
    /// Its value before it was clipped.
    pub out_of_range_value: f32,
    /// By how much it was beyond.
    pub out_of_range_excess: f32,
    /// How many entries were beyond.
    pub out_of_range_entries: u32,
    /// How much later than due the step came, s; 0 if within half a period.
    pub late: f32,
}

/// A joint of the policy, as it was trained; the robot's must be the same.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct OwJoint {
    /// Position in the nominal pose, rad or m.
    pub nominal: f32,
    /// Lower position limit, rad or m.
    pub lower: f32,
    /// Upper position limit, rad or m.
    pub upper: f32,
    /// Position gain, N m/rad or N/m.
    pub kp: f32,
    /// Velocity gain, N m s/rad or N s/m.
    pub kd: f32,
    /// Torque limit, N m or N.
    pub torque_limit: f32,
}

impl From<Status> for OwStatus {
    fn from(status: Status) -> Self {
        let beyond = status.out_of_range;
        let reading = match status.fault {
            Some(Fault::NotFinite { reading, index } | Fault::Absurd { reading, index, .. }) => Some((reading, index)),
            _ => None,
        };
        Self {
            mode: match status.mode {
                Mode::Walking => OwMode::Walking,
                Mode::Holding => OwMode::Holding,
                Mode::Ramping => OwMode::Ramping,
                Mode::Resting => OwMode::Resting,
            },
            fault: match status.fault {
                None => OwFault::None,
                Some(Fault::Stale { .. }) => OwFault::Stale,
                Some(Fault::NotFinite { .. }) => OwFault::NotFinite,
                Some(Fault::Fallen) => OwFault::Fallen,
                Some(Fault::OverRate) => OwFault::OverRate,
                Some(Fault::Absurd { .. }) => OwFault::Absurd,
            },
            stale_age: match status.fault {
                Some(Fault::Stale { age }) => age,
                _ => 0.0,
            },
            reading: reading.map_or(OwReading::None, |(reading, _)| reading.into()),
            reading_index: reading.map_or(-1, |(_, index)| index as i32),
            command: match status.command {
                Command::Taken => OwCommand::Taken,
                Command::Clipped => OwCommand::Clipped,
                Command::NotFinite => OwCommand::NotFinite,
            },
            out_of_range_entry: beyond.map_or(-1, |beyond| beyond.entry as i32),
            out_of_range_value: beyond.map_or(0.0, |beyond| beyond.value),
            out_of_range_excess: beyond.map_or(0.0, |beyond| beyond.excess),
            out_of_range_entries: beyond.map_or(0, |beyond| beyond.entries as u32),
            late: status.late,
        }
    }
}

impl From<Reading> for OwReading {
    fn from(reading: Reading) -> Self {
        match reading {
            Reading::Position => Self::Position,
            Reading::Velocity => Self::Velocity,
            Reading::Attitude => Self::Attitude,
            Reading::Gyro => Self::Gyro,
            Reading::BaseVelocity => Self::BaseVelocity,
        }
    }
}
