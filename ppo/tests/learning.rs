//! It learns: points on a plane are brought to the origin.

mod support;

use omniwalk_ppo::{Agent, Config, Head, Mirror, Schedule};
use support::{Points, config};

/// Mean reward of the first rollout, and of the last three of `updates`.
fn learn(config: Config, mirror: Option<&Mirror>, updates: u64) -> (f32, f32) {
    let mut agent = Agent::new(config, 4, 2, 1).unwrap();
    let mut points = Points::new(32, 40);
    let rewards: Vec<f32> = (0..updates)
        .map(|key| {
            let (reward, stats) = points.iterate(&mut agent, mirror, key);
            if std::env::var_os("SHOW").is_some() {
                println!("{reward:.3} {stats:.4?}");
            }
            assert_eq!(stats.skipped, 0);
            reward
        })
        .collect();
    (rewards[0], rewards[rewards.len() - 3..].iter().sum::<f32>() / 3.0)
}

#[test]
fn a_beta_policy_brings_the_points_to_the_origin() {
    let (first, last) = learn(config(), None, 60);
    assert!(last > first / 3.0, "mean distance from {} to {}", -first, -last);
}

#[test]
fn a_gaussian_policy_brings_the_points_to_the_origin() {
    let (first, last) = learn(
        Config {
            policy: Head::Gaussian,
            ..config()
        },
        None,
        60,
    );
    assert!(last > first / 3.0, "mean distance from {} to {}", -first, -last);
}

#[test]
fn mirror_images_speed_learning_up_under_an_adaptive_rate() {
    let (first, without) = learn(config(), None, 20);
    let (same, with) = learn(config(), Some(&Points::mirror()), 20);
    assert_eq!(first, same, "both begin alike");
    assert!(
        with > without,
        "mean distance from {} to {} with, {} without",
        -first,
        -with,
        -without
    );
}

#[test]
fn an_adaptive_rate_brings_the_divergence_to_its_target_from_below_and_from_above() {
    let kl_target = 1e-3;
    for learning_rate in [1e-5, 1e-2] {
        let config = Config {
            learning_rate,
            schedule: Schedule::Adaptive {
                kl_target,
                settle: 0,
                minimum: 1e-5,
                maximum: 1e-2,
            },
            // The divergence of the last epoch is then that of the update.
            epochs: 1,
            ..config()
        };
        let mut agent = Agent::new(config, 4, 2, 1).unwrap();
        let mut points = Points::new(32, 40);
        let kls: Vec<f64> = (0..40).map(|key| points.iterate(&mut agent, None, key).1.kl).collect();
        let off = |kls: &[f64]| (kls.iter().sum::<f64>() / kls.len() as f64 / kl_target).ln().abs();
        assert!(off(&kls[..1]) > 1.0, "begins far off: {kls:?}");
        assert!(off(&kls[30..]) < 0.5, "comes near: {kls:?}");
    }
}
