//! What a policy's observation and action mean.

use alloc::{string::String, vec::Vec};

use serde::{Deserialize, Serialize};

/// The complete description of the chain from sensors to joint targets. Written once by training, carried by the
/// policy, the same everywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spec {
    /// Control rate, Hz (40 in the thesis).
    pub control_hz: f32,
    /// The policy's joints in the order of every joint array.
    pub joints: Vec<JointSpec>,
    /// Blocks of the observation in order.
    pub observation: Vec<Block>,
    /// How actions become targets.
    pub action: ActionSpec,
    /// The phase clock, if the policy has one.
    pub clock: Option<ClockSpec>,
    /// The robot's left-right mirror, one entry for each policy joint, if the policy walks symmetrically: in the second
    /// half of the clock's cycle it sees and moves the robot's mirror image, so that it only ever swings leg 0.
    pub symmetry: Option<Vec<MirroredJoint>>,
    /// Ramp and bounds of the desired velocity.
    pub command: CommandSpec,
    /// Kinematics of each foot, left first, for the velocity estimator.
    pub legs: Vec<Leg>,
    /// Seconds after which the inertial frame is set to the current heading again (thesis 7.3.1).
    pub inertial_frame_period: f32,
    /// Fused roll and pitch of the base, rad, beyond which episodes of training ended: the robot has fallen.
    pub upright: [f32; 2],
}

/// One joint of the policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointSpec {
    /// The URDF's name.
    pub name: String,
    /// Position in the nominal pose, rad or m.
    pub nominal: f32,
    /// Lower position limit, rad or m.
    pub lower: f32,
    /// Upper position limit, rad or m.
    pub upper: f32,
    /// Position gain of the actuator, N m/rad or N/m.
    pub kp: f32,
    /// Velocity gain of the actuator, N m s/rad or N s/m.
    pub kd: f32,
    /// Torque limit of the actuator, N m or N.
    pub torque_limit: f32,
    /// Half range of the action, rad or m: the bound of the increment, or the scale of the offset.
    pub action_scale: f32,
}

/// A block of the observation. `n` is the number of policy joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Block {
    /// Measured joint positions, rad or m; `n`.
    JointPosition,
    /// Measured joint velocities, rad/s or m/s; `n`.
    JointVelocity,
    /// Fused roll and pitch of the base, rad; 2.
    Attitude,
    /// Angular velocity of the base in the base frame, rad/s; 3.
    Gyro,
    /// Estimated velocity of the base in the inertial frame, m/s; 3.
    VelocityInertial,
    /// Estimated velocity of the base in the base frame, m/s; 3.
    VelocityBase,
    /// Desired velocity (v_x, v_y, omega_z), m/s, m/s, rad/s; 3.
    DesiredVelocity,
    /// Commanded velocity: the desired one after its ramp; 3.
    CommandedVelocity,
    /// Sine and cosine of the phase clock; 2.
    Clock,
    /// Targets sent in the previous step minus the nominal pose, rad or m; `n`.
    PreviousTarget,
    /// Commanded minus measured velocity (v_x, v_y, omega_z), a mean over the last [`TRACKING_SECONDS`], m/s, m/s, rad/s; 3.
    TrackingError,
}

/// Time constant of the exponential mean in [`Block::TrackingError`], s: more than a gait's cycle, so that its sway does not show.
pub const TRACKING_SECONDS: f32 = 1.0;

/// How actions in [0, 1] become joint targets. `u = 2 a - 1`, filtered; `scale` is [`JointSpec::action_scale`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionSpec {
    /// The law.
    pub law: ActionLaw,
    /// Low-pass on `u`; starts at the first action.
    pub filter: Option<FilterSpec>,
    /// Clamp the target to what the actuator can do in a step: `q +- torque_limit / kp`.
    pub torque_clamp: bool,
}

/// What an action is added to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionLaw {
    /// `target = q + scale u` with the measured position q (thesis 7.3.2).
    IncrementOnMeasured,
    /// `target = previous target + scale u`.
    IncrementOnTarget,
    /// `target = nominal + scale u`.
    OffsetFromNominal,
}

/// A discrete low-pass on the action.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum FilterSpec {
    /// `y += gain (x - y)`.
    Exponential {
        /// Share of the new value, 0 to 1.
        gain: f32,
    },
    /// Second-order Butterworth by the bilinear transform with prewarping.
    Butterworth {
        /// Cutoff frequency, Hz, below half the control rate.
        cutoff_hz: f32,
    },
}

/// A phase clock that counts steps of the gait.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClockSpec {
    /// Duration of a full cycle (two steps), s.
    pub period: f32,
    /// Phase in cycles, 0 to 1, that a robot begins with; 0 is the start of a swing of leg 0.
    pub reset_phase: f32,
}

/// Where a joint's value comes from in the mirrored robot: `mirrored[i] = sign * original[joint]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MirroredJoint {
    /// The joint on the other side, or the joint itself.
    pub joint: u16,
    /// +1 or -1.
    pub sign: f32,
}

/// The way from the desired to the commanded velocity (thesis 7.3.1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CommandSpec {
    /// Largest change of the commanded velocity, (m/s^2, m/s^2, rad/s^2).
    pub rate: [f32; 3],
    /// Smallest desired velocity the policy knows, (m/s, m/s, rad/s).
    pub lower: [f32; 3],
    /// Largest desired velocity the policy knows, (m/s, m/s, rad/s).
    pub upper: [f32; 3],
}

/// Kinematic chain from the base link to a sole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Leg {
    /// The foot's name.
    pub name: String,
    /// Joints from the base outward.
    pub segments: Vec<Segment>,
    /// Sole corners in the frame after the last segment, m.
    pub corners: [[f32; 3]; 4],
    /// Rotation (quaternion x, y, z, w) of the sole frame in the frame after the last segment.
    pub sole_rotation: [f32; 4],
}

/// A joint of a [`Leg`]: a fixed pose, then motion about or along an axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// Translation in the previous frame, m.
    pub translation: [f32; 3],
    /// Rotation in the previous frame, quaternion x, y, z, w.
    pub rotation: [f32; 4],
    /// Unit axis.
    pub axis: [f32; 3],
    /// True for a sliding joint.
    pub prismatic: bool,
    /// The policy joint that drives it; `None` for a joint at `offset`.
    pub joint: Option<u16>,
    /// Position is `multiplier * q[joint] + offset`.
    pub multiplier: f32,
    /// See `multiplier`.
    pub offset: f32,
}

impl Spec {
    /// Number of policy joints.
    pub fn action_len(&self) -> usize {
        self.joints.len()
    }

    /// Whether every joint (rad or m, in the policy's order) is within a quarter of its range of the nominal pose: as near as joints
    /// that carry a load come, and nearer than those that did not go there.
    pub(crate) fn is_near_nominal(&self, position: &[f32]) -> bool {
        let mut joints = self.joints.iter().zip(position);
        joints.all(|(joint, position)| libm::fabsf(position - joint.nominal) <= 0.25 * (joint.upper - joint.lower))
    }

    /// Length of an observation block.
    pub fn block_len(&self, block: Block) -> usize {
        match block {
            Block::JointPosition | Block::JointVelocity | Block::PreviousTarget => self.joints.len(),
            Block::Attitude | Block::Clock => 2,
            Block::Gyro
            | Block::VelocityInertial
            | Block::VelocityBase
            | Block::DesiredVelocity
            | Block::CommandedVelocity
            | Block::TrackingError => 3,
        }
    }

    /// Length of the observation.
    pub fn observation_len(&self) -> usize {
        self.observation.iter().map(|&block| self.block_len(block)).sum()
    }
}
