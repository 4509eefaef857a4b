//! The configuration of the environment: one struct a section of the TOML file.
//!
//! No field has a default here: `configs/default.toml` holds every key and is the one place of defaults.

use crate::engine::lanes::Simd;
use omniwalk_controller::{ActionLaw, Block, FilterSpec};
use serde::{Deserialize, Serialize};

/// A value that makes no sense: the dotted key and what would be right.
pub type Invalid = (&'static str, String);

/// Which engine steps the worlds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineKind {
    /// rapier multibodies, the engine of record.
    Rapier,
    /// Robots side by side in SIMD lanes.
    Lanes,
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

/// The SIMD level of the engine `lanes`: the fastest there is, or a given one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SimdChoice {
    /// The fastest this processor has.
    Auto,
    /// Sixteen robots in `f32`; AVX-512.
    F32x16,
    /// Eight robots in `f32`; AVX2 and FMA.
    F32x8,
    /// Eight robots in `f64`; AVX-512.
    F64x8,
    /// Four robots in `f64`; AVX2 and FMA.
    F64x4,
    /// One robot at a time in `f64`; any processor.
    Scalar,
}

impl SimdChoice {
    /// The level to use on this processor.
    pub fn level(self) -> Simd {
        match self {
            Self::Auto => Simd::detect(),
            Self::F32x16 => Simd::F32x16,
            Self::F32x8 => Simd::F32x8,
            Self::F64x8 => Simd::F64x8,
            Self::F64x4 => Simd::F64x4,
            Self::Scalar => Simd::Scalar,
        }
    }
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
    /// Weight of the pose term, w_r.
    pub pose_weight: f64,
    /// Sharpness of its kernel, l_r.
    pub pose_kernel: f64,
    /// Joints that are regularised: names, `*` at the end stands for any ending.
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
    /// The clock chooses the swing foot and its clearance follows a half sine.
    pub clock_swing: bool,
    /// Weight of the penalty on the change of the action between steps (mean square of the change of `u`).
    pub action_rate_weight: f64,
    /// Weight of the penalty on the horizontal speed of a loaded foot, per (m/s)^2.
    pub slip_weight: f64,
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

    /// Every value that makes no sense.
    pub fn invalid(&self) -> Vec<Invalid> {
        let mut found = Vec::new();
        let mut require = |holds: bool, key: &'static str, right: String| {
            if !holds {
                found.push((key, right));
            }
        };
        let e = &self.engine;
        require(
            (10..=1000).contains(&e.control_hz),
            "engine.control_hz",
            "10 to 1000".into(),
        );
        require(
            (100..=10_000).contains(&e.physics_hz)
                && e.control_hz > 0
                && e.physics_hz.is_multiple_of(e.control_hz.max(1)),
            "engine.physics_hz",
            format!(
                "a multiple of engine.control_hz = {} between 100 and 10000",
                e.control_hz
            ),
        );
        let o = &self.observation;
        require(!o.blocks.is_empty(), "observation.blocks", "at least one block".into());
        require(
            !o.blocks.contains(&Block::Clock),
            "observation.blocks",
            "without `clock`, which clock.enabled adds".into(),
        );
        require(
            (1..o.blocks.len()).all(|i| !o.blocks[..i].contains(&o.blocks[i])),
            "observation.blocks",
            "a list with each block at most once".into(),
        );
        positive(
            &mut require,
            o.inertial_frame_period,
            "observation.inertial_frame_period",
        );
        positive(&mut require, self.action.scale, "action.scale");
        let f = &self.action.filter;
        require(
            f.gain > 0.0 && f.gain <= 1.0,
            "action.filter.gain",
            "above 0 and at most 1".into(),
        );
        require(
            f.cutoff_hz > 0.0 && f.cutoff_hz < 0.5 * f64::from(e.control_hz),
            "action.filter.cutoff_hz",
            format!(
                "above 0 and below half the control rate, {}",
                0.5 * f64::from(e.control_hz)
            ),
        );
        positive(&mut require, self.clock.period, "clock.period");
        self.invalid_command(&mut require);
        self.invalid_task(&mut require);
        self.invalid_randomisation(&mut require);
        found
    }

    fn invalid_command(&self, require: &mut impl FnMut(bool, &'static str, String)) {
        let c = &self.command;
        require(
            c.lower.iter().all(|x| (-100.0..=0.0).contains(x)),
            "command.lower",
            "-100 to 0 on each axis".into(),
        );
        require(
            c.upper.iter().all(|x| (0.0..=100.0).contains(x)),
            "command.upper",
            "0 to 100 on each axis".into(),
        );
        require(
            c.rate.iter().all(|x| (1e-6..=1e6).contains(x)),
            "command.rate",
            "1e-6 to 1e6 on each axis".into(),
        );
        share(require, c.zero_share, "command.zero_share");
        share(require, c.axis_share, "command.axis_share");
        require(
            c.zero_share + c.axis_share <= 1.0,
            "command.axis_share",
            format!("at most 1 - command.zero_share = {}", 1.0 - c.zero_share),
        );
        not_negative(require, c.resample_seconds, "command.resample_seconds");
    }

    fn invalid_task(&self, require: &mut impl FnMut(bool, &'static str, String)) {
        let t = &self.task;
        require(
            t.episode_seconds >= 2.0 * self.control_dt() && t.episode_seconds <= 86_400.0,
            "task.episode_seconds",
            "at least two control steps and at most a day".into(),
        );
        require(
            (0.0..1.0).contains(&t.min_height),
            "task.min_height",
            "0 up to, not including, 1".into(),
        );
        let angle = |x: f64| x > 0.0 && x <= std::f64::consts::FRAC_PI_2;
        require(
            angle(t.max_roll),
            "task.max_roll",
            "above 0 and at most pi/2 rad".into(),
        );
        require(
            angle(t.max_pitch),
            "task.max_pitch",
            "above 0 and at most pi/2 rad".into(),
        );
        let r = &self.reward;
        for (value, key) in [
            (r.velocity_weight, "reward.velocity_weight"),
            (r.velocity_kernel, "reward.velocity_kernel"),
            (r.velocity_filter, "reward.velocity_filter"),
            (r.pose_weight, "reward.pose_weight"),
            (r.pose_kernel, "reward.pose_kernel"),
            (r.alive_weight, "reward.alive_weight"),
            (r.foot_weight, "reward.foot_weight"),
            (r.foot_kernel, "reward.foot_kernel"),
            (r.foot_height_weight, "reward.foot_height_weight"),
            (r.clearance, "reward.clearance"),
            (r.swing_hysteresis, "reward.swing_hysteresis"),
            (r.action_rate_weight, "reward.action_rate_weight"),
            (r.slip_weight, "reward.slip_weight"),
        ] {
            not_negative(require, value, key);
        }
        require(
            !r.clock_swing || self.clock.enabled,
            "reward.clock_swing",
            "false, or clock.enabled = true: the swing foot cannot follow a clock that is off".into(),
        );
    }

    fn invalid_randomisation(&self, require: &mut impl FnMut(bool, &'static str, String)) {
        for (value, key) in [
            (self.noise.gyro, "noise.gyro"),
            (self.noise.accelerometer, "noise.accelerometer"),
            (self.noise.position, "noise.position"),
            (self.noise.velocity, "noise.velocity"),
            (self.randomise.centre_of_mass, "randomise.centre_of_mass"),
            (self.randomise.start_position, "randomise.start_position"),
            (self.push.force, "push.force"),
        ] {
            not_negative(require, value, key);
        }
        let l = &self.latency;
        require((0.0..=1.0).contains(&l.lower), "latency.lower", "0 to 1 s".into());
        require(
            l.upper >= l.lower && l.upper <= 1.0,
            "latency.upper",
            "latency.lower to 1 s".into(),
        );
        let range = |r: [f64; 2]| r[0] >= 0.0 && r[1] >= r[0] && r[1] <= 100.0;
        let right = || "two numbers from 0 to 100, the smaller first".to_string();
        require(range(self.friction.tangential), "friction.tangential", right());
        require(range(self.friction.torsional), "friction.torsional", right());
        require(range(self.friction.rolling), "friction.rolling", right());
        let factor = |x: f64| (0.0..1.0).contains(&x);
        require(
            factor(self.randomise.pd_noise),
            "randomise.pd_noise",
            "0 up to, not including, 1".into(),
        );
        require(
            factor(self.randomise.mass),
            "randomise.mass",
            "0 up to, not including, 1".into(),
        );
        positive(require, self.push.interval, "push.interval");
        positive(require, self.push.duration, "push.duration");
    }
}

fn positive(require: &mut impl FnMut(bool, &'static str, String), value: f64, key: &'static str) {
    require((1e-6..=1e6).contains(&value), key, "1e-6 to 1e6".into());
}

fn not_negative(require: &mut impl FnMut(bool, &'static str, String), value: f64, key: &'static str) {
    require((0.0..=1e6).contains(&value), key, "0 to 1e6".into());
}

fn share(require: &mut impl FnMut(bool, &'static str, String), value: f64, key: &'static str) {
    require((0.0..=1.0).contains(&value), key, "a share from 0 to 1".into());
}
