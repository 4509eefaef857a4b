//! Generalized advantage estimation (Schulman et al. 2016, eq. 16).

use crate::rollout::{End, Rollout};

/// Writes advantages and returns (advantage plus value), both `steps x environments`.
///
/// `delta = r + gamma V' - V` and `A = delta + gamma lambda A'`, where the sum stops at the end of an episode. V' is the
/// next step's value, 0 after a termination, and the bootstrap value after a time-out, which is not a fall. A lost step has no
/// temporal difference, so that the steps before it end with its value.
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
                End::Lost => {
                    (advantages[at], returns[at]) = (0.0, rollout.values[at]);
                    (next_value, advantage) = (value, 0.0);
                    continue;
                }
            }
            let delta = f64::from(rollout.rewards[at]) + gamma * next_value - value;
            advantage = delta + gamma * lambda * advantage;
            advantages[at] = advantage as f32;
            returns[at] = (advantage + value) as f32;
            next_value = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition: the discounted sum of the temporal differences up to the end of the episode.
    fn naive(rollout: &Rollout, gamma: f64, lambda: f64, step: usize, environment: usize) -> f64 {
        let mut sum = 0.0;
        for k in step..rollout.steps {
            let at = k * rollout.environments + environment;
            let next = match rollout.ends[at] {
                End::Lost => break,
                End::Terminated => 0.0,
                End::TimeOut => rollout.bootstrap_values[at],
                End::None if k + 1 < rollout.steps => rollout.values[at + rollout.environments],
                End::None => rollout.last_values[environment],
            };
            let delta = f64::from(rollout.rewards[at]) + gamma * f64::from(next) - f64::from(rollout.values[at]);
            sum += (gamma * lambda).powi((k - step) as i32) * delta;
            if rollout.ends[at] != End::None {
                break;
            }
        }
        sum
    }

    proptest! {
        #[test]
        fn advantages_agree_with_the_sum_that_defines_them(
            steps in 1_usize..30,
            environments in 1_usize..4,
            gamma in 0.0..=1.0,
            lambda in 0.0..=1.0,
            numbers in prop::collection::vec((-5_f32..5.0, -5_f32..5.0, -5_f32..5.0, 0_u8..8), 120),
        ) {
            let mut rollout = Rollout::new(steps, environments, 1, 1);
            for (at, &(reward, value, bootstrap, end)) in numbers[..rollout.samples()].iter().enumerate() {
                (rollout.rewards[at], rollout.values[at], rollout.bootstrap_values[at]) = (reward, value, bootstrap);
                rollout.ends[at] = [End::Terminated, End::TimeOut, End::Lost].get(usize::from(end)).copied().unwrap_or(End::None);
            }
            rollout.last_values.iter_mut().zip(&numbers).for_each(|(to, from)| *to = from.1);
            let (mut advantages, mut returns) = (vec![0.0; rollout.samples()], vec![0.0; rollout.samples()]);
            estimate(&rollout, gamma, lambda, &mut advantages, &mut returns);
            for step in 0..steps {
                for environment in 0..environments {
                    let at = step * environments + environment;
                    let expected = naive(&rollout, gamma, lambda, step, environment);
                    prop_assert!((f64::from(advantages[at]) - expected).abs() < 1e-5 * expected.abs().max(1.0));
                    let value = f64::from(rollout.values[at]);
                    prop_assert!((f64::from(returns[at]) - expected - value).abs() < 1e-5 * expected.abs().max(1.0));
                }
            }
        }
    }
}
