//! Which values of the configuration make no sense, and what would be right.

use omniwalk_controller::Block;

use super::EnvConfig;

/// A value that makes no sense: the dotted key and what would be right.
pub type Invalid = (&'static str, String);

impl EnvConfig {
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
                "a multiple of engine.control_hz = {} between 100 and 10000, such as {}",
                e.control_hz,
                nearest(e.physics_hz, e.control_hz.max(1))
            ),
        );
        let g = &self.ground;
        require(
            g.slope.iter().all(|angle| angle.abs() <= 0.7),
            "ground.slope",
            "two angles from -0.7 to 0.7 rad".into(),
        );
        require(
            (0.0..=1.0).contains(&g.amplitude),
            "ground.amplitude",
            "0 to 1 m".into(),
        );
        require((0.01..=10.0).contains(&g.cell), "ground.cell", "0.01 to 10 m".into());
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
        require(
            (0.0..=0.1).contains(&t.overlap_margin),
            "task.overlap_margin",
            "0 to 0.1 m".into(),
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
            (r.tap_weight, "reward.tap_weight"),
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
            (self.push.force, "push.force"),
        ] {
            not_negative(require, value, key);
        }
        // Beyond a radian the robot starts as a heap.
        require(
            (0.0..=1.0).contains(&self.randomise.start_position),
            "randomise.start_position",
            "0 to 1 rad or m".into(),
        );
        let l = &self.latency;
        require((0.0..=1.0).contains(&l.lower), "latency.lower", "0 to 1 s".into());
        require(
            l.upper >= l.lower && l.upper <= 1.0,
            "latency.upper",
            "latency.lower to 1 s".into(),
        );
        require((0.0..=1.0).contains(&l.jitter), "latency.jitter", "0 to 1 s".into());
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

/// The rate nearest to `physics_hz` that is a multiple of `control_hz` and between 100 and 10,000 Hz.
fn nearest(physics_hz: u32, control_hz: u32) -> u32 {
    let wanted = f64::from(physics_hz.clamp(100, 10_000)) / f64::from(control_hz);
    let least = 100_u32.div_ceil(control_hz);
    (wanted.round() as u32).clamp(least, 10_000 / control_hz) * control_hz
}
