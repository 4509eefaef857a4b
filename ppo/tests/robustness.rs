//! What is not finite does not get into the weights, and impossible configurations are named.

mod support;

use omniwalk_ppo::{Agent, Config, End, Head, Inference, Rollout, Schedule};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::{Points, config};

#[test]
fn a_rollout_with_a_number_that_is_not_finite_changes_nothing() {
    let mut agent = Agent::new(config(), 4, 2, 5).unwrap();
    let mut points = Points::new(16, 40);
    points.iterate(&mut agent, None, 0);
    points.collect(&agent);
    let before = agent.save();
    for break_it in [
        |p: &mut Points| p.rollout.observations[17] = f32::NAN,
        |p: &mut Points| p.rollout.rewards[3] = f32::INFINITY,
        |p: &mut Points| p.rollout.actions[8] = f32::NAN,
        |p: &mut Points| p.rollout.last_values[1] = f32::NAN,
        |p: &mut Points| (p.rollout.ends[5], p.rollout.bootstrap_values[5]) = (End::TimeOut, f32::NAN),
    ] {
        let good = points.rollout.clone();
        break_it(&mut points);
        let stats = agent.update(&points.rollout, None, 1);
        assert_eq!((stats.steps, stats.skipped), (0, 15));
        assert!(agent.save() == before);
        points.rollout = good;
    }
    assert_eq!(agent.update(&points.rollout, None, 1).skipped, 0);
}

#[test]
fn a_lost_sample_teaches_nothing() {
    let mut points = Points::new(16, 20);
    let mut agent = Agent::new(config(), 4, 2, 5).unwrap();
    points.collect(&agent);
    points.rollout.ends[7] = End::Lost;
    let mut learn = |reward: f32, action: f32| {
        let mut agent = Agent::new(config(), 4, 2, 5).unwrap();
        points.rollout.rewards[7] = reward;
        points.rollout.actions[14..16].fill(action);
        let stats = agent.update(&points.rollout, None, 1);
        assert_eq!(stats.skipped, 0);
        agent.save()
    };
    assert!(learn(0.0, 0.5) == learn(1e6, 0.9));
    points.rollout.ends.fill(End::Lost);
    let stats = agent.update(&points.rollout, None, 1);
    assert_eq!(stats.steps, 0);
}

#[test]
fn minibatches_with_an_overflowing_loss_are_skipped_and_counted() {
    let mut agent = Agent::new(Config { epochs: 1, ..config() }, 4, 2, 5).unwrap();
    let mut points = Points::new(16, 40);
    points.collect(&agent);
    points.rollout.rewards[9] = 3e38;
    points.rollout.rewards[25] = 3e38;
    let stats = agent.update(&points.rollout, None, 1);
    assert!(stats.skipped > 0, "{stats:?}");
    let finite = |x: &f32| x.is_finite();
    assert!(
        agent
            .policy()
            .layers
            .iter()
            .all(|layer| layer.weights.iter().chain(&layer.bias).all(finite))
    );
    let mut value = [0.0];
    agent.values(&mut Inference::default(), &[0.1; 4], &mut value);
    assert!(value[0].is_finite());
}

#[test]
fn bad_numbers_at_random_places_are_left_out_and_the_next_rollout_is_learned_from() {
    let mut chance = ChaCha8Rng::seed_from_u64(9);
    let mut agent = Agent::new(config(), 4, 2, 5).unwrap();
    let mut points = Points::new(16, 40);
    for round in 0..100 {
        points.iterate(&mut agent, None, 2 * round);
        points.collect(&agent);
        let before = agent.save();
        let (good, bad) = (
            points.rollout.clone(),
            [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e38][chance.random_range(0..4)],
        );
        let Rollout {
            observations,
            actions,
            values,
            rewards,
            ..
        } = &mut points.rollout;
        let numbers = [observations, actions, values, rewards];
        let into = chance.random_range(0..4);
        let place = chance.random_range(0..numbers[into].len());
        numbers[into][place] = bad;
        let stats = agent.update(&points.rollout, None, 2 * round + 1);
        if !bad.is_finite() {
            assert!(
                stats.steps == 0 && stats.skipped > 0 && agent.save() == before,
                "{bad} in {into} at {place}: {stats:?}"
            );
        }
        assert!(agent.is_finite(), "{bad} in {into} at {place}: {stats:?}");
        points.rollout = good;
        let stats = agent.update(&points.rollout, None, 2 * round + 1);
        assert!(
            stats.skipped == 0 && agent.is_finite(),
            "after {bad} in {into} at {place}: {stats:?}"
        );
    }
}

#[test]
fn an_observation_that_is_not_a_number_gives_an_action_that_is_none_either() {
    for policy in [Head::Beta, Head::Gaussian] {
        let agent = Agent::new(Config { policy, ..config() }, 4, 2, 5).unwrap();
        let mut buffers = Inference::default();
        let mut actions = [0.0; 4];
        let observations = [0.0, 0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0];
        agent.act(&mut buffers, &observations, &[1, 2], &mut actions, &mut [0.0; 2]);
        assert!(actions[..2].iter().all(|x| x.is_finite()) && actions[2..].iter().all(|x| x.is_nan()));
        agent.mode(&mut buffers, &observations, &mut actions);
        assert!(actions[..2].iter().all(|x| x.is_finite()) && actions[2..].iter().all(|x| x.is_nan()));
    }
}

#[test]
fn impossible_values_are_refused_by_key() {
    assert_eq!(config().validate(), Ok(()));
    type Case = (&'static str, fn(&mut Config));
    let cases: [Case; 16] = [
        ("hidden", |c| c.hidden.clear()),
        ("hidden", |c| c.hidden[0] = 0),
        ("hidden", |c| c.hidden[1] = 1 << 20),
        ("learning_rate", |c| c.learning_rate = f64::NAN),
        ("learning_rate", |c| c.learning_rate = 0.0),
        ("schedule.kl_target", |c| {
            c.schedule = Schedule::Adaptive {
                kl_target: 0.0,
                settle: 0,
                minimum: 1e-5,
                maximum: 1e-2,
            }
        }),
        ("schedule.minimum", |c| {
            c.schedule = Schedule::Adaptive {
                kl_target: 0.1,
                settle: 0,
                minimum: 1.0,
                maximum: 1.0,
            }
        }),
        ("schedule.maximum", |c| {
            c.schedule = Schedule::Adaptive {
                kl_target: 0.1,
                settle: 0,
                minimum: 1e-5,
                maximum: 1e-5,
            }
        }),
        ("gamma", |c| c.gamma = 1.1),
        ("lambda", |c| c.lambda = -0.1),
        ("clip", |c| c.clip = 0.0),
        ("epochs", |c| c.epochs = 0),
        ("minibatch", |c| c.minibatch = 0),
        ("entropy_weight", |c| c.entropy_weight = f64::INFINITY),
        ("value_weight", |c| c.value_weight = -1.0),
        ("max_gradient_norm", |c| c.max_gradient_norm = 0.0),
    ];
    for (key, change) in cases {
        let mut changed = config();
        change(&mut changed);
        assert_eq!(changed.validate().unwrap_err().key, key);
    }
    assert!(Agent::new(config(), 0, 2, 1).is_err());
}
