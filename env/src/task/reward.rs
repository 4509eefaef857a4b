//! The reward of the thesis (section 7.3.3): velocity tracking, pose regularisation, being alive, foot clearance,
//! each a weight times a kernel in [0, 1] times the duration of the step; beyond the thesis three penalties.

use serde::{Deserialize, Serialize};

use super::gait::Sole;
use crate::config::RewardConfig;

/// Names of the terms in the order of [`Terms::array`].
pub const TERM_NAMES: [&str; 7] = ["velocity", "pose", "alive", "foot", "action_rate", "slip", "tap"];

/// One step's reward by term, each with its weight and curriculum factor, and all but `tap` with the duration of the step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Terms {
    /// Velocity tracking (equation 7.9).
    pub velocity: f64,
    /// Pose regularisation (equation 7.10).
    pub pose: f64,
    /// Being alive (equation 7.11).
    pub alive: f64,
    /// Foot clearance (equation 7.12).
    pub foot: f64,
    /// Penalty on the change of the action.
    pub action_rate: f64,
    /// Penalty on slipping feet.
    pub slip: f64,
    /// Penalty on feet that touch down twice in a row.
    pub tap: f64,
}

impl Terms {
    /// The terms in the order of [`TERM_NAMES`].
    pub fn array(&self) -> [f64; 7] {
        [
            self.velocity,
            self.pose,
            self.alive,
            self.foot,
            self.action_rate,
            self.slip,
            self.tap,
        ]
    }

    /// Name of the first term that is not finite.
    pub fn not_finite(&self) -> Option<&'static str> {
        let at = self.array().iter().position(|term| !term.is_finite())?;
        Some(TERM_NAMES[at])
    }

    /// Adds a step's terms to a sum.
    pub fn add(&mut self, step: &Self) {
        self.velocity += step.velocity;
        self.pose += step.pose;
        self.alive += step.alive;
        self.foot += step.foot;
        self.action_rate += step.action_rate;
        self.slip += step.slip;
        self.tap += step.tap;
    }

    /// Every term times `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            velocity: factor * self.velocity,
            pose: factor * self.pose,
            alive: factor * self.alive,
            foot: factor * self.foot,
            action_rate: factor * self.action_rate,
            slip: factor * self.slip,
            tap: factor * self.tap,
        }
    }

    /// The reward (equation 7.8).
    pub fn total(&self) -> f64 {
        self.array().iter().sum()
    }
}

/// The curriculum's factors on the reward and on pushes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Factors {
    /// C_v, on the velocity term, and on that of taps: who does not walk yet may shuffle.
    pub velocity: f64,
    /// C_foot, on the foot term.
    pub foot: f64,
    /// On the largest force of random pushes.
    pub push: f64,
}

/// The true motion of the base that the velocity term judges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Linear velocity in the base frame, x and y, m/s.
    pub base: [f64; 2],
    /// Linear velocity in the inertial frame, x and y, m/s.
    pub inertial: [f64; 2],
    /// Turn rate about the base's z axis, rad/s.
    pub turn: f64,
}

impl Motion {
    /// First-order low-pass towards `new` with the gain `gain`.
    pub fn follow(&mut self, new: &Self, gain: f64) {
        for k in 0..2 {
            self.base[k] += gain * (new.base[k] - self.base[k]);
            self.inertial[k] += gain * (new.inertial[k] - self.inertial[k]);
        }
        self.turn += gain * (new.turn - self.turn);
    }

    /// Norm of the velocity error against the commanded velocity (equation 7.9).
    pub fn error(&self, commanded: [f64; 3]) -> f64 {
        let [x, y, turn] = commanded;
        let squares = [
            x - self.base[0],
            y - self.base[1],
            x - self.inertial[0],
            y - self.inertial[1],
            turn - self.turn,
        ];
        squares.map(|error| error * error).iter().sum::<f64>().sqrt()
    }
}

/// The logistic kernel of section 7.3.3, `K(x | l) = 2 / (e^(l x) + e^(-l x))`.
pub fn kernel(x: f64, l: f64) -> f64 {
    let decay = (-(l * x).abs()).exp();
    2.0 * decay / (1.0 + decay * decay)
}

/// Norm of the foot error (equation 7.12) with `swing` the swing leg's sole and `clearance` its desired height, m.
pub fn foot_error(swing: &Sole, stance: &Sole, clearance: f64, height_weight: f64) -> f64 {
    let height = height_weight * (clearance - swing.centre[2]);
    let contact = height_weight * stance.centre[2];
    (height * height + swing.roll * swing.roll + stance.roll * stance.roll + contact * contact).sqrt()
}

/// What one step is judged by.
pub struct Judged<'a> {
    /// True motion of the base, low-passed if the configuration says so.
    pub motion: &'a Motion,
    /// Commanded velocity.
    pub commanded: [f64; 3],
    /// Norm of the pose error, rad or m (equation 7.10).
    pub pose_error: f64,
    /// The robot has not fallen.
    pub alive: bool,
    /// Norm of the foot error; `None` for a robot without two feet.
    pub foot_error: Option<f64>,
    /// Mean square of the change of the targets between steps, in half ranges of the action.
    pub action_change: f64,
    /// Sum of the squared horizontal speeds of soles that touch the ground, (m/s)^2.
    pub slip: f64,
    /// Touchdowns of feet that had been the last to touch down, too.
    pub taps: u32,
}

impl Judged<'_> {
    /// The terms of a step of `dt` s.
    pub fn terms(&self, config: &RewardConfig, factors: Factors, dt: f64) -> Terms {
        let velocity = kernel(self.motion.error(self.commanded), config.velocity_kernel);
        let foot = self.foot_error.map_or(0.0, |error| kernel(error, config.foot_kernel));
        Terms {
            velocity: config.velocity_weight * factors.velocity * velocity * dt,
            pose: config.pose_weight * kernel(self.pose_error, config.pose_kernel) * dt,
            alive: if self.alive { config.alive_weight * dt } else { 0.0 },
            foot: config.foot_weight * factors.foot * foot * dt,
            action_rate: -config.action_rate_weight * self.action_change * dt,
            slip: -config.slip_weight * self.slip * dt,
            tap: -config.tap_weight * factors.velocity * f64::from(self.taps),
        }
    }
}

/// The swing leg: the foot nearer to the trunk, with a hysteresis against flight phases (section 7.3.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Swing {
    leg: usize,
}

impl Swing {
    /// The swing leg, 0 or 1.
    pub fn leg(&self) -> usize {
        self.leg
    }

    /// Changes the swing leg when the other foot is closer to the trunk by `hysteresis` m; heights are the soles'.
    pub fn by_height(&mut self, heights: [f64; 2], hysteresis: f64) {
        if heights[1 - self.leg] > heights[self.leg] + hysteresis {
            self.leg = 1 - self.leg;
        }
    }

    /// The leg the clock says: the left in the first half of the cycle. Returns the desired share of the clearance, a squared
    /// sine: a foot that follows it leaves the ground and comes down without vertical speed, so that it does not bounce.
    pub fn by_clock(&mut self, phase: f64) -> f64 {
        self.leg = usize::from(phase >= 0.5);
        (std::f64::consts::TAU * phase).sin().powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_is_the_thesis_formula() {
        for x in [0.0, 0.1, -0.4, 2.0] {
            let l = 3.0_f64;
            let direct = 2.0 / ((l * x).exp() + (-l * x).exp());
            assert!((kernel(x, l) - direct).abs() < 1e-15);
        }
    }

    #[test]
    fn the_swing_leg_changes_only_beyond_the_hysteresis() {
        let mut swing = Swing::default();
        swing.by_height([0.0, 0.004], 0.005);
        assert_eq!(swing.leg(), 0);
        swing.by_height([0.0, 0.006], 0.005);
        assert_eq!(swing.leg(), 1);
        swing.by_height([0.004, 0.0], 0.005);
        assert_eq!(swing.leg(), 1);
    }

    #[test]
    fn the_velocity_error_has_five_components() {
        let motion = Motion {
            base: [0.1, 0.2],
            inertial: [0.3, 0.4],
            turn: 0.5,
        };
        let error = motion.error([0.0; 3]);
        assert!((error - (0.01 + 0.04 + 0.09 + 0.16 + 0.25_f64).sqrt()).abs() < 1e-15);
    }
}
