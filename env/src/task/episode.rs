//! What an environment tells of a step and of a finished episode.

use serde::{Deserialize, Serialize};

use super::gait::Gait;
use super::reward::Terms;
use super::tracking::Tracking;

/// How an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum End {
    /// The base came too low or tilted too far.
    Fallen,
    /// The legs passed through each other.
    Overlap,
    /// The time was over; the robot had not fallen.
    TimeOut,
    /// A number went non-finite, see [`Fault`]; nothing of the last step reaches the learner.
    Lost,
}

/// Where a number that is not finite came up first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// In the state of the engine.
    Physics,
    /// In this entry of the observation, see [`Spec::entry_name`](omniwalk_controller::Spec::entry_name).
    Observation(usize),
    /// In this term of the reward.
    Reward(&'static str),
}

/// What one control step gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Reward by term.
    pub terms: Terms,
    /// The end of the episode, if it ended.
    pub end: Option<End>,
}

/// A finished episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Index of the environment in its batch.
    pub environment: usize,
    /// How it ended.
    pub end: End,
    /// Length in control steps.
    pub steps: u32,
    /// Reward by term, summed over the episode.
    pub terms: Terms,
    /// The desired velocity at the end (m/s, m/s, rad/s).
    pub desired: [f64; 3],
    /// How the robot walked.
    pub gait: Gait,
    /// Touchdowns per second of the first two feet; not a number where there is none.
    pub touchdowns_per_second: [f64; 2],
    /// How well it held the command.
    pub tracking: Option<Tracking>,
    /// Mean magnitude of the policy joints' torques, N m.
    pub torque: f64,
    /// Mean square change of the targets per step, in half ranges of the action.
    pub action_change: f64,
    /// Mean error of the estimated base velocity, m/s.
    pub estimator_error: f64,
    /// Horizontal distance from the start, m.
    pub drift: f64,
}

/// Sums over the running episode.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Sums {
    pub terms: Terms,
    pub torque: f64,
    pub action_change: f64,
    pub estimator_error: f64,
    /// Where the base started and is, horizontally, m.
    pub start: [f64; 2],
    pub position: [f64; 2],
}

impl Sums {
    /// Horizontal distance from the start, m.
    pub fn drift(&self) -> f64 {
        (self.position[0] - self.start[0]).hypot(self.position[1] - self.start[1])
    }
}
