//! The same bits: with any number of threads, and after a save and a load.

mod support;

use omniwalk_ppo::{Agent, Config, Head, Inference, StateError, Tensor, TensorData};
use support::{Points, config};

/// A state after some iterations on a pool of its own. Layers of 130 need two tiles; a minibatch of 700 two blocks.
fn train(threads: usize, head: Head) -> (Vec<Tensor>, Vec<f32>) {
    let config = Config {
        hidden: vec![130, 40],
        minibatch: 700,
        policy: head,
        ..config()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut agent = Agent::new(config, 4, 2, 5).unwrap();
        let mut points = Points::new(70, 20);
        let rewards = (0..3)
            .map(|key| points.iterate(&mut agent, Some(&Points::mirror()), key).0)
            .collect();
        (agent.save(), rewards)
    })
}

#[test]
fn one_two_and_three_threads_give_the_same_bits() {
    for head in [Head::Beta, Head::Gaussian] {
        let one = train(1, head);
        assert!(one == train(2, head));
        assert!(one == train(3, head));
    }
}

#[test]
fn a_loaded_agent_goes_on_with_the_same_bits() {
    let mut agent = Agent::new(config(), 4, 2, 5).unwrap();
    let mut points = Points::new(16, 40);
    (0..2).for_each(|key| _ = points.iterate(&mut agent, None, key));
    let saved = agent.save();
    let mut loaded = Agent::load(config(), 4, 2, &saved).unwrap();
    assert!(loaded.save() == saved);
    points.collect(&agent);
    assert_eq!(
        agent.update(&points.rollout, None, 7),
        loaded.update(&points.rollout, None, 7)
    );
    assert!(agent.save() == loaded.save());
    assert!(agent.policy() == loaded.policy());
    let observations: Vec<f32> = (0..40).map(|i| i as f32 * 0.1).collect();
    let keys: Vec<u64> = (0..10).collect();
    let [mut one, mut two] = [vec![0.0; 20], vec![0.0; 20]];
    agent.act(
        &mut Inference::default(),
        &observations,
        &keys,
        &mut one,
        &mut [0.0; 10],
    );
    loaded.act(
        &mut Inference::default(),
        &observations,
        &keys,
        &mut two,
        &mut [0.0; 10],
    );
    assert_eq!(one, two);
}

#[test]
fn an_action_depends_on_its_own_row_and_key_alone() {
    let agent = Agent::new(config(), 4, 2, 5).unwrap();
    let mut buffers = Inference::default();
    let observations: Vec<f32> = (0..4 * 75).map(|i| (i as f32 * 0.37).sin()).collect();
    let keys: Vec<u64> = (0..75).collect();
    let (mut actions, mut values) = (vec![0.0; 150], vec![0.0; 75]);
    agent.act(&mut buffers, &observations, &keys, &mut actions, &mut values);
    for row in [0, 11, 31, 32, 74] {
        let (mut action, mut value) = ([0.0; 2], [0.0]);
        let observation = &observations[row * 4..][..4];
        agent.act(&mut buffers, observation, &keys[row..=row], &mut action, &mut value);
        assert_eq!((&action[..], value[0]), (&actions[row * 2..][..2], values[row]));
    }
}

#[test]
fn states_that_do_not_fit_are_refused() {
    let agent = Agent::new(config(), 4, 2, 5).unwrap();
    let good = agent.save();
    let load = |change: fn(&mut Vec<Tensor>)| {
        let mut tensors = good.clone();
        change(&mut tensors);
        Agent::load(config(), 4, 2, &tensors).err()
    };
    assert_eq!(load(|_| ()), None);
    assert_eq!(
        load(|t| _ = t.pop()),
        Some(StateError::Missing("critic.2.bias.second_moment".into()))
    );
    fn weight(tensors: &mut [Tensor]) -> &mut Tensor {
        let found = tensors.iter_mut().find(|tensor| tensor.name == "actor.0.weight");
        found.expect("the first layer")
    }
    let is_shape = |error| matches!(error, Some(StateError::Shape { .. }));
    assert!(is_shape(load(|t| weight(t).shape = vec![4, 32])));
    assert!(is_shape(load(|t| t[0].data = TensorData::U64(vec![1]))));
    assert!(is_shape(load(|t| t[3].data = TensorData::F64(vec![]))));
    let is_value = |error| matches!(error, Some(StateError::Value(_)));
    assert!(is_value(
        load(|t| weight(t).data = TensorData::F32(vec![f32::NAN; 128]))
    ));
    assert!(is_value(load(|t| t[0].data = TensorData::F64(vec![-1.0]))));
    assert!(is_value(load(|t| t[4].data = TensorData::F64(vec![-1.0; 4]))));
    assert!(is_value(load(|t| t[5].data = TensorData::F32(vec![f32::NAN; 4]))));
    // States of before the range was kept can do without.
    assert_eq!(load(|t| drop(t.drain(5..7))), None);
    let last = |t: &mut Vec<Tensor>| t.last_mut().unwrap().data = TensorData::F32(vec![-1.0]);
    assert!(is_value(load(last)));
    assert!(matches!(
        Agent::load(Config { clip: 0.0, ..config() }, 4, 2, &good),
        Err(StateError::Config(_))
    ));
    assert!(matches!(
        Agent::load(config(), 5, 2, &good),
        Err(StateError::Shape { .. })
    ));
}
