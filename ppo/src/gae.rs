//! Generalized advantage estimation (Schulman et al. 2016, eq. 16).

use crate::rollout::{End, Rollout};

/// Writes advantages and returns (advantage plus value), both `steps x environments`.
///
/// `delta = r + gamma V' - V` and `A = delta + gamma lambda A'`, where the sum stops at the end of an episode. V' is the
/// next step's value, 0 after a termination, and the bootstrap value after a time-out, which is not a fall.
pub(crate) fn estimate(rollout: &Rollout, gamma: f64, lambda: f64, advantages: &mut [f32], returns: &mut [f32]) {
    let environments = rollout.environments;
    for environment in 0..environments {
        let mut advantage = 0.0;
        let mut next_value = f64::from(rollout.last_values[environment]);
        for step in (0..rollout.steps).rev() {
            let at = step * environments + environment;
            let value = f64::from(rollout.values[at]);
            match rollout.ends[at] {
                End::None => {}
                End::Terminated => (next_value, advantage) = (0.0, 0.0),
                End::TimeOut => (next_value, advantage) = (f64::from(rollout.bootstrap_values[at]), 0.0),
            }
            let delta = f64::from(rollout.rewards[at]) + gamma * next_value - value;
            advantage = delta + gamma * lambda * advantage;
            advantages[at] = advantage as f32;
            returns[at] = (advantage + value) as f32;
            next_value = value;
        }
    }
}
