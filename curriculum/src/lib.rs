//! What becomes harder as training goes on: the region of desired velocities (thesis 7.3.5) and the weights of
//! reward terms (thesis 7.3.3). Everything counts updates of the network, never a total that is known in advance.

use serde::{Deserialize, Serialize};

/// A value that makes no sense: the dotted key and what would be right.
pub type Invalid = (&'static str, String);

/// Section `[curriculum]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The velocity every episode asks for at the beginning, v_core (m/s, m/s, rad/s).
    pub core: [f64; 3],
    /// Widen the region of desired velocities from the core; otherwise the whole region from the start.
    pub scheduler: bool,
    /// Updates until the whole region is reached, zeta.
    pub zeta: f64,
    /// Widen only while the robot tracks well and rarely falls, and narrow when it falls often.
    pub gated: bool,
    /// Gate: the mean velocity kernel must be above this.
    pub gate_velocity: f64,
    /// Gate: falls in the time of a full episode, at most 1, must be below this; narrows above twice this.
    pub gate_falls: f64,
    /// Start of C_v.
    pub velocity_start: f64,
    /// C_v becomes C_v^k_d at each update.
    pub velocity_decay: f64,
    /// C_v rises only while the mean foot kernel is above this; 0: always (thesis).
    pub velocity_gate_foot: f64,
    /// Start of C_foot.
    pub foot_start: f64,
    /// C_foot becomes C_foot^k_d at each update.
    pub foot_decay: f64,
    /// Share of the largest push while the region is the core; it grows to the whole with the region.
    #[serde(default = "whole")]
    pub push_start: f64,
}

/// What configurations written before a share's key meant.
fn whole() -> f64 {
    1.0
}

impl Config {
    /// Every value that makes no sense.
    pub fn invalid(&self) -> Vec<Invalid> {
        let mut found = Vec::new();
        let mut require = |holds: bool, key: &'static str, right: &str| {
            if !holds {
                found.push((key, right.to_string()));
            }
        };
        let share = |x: f64| (0.0..=1.0).contains(&x);
        let factor = |x: f64| x > 0.0 && x <= 1.0;
        require(
            self.core.iter().all(|x| x.is_finite()),
            "curriculum.core",
            "three finite numbers",
        );
        require(
            self.zeta >= 1.0 && self.zeta.is_finite(),
            "curriculum.zeta",
            "at least 1 update",
        );
        require(share(self.gate_velocity), "curriculum.gate_velocity", "0 to 1");
        require(share(self.gate_falls), "curriculum.gate_falls", "0 to 1");
        require(
            factor(self.velocity_start),
            "curriculum.velocity_start",
            "above 0 and at most 1",
        );
        require(
            factor(self.velocity_decay),
            "curriculum.velocity_decay",
            "above 0 and at most 1",
        );
        require(
            share(self.velocity_gate_foot),
            "curriculum.velocity_gate_foot",
            "0 to 1",
        );
        require(
            factor(self.foot_start),
            "curriculum.foot_start",
            "above 0 and at most 1",
        );
        require(
            factor(self.foot_decay),
            "curriculum.foot_decay",
            "above 0 and at most 1",
        );
        require(share(self.push_start), "curriculum.push_start", "0 to 1");
        found
    }
}

/// How training went in one update, what the gates look at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Performance {
    /// Mean of the velocity kernel over the update's steps, 0 to 1.
    pub velocity: f64,
    /// Mean of the foot kernel over the update's steps, 0 to 1.
    pub foot: f64,
    /// Falls in the time of a full episode, 0 to 1: their rate times its length, so that an update with few finished episodes
    /// counts too. `None` where it was not measured: the smoothed value then stays.
    pub falls: Option<f64>,
}

/// The state of the curriculum; serialisable, part of every checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Curriculum {
    /// Position of the velocity scheduler from 0 (core) to 1 (whole region).
    level: f64,
    /// C_v.
    velocity: f64,
    /// C_foot.
    foot: f64,
    /// Smoothed performance, for the gates.
    smooth_velocity: f64,
    smooth_foot: f64,
    smooth_falls: f64,
}

/// Share of a new update in the smoothed performance.
const SMOOTHING: f64 = 0.1;

impl Curriculum {
    /// The curriculum at the beginning.
    pub fn new(config: &Config) -> Self {
        Self {
            level: if config.scheduler { 0.0 } else { 1.0 },
            velocity: config.velocity_start,
            foot: config.foot_start,
            smooth_velocity: 0.0,
            smooth_foot: 0.0,
            smooth_falls: 1.0,
        }
    }

    /// Position of the velocity scheduler, 0 to 1.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// C_v, the factor on the velocity term.
    pub fn velocity_factor(&self) -> f64 {
        self.velocity
    }

    /// C_foot, the factor on the foot term.
    pub fn foot_factor(&self) -> f64 {
        self.foot
    }

    /// Share of the largest push that pushes are drawn up to.
    pub fn push_factor(&self, config: &Config) -> f64 {
        config.push_start + self.level * (1.0 - config.push_start)
    }

    /// One update further.
    pub fn advance(&mut self, config: &Config, performance: &Performance) {
        let follow = |value: &mut f64, new: f64| *value += SMOOTHING * (new - *value);
        follow(&mut self.smooth_velocity, performance.velocity);
        follow(&mut self.smooth_foot, performance.foot);
        if let Some(falls) = performance.falls {
            follow(&mut self.smooth_falls, falls);
        }
        self.foot = self.foot.powf(config.foot_decay);
        if self.smooth_foot >= config.velocity_gate_foot {
            self.velocity = self.velocity.powf(config.velocity_decay);
        }
        if config.scheduler {
            let step = self.direction(config) / config.zeta;
            self.level = (self.level + step).clamp(0.0, 1.0);
        }
    }

    /// Bounds from which desired velocities are drawn, between the core and the whole region (figure 7.5).
    pub fn bounds(&self, config: &Config, lower: [f64; 3], upper: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let at = |end: [f64; 3]| [0, 1, 2].map(|k| config.core[k] + self.level * (end[k] - config.core[k]));
        if config.scheduler {
            (at(lower), at(upper))
        } else {
            (lower, upper)
        }
    }

    fn direction(&self, config: &Config) -> f64 {
        if !config.gated {
            1.0
        } else if self.smooth_falls > 2.0 * config.gate_falls {
            -0.5
        } else if self.smooth_falls < config.gate_falls && self.smooth_velocity > config.gate_velocity {
            1.0
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn thesis() -> Config {
        Config {
            core: [0.4, 0.0, 0.0],
            scheduler: true,
            zeta: 100.0,
            gated: false,
            gate_velocity: 0.5,
            gate_falls: 0.2,
            velocity_start: 0.01,
            velocity_decay: 0.95,
            velocity_gate_foot: 0.0,
            foot_start: 0.05,
            foot_decay: 0.995,
            push_start: 0.5,
        }
    }

    #[test]
    fn factors_follow_the_thesis_power_law() {
        let config = thesis();
        let mut curriculum = Curriculum::new(&config);
        for _ in 0..37 {
            curriculum.advance(&config, &Performance::default());
        }
        // C after n updates is C_0^(k_d^n).
        assert!((curriculum.velocity_factor() - 0.01_f64.powf(0.95_f64.powi(37))).abs() < 1e-12);
        assert!((curriculum.foot_factor() - 0.05_f64.powf(0.995_f64.powi(37))).abs() < 1e-12);
    }

    #[test]
    fn the_region_grows_from_the_core_to_the_whole_in_zeta_updates_and_pushes_with_it() {
        let config = thesis();
        let mut curriculum = Curriculum::new(&config);
        let region = |c: &Curriculum| c.bounds(&config, [-0.6; 3], [0.6; 3]);
        assert_eq!(region(&curriculum), ([0.4, 0.0, 0.0], [0.4, 0.0, 0.0]));
        assert_eq!(curriculum.push_factor(&config), 0.5);
        for _ in 0..50 {
            curriculum.advance(&config, &Performance::default());
        }
        let (lower, upper) = region(&curriculum);
        assert!((lower[0] + 0.1).abs() < 1e-9 && (upper[0] - 0.5).abs() < 1e-9 && (upper[2] - 0.3).abs() < 1e-9);
        assert!((curriculum.push_factor(&config) - 0.75).abs() < 1e-9);
        for _ in 0..60 {
            curriculum.advance(&config, &Performance::default());
        }
        assert_eq!(region(&curriculum), ([-0.6; 3], [0.6; 3]));
        assert_eq!(curriculum.push_factor(&config), 1.0);
    }

    #[test]
    fn a_gated_region_waits_for_good_tracking_and_retreats_from_falls() {
        let config = Config {
            gated: true,
            ..thesis()
        };
        let mut curriculum = Curriculum::new(&config);
        let run = |c: &mut Curriculum, velocity, falls| {
            (0..60).for_each(|_| {
                c.advance(
                    &config,
                    &Performance {
                        velocity,
                        foot: 1.0,
                        falls: Some(falls),
                    },
                )
            });
            c.level()
        };
        assert_eq!(run(&mut curriculum, 0.3, 0.0), 0.0);
        let wide = run(&mut curriculum, 0.9, 0.0);
        assert!(wide > 0.4);
        assert!(run(&mut curriculum, 0.9, 1.0) < wide);
    }

    proptest! {
        #[test]
        fn level_and_factors_stay_between_zero_and_one(
            velocity in 0.0..1.0_f64, foot in 0.0..1.0_f64, falls in 0.0..1.0_f64, gated: bool, n in 1..300_usize,
        ) {
            let config = Config { gated, ..thesis() };
            let mut curriculum = Curriculum::new(&config);
            for _ in 0..n {
                let before = curriculum.clone();
                curriculum.advance(&config, &Performance { velocity, foot, falls: Some(falls) });
                prop_assert!((0.0..=1.0).contains(&curriculum.level()));
                prop_assert!(curriculum.velocity_factor() >= before.velocity_factor());
                prop_assert!(curriculum.foot_factor() <= 1.0);
            }
        }
    }
}
