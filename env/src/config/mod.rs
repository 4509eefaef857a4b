//! The configuration of the environment: one struct a section of the TOML file.
//!
//! No field has a default here: `configs/default.toml` holds every key and is the one place of defaults.

mod simd;
mod validate;

use omniwalk_controller::{ActionLaw, Block, FilterSpec};
use serde::{Deserialize, Serialize};

pub use simd::SimdChoice;
pub use validate::Invalid;

/// Which engine steps the worlds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineKind {
    /// rapier multibodies, the engine of record.
    Rapier,
    /// Robots side by side in SIMD lanes.
    Lanes,
}

impl EngineKind {
    /// Every engine.
    pub const ALL: [Self; 2] = [Self::Rapier, Self::Lanes];

    /// As configurations write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rapier => "rapier",
            Self::Lanes => "lanes",
        }
    }
}

/// Section `[engine]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EngineConfig {
    /// Which engine.
    pub kind: EngineKind,
    /// Physics steps per second; a multiple of the control rate.
    pub physics_hz: u32,
    /// Control steps per second (thesis 7.5: 40).
    pub control_hz: u32,
    /// SIMD level of `lanes`.
    pub simd: SimdChoice,
}

/// The shapes of the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundKind {
    /// Flat and level.
    Plane,
    /// Flat and tilted.
    Slope,
    /// A field of random heights.
    Rough,
}

/// Section `[ground]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundConfig {
    /// Which shape.
    pub kind: GroundKind,
    /// Angles by which a slope rises along x and y, rad.
    pub slope: [f64; 2],
    /// Heights of rough ground are uniform within this distance of zero, m.
    pub amplitude: f64,
    /// Distance between these heights, m.
    pub cell: f64,
    /// Seed of these heights.
    pub seed: u64,
}

/// Section `[observation]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationConfig {
    /// Blocks in order (thesis 7.3.1).
    pub blocks: Vec<Block>,
    /// Seconds between resets of the inertial frame to the current heading.
    pub inertial_frame_period: f64,
    /// Ablation: the simulation's own velocity instead of the estimator's.
    pub true_velocity: bool,
}

/// Section `[action]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionConfig {
    /// What an action is added to.
    pub law: ActionLaw,
    /// Half range of an action, rad or m.
    pub scale: f64,
    /// Clamp targets to what the actuator can do in a step.
    pub torque_clamp: bool,
    /// Low-pass on the action.
    pub filter: FilterConfig,
}

/// Section `[action.filter]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterConfig {
    /// Switch.
    pub enabled: bool,
    /// `exponential` or `butterworth`.
    pub kind: FilterKind,
    /// Share of the new value, for `exponential`.
    pub gain: f64,
    /// Cutoff, Hz, for `butterworth` (second order).
    pub cutoff_hz: f64,
}

/// The filters an action can pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilterKind {
    /// First-order exponential smoothing.
    Exponential,
    /// Second-order Butterworth.
    Butterworth,
}

impl FilterConfig {
    /// The filter as the controller knows it.
    pub fn spec(&self) -> Option<FilterSpec> {
        self.enabled.then_some(match self.kind {
            FilterKind::Exponential => FilterSpec::Exponential { gain: self.gain as f32 },
            FilterKind::Butterworth => FilterSpec::Butterworth {
                cutoff_hz: self.cutoff_hz as f32,
            },
        })
    }
}

/// Section `[clock]`: a phase clock in the observation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockConfig {
    /// Switch; the block `clock` joins the observation.
    pub enabled: bool,
    /// Seconds for two steps.
    pub period: f64,
    /// In the second half of the cycle the policy sees and moves the robot's mirror image, so that it learns one step
    /// instead of two and walks the same to the left and to the right. Robots without a mirror map, and policies without
    /// a clock, stay as they are.
    pub symmetric: bool,
}

/// Section `[command]`: the desired velocity and its way into the commanded one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandConfig {
    /// Smallest desired velocity (m/s, m/s, rad/s).
    pub lower: [f64; 3],
    /// Largest desired velocity (m/s, m/s, rad/s).
    pub upper: [f64; 3],
    /// Largest rate of change of the commanded velocity (m/s^2, m/s^2, rad/s^2).
    pub rate: [f64; 3],
    /// Share of the draws that are exactly zero.
    pub zero_share: f64,
    /// Share of the draws that keep a single axis of the three.
    pub axis_share: f64,
    /// Seconds between draws within an episode; 0 draws once an episode (thesis).
    pub resample_seconds: f64,
}

/// Section `[task]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskConfig {
    /// Length of an episode, s.
    pub episode_seconds: f64,
    /// The first episode of each environment has a random length, so that time-outs do not coincide.
    pub random_first_length: bool,
    /// The robot has fallen when its base is lower than this share of the nominal height (p_z_min).
    pub min_height: f64,
    /// The robot has fallen when its base rolls beyond this, rad.
    pub max_roll: f64,
    /// The robot has fallen when its base pitches beyond this, rad.
    pub max_pitch: f64,
    /// End the episode when the legs overlap.
    pub end_on_overlap: bool,
    /// Legs that come this close count as overlapping, m.
    pub overlap_margin: f64,
}

/// Section `[reward]` (thesis 7.3.3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardConfig {
    /// Weight of the velocity term, w_v.
    pub velocity_weight: f64,
    /// Sharpness of its kernel, l_v.
    pub velocity_kernel: f64,
    /// Seconds of the low-pass on the velocity in the reward; 0: none (thesis).
    pub velocity_filter: f64,
    /// The inertial velocity is judged along the heading commanded since the inertial frame was set. Along the frame
    /// itself (false, thesis) a command that turns and walks contradicts itself: it asks for one velocity in two frames that turn apart.
    pub commanded_heading: bool,
    /// Weight of the pose term, w_r.
    pub pose_weight: f64,
    /// Sharpness of its kernel, l_r.
    pub pose_kernel: f64,
    /// Joints that are regularised: names, in which `*` stands for any characters.
    pub pose_joints: Vec<String>,
    /// Weight of being alive, w_a.
    pub alive_weight: f64,
    /// Weight of foot clearance, w_f.
    pub foot_weight: f64,
    /// Sharpness of its kernel, l_foot.
    pub foot_kernel: f64,
    /// Weight of metres against radians in the foot error, w_phi.
    pub foot_height_weight: f64,
    /// Desired clearance of the swing foot, m.
    pub clearance: f64,
    /// The swing leg changes when the other foot is higher by this, m.
    pub swing_hysteresis: f64,
    /// The clock chooses the swing foot and its clearance follows a squared sine.
    pub clock_swing: bool,
    /// Weight of the penalty on the change of the action between steps (mean square of the change of `u`).
    pub action_rate_weight: f64,
    /// Weight of the penalty on the horizontal speed of a loaded foot, per (m/s)^2.
    pub slip_weight: f64,
    /// Price of a touchdown of the foot that touched down last, too.
    pub tap_weight: f64,
}

/// Section `[noise]`: standard deviations of the sensors (thesis 7.5).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseConfig {
    /// Switch.
    pub enabled: bool,
    /// Gyroscope, rad/s.
    pub gyro: f64,
    /// Accelerometer, m/s^2; reaches the policy through the attitude estimate as a tilt of this over g.
    pub accelerometer: f64,
    /// Joint position encoders, rad or m.
    pub position: f64,
    /// Joint velocity sensors, rad/s or m/s.
    pub velocity: f64,
}

/// Section `[latency]` (thesis 7.4).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatencyConfig {
    /// Switch.
    pub enabled: bool,
    /// Smallest latency of an episode, s.
    pub lower: f64,
    /// Largest latency of an episode, s.
    pub upper: f64,
    /// By how much a reading may come later than that, s: each by a uniform draw between zero and this.
    pub jitter: f64,
}

impl LatencyConfig {
    /// Oldest a reading can be when the policy has it, s.
    pub fn longest(&self) -> f64 {
        if self.enabled { self.upper + self.jitter } else { 0.0 }
    }
}

/// Section `[friction]`: ranges of the sole's friction (thesis 7.5).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrictionConfig {
    /// Draw per episode; otherwise the middle of each range.
    pub enabled: bool,
    /// Tangential coefficient.
    pub tangential: [f64; 2],
    /// Torsional coefficient, m.
    pub torsional: [f64; 2],
    /// Rolling coefficient, m.
    pub rolling: [f64; 2],
}

/// Section `[randomise]`: what else differs from episode to episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RandomiseConfig {
    /// Half range of the factor on each joint's response, epsilon_pd (equation 7.14); 0: off.
    pub pd_noise: f64,
    /// Half range of the factor on every link's mass and inertia; 0: off.
    pub mass: f64,
    /// Half range of the shift of the base's centre of mass along each axis, m; 0: off.
    pub centre_of_mass: f64,
    /// Standard deviation of the joints' start positions around the nominal pose, rad or m; 0: off.
    pub start_position: f64,
    /// Whether each environment draws the values that the robot gives a `[[range]]` for; without, they are those of its effects.
    pub effects: bool,
}

/// Section `[push]`: random pushes at the base.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PushConfig {
    /// Switch.
    pub enabled: bool,
    /// Mean seconds between pushes.
    pub interval: f64,
    /// Seconds a push lasts.
    pub duration: f64,
    /// Largest horizontal force, N.
    pub force: f64,
}

/// All sections an environment needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EnvConfig {
    /// `[engine]`
    pub engine: EngineConfig,
    /// `[ground]`
    pub ground: GroundConfig,
    /// `[observation]`
    pub observation: ObservationConfig,
    /// `[action]`
    pub action: ActionConfig,
    /// `[clock]`
    pub clock: ClockConfig,
    /// `[command]`
    pub command: CommandConfig,
    /// `[task]`
    pub task: TaskConfig,
    /// `[reward]`
    pub reward: RewardConfig,
    /// `[noise]`
    pub noise: NoiseConfig,
    /// `[latency]`
    pub latency: LatencyConfig,
    /// `[friction]`
    pub friction: FrictionConfig,
    /// `[randomise]`
    pub randomise: RandomiseConfig,
    /// `[push]`
    pub push: PushConfig,
}

impl EnvConfig {
    /// Duration of a control step, s.
    pub fn control_dt(&self) -> f64 {
        1.0 / f64::from(self.engine.control_hz)
    }

    /// Duration of a physics step, s.
    pub fn physics_dt(&self) -> f64 {
        1.0 / f64::from(self.engine.physics_hz)
    }

    /// Physics steps in a control step.
    pub fn substeps(&self) -> u32 {
        self.engine.physics_hz / self.engine.control_hz
    }

    /// Largest episode length, control steps.
    pub fn episode_steps(&self) -> u32 {
        (self.task.episode_seconds * f64::from(self.engine.control_hz)).round() as u32
    }
}
