//! A batch of environments as the trainer uses it, in both engines.

mod support;

use std::ops::Range;

use omniwalk_env::Batch;
use omniwalk_env::batch::{Collect, Outcomes};
use omniwalk_env::config::{EngineKind, GroundKind};
use omniwalk_env::random::Stream;
use omniwalk_env::task::command::CommandRange;
use omniwalk_env::task::episode::{End, Fault};
use omniwalk_env::task::reward::{Factors, Terms};
use support::{config, robot};

/// Random actions around the middle, so that the robot stays up for a while and then falls.
struct Player {
    stream: Stream,
    actions: Vec<f32>,
}

impl Player {
    fn new(seed: u64, batch: &Batch) -> Self {
        Self {
            stream: Stream::new(seed, 0, 0),
            actions: vec![0.5; batch.environments() * batch.shared().spec.action_len()],
        }
    }

    fn step(&mut self, batch: &mut Batch) {
        for action in &mut self.actions {
            *action = (0.5 + self.stream.normal(0.1)).clamp(0.0, 1.0) as f32;
        }
        batch.step(&self.actions);
    }
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn batch(engine: EngineKind, environments: usize) -> Batch {
    batch_on(GroundKind::Plane, engine, environments)
}

fn batch_on(ground: GroundKind, engine: EngineKind, environments: usize) -> Batch {
    let mut config = config(engine);
    config.ground.kind = ground;
    config.push.enabled = true;
    config.push.interval = 0.5;
    config.randomise.mass = 0.1;
    config.randomise.centre_of_mass = 0.01;
    Batch::new(robot("nimbro_op2x"), &config, environments, 7).unwrap()
}

#[test]
fn a_batch_with_another_seed_is_a_new_one_and_a_restart_leaves_the_episode_out() {
    for engine in EngineKind::ALL {
        let config = config(engine);
        let new = |seed| Batch::new(robot("nimbro_op2x"), &config, 3, seed).unwrap();
        let (mut fresh, mut reused) = (new(9), new(7));
        let mut player = Player::new(1, &reused);
        (0..80).for_each(|_| player.step(&mut reused));
        reused.reseed(9);
        let (mut one, mut other) = (Player::new(2, &fresh), Player::new(2, &reused));
        for _ in 0..60 {
            assert_eq!(bits(fresh.observations()), bits(reused.observations()), "{engine:?}");
            one.step(&mut fresh);
            other.step(&mut reused);
            assert_eq!(fresh.terms(), reused.terms());
        }
        let (mut second, mut third) = (new(9), new(9));
        let first = bits(second.observations());
        second.restart();
        assert_ne!(bits(second.observations()), first);
        third.restart();
        assert_eq!(bits(second.observations()), bits(third.observations()));
        second.restart();
        assert_ne!(bits(second.observations()), bits(third.observations()));
    }
}

/// Actions that follow the observation; they bring some robots down.
fn follow(observations: &[f32], actions: &mut [f32]) {
    let width = observations.len() * 16 / actions.len();
    for (row, observation) in actions.chunks_exact_mut(16).zip(observations.chunks_exact(width)) {
        for (i, action) in row.iter_mut().enumerate() {
            *action = (0.5 + 0.4 * observation[i] + 0.1 * observation[16 + i]).clamp(0.0, 1.0);
        }
    }
}

/// Bits of the observations, sums of the rewards, ends.
type Step = (Vec<u32>, Vec<f64>, Vec<Option<End>>);

/// What came of each step in the environments of a group.
#[derive(Default)]
struct Seen {
    actions: Vec<f32>,
    steps: Vec<Step>,
}

impl Seen {
    fn note(&mut self, observations: &[f32], terms: &[Terms], ends: &[Option<End>]) {
        let rewards = terms.iter().map(Terms::total).collect();
        self.steps.push((bits(observations), rewards, ends.to_vec()));
    }
}

struct Following;

impl Collect for Following {
    type Part = Seen;

    fn act<'p>(&self, seen: &'p mut Seen, step: usize, observations: &[f32]) -> &'p [f32] {
        assert_eq!(step, seen.steps.len() % 50);
        follow(observations, &mut seen.actions);
        &seen.actions
    }

    fn take(&self, seen: &mut Seen, _: usize, outcomes: &Outcomes<'_>) {
        seen.note(outcomes.observations, outcomes.terms, outcomes.ends);
    }
}

#[test]
fn groups_that_go_through_many_steps_by_themselves_do_what_they_do_step_by_step() {
    for (engine, environments, ground) in [
        (EngineKind::Rapier, 5, GroundKind::Plane),
        (EngineKind::Lanes, 70, GroundKind::Plane),
        (EngineKind::Lanes, 70, GroundKind::Rough),
    ] {
        let batch = || batch_on(ground, engine, environments);
        let (mut stepped, mut rolled) = (batch(), batch());
        let groups: Vec<_> = rolled.groups().collect();
        assert!(groups.len() > 2, "{engine:?} {groups:?}");
        let part = |group: &Range<usize>| Seen {
            actions: vec![0.0; group.len() * 16],
            ..Seen::default()
        };
        let mut parts: Vec<_> = groups.iter().map(part).collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        pool.install(|| (0..3).for_each(|_| rolled.roll(50, &Following, &mut parts)));
        let mut actions = vec![0.0; environments * 16];
        let n = stepped.shared().spec.observation_len();
        for step in 0..150 {
            follow(stepped.observations(), &mut actions);
            stepped.step(&actions);
            let mut seen = Seen::default();
            seen.note(stepped.observations(), stepped.terms(), stepped.ends());
            for (group, part) in groups.iter().zip(&parts) {
                let ((observations, rewards, ends), (own, own_rewards, own_ends)) = (&seen.steps[0], &part.steps[step]);
                assert_eq!(&observations[group.start * n..group.end * n], own, "{engine:?} {step}");
                assert_eq!(
                    (&rewards[group.clone()], &ends[group.clone()]),
                    (&own_rewards[..], &own_ends[..])
                );
            }
        }
        assert_eq!(stepped.save(), rolled.save());
        let episodes: Vec<_> = stepped.take_episodes().collect();
        assert!(episodes.len() > 2, "{} episodes ended in {engine:?}", episodes.len());
        assert_eq!(rolled.take_episodes().collect::<Vec<_>>(), episodes);
    }
}

#[test]
fn a_saved_batch_goes_on_with_the_same_bits() {
    for engine in EngineKind::ALL {
        let mut original = batch(engine, 5);
        let mut player = Player::new(1, &original);
        (0..50).for_each(|_| player.step(&mut original));
        let saved = original.save();
        let mut restored = batch(engine, 5);
        restored.load(&saved).unwrap();
        let mut again = Player {
            stream: player.stream.clone(),
            actions: player.actions.clone(),
        };
        let mut ended = 0;
        for _ in 0..150 {
            player.step(&mut original);
            again.step(&mut restored);
            assert_eq!(
                bits(original.observations()),
                bits(restored.observations()),
                "{engine:?}"
            );
            assert_eq!(original.terms(), restored.terms());
            assert_eq!(original.ends(), restored.ends());
            ended += original.ends().iter().flatten().count();
        }
        assert!(ended > 5, "{ended} episodes ended in {engine:?}");
        assert_eq!(original.save(), restored.save());
    }
}

#[test]
fn what_an_environment_does_depends_on_no_other() {
    for engine in EngineKind::ALL {
        let (mut few, mut many) = (batch(engine, 3), batch(engine, 21));
        let (observations, actions) = (few.shared().spec.observation_len(), few.shared().spec.action_len());
        let mut player = Player::new(1, &many);
        for _ in 0..100 {
            player.step(&mut many);
            few.step(&player.actions[..3 * actions]);
            assert_eq!(
                bits(few.observations()),
                bits(&many.observations()[..3 * observations]),
                "{engine:?}"
            );
            assert_eq!(few.ends(), &many.ends()[..3]);
        }
    }
}

#[test]
fn a_state_of_another_configuration_is_refused() {
    let mut few = batch(EngineKind::Rapier, 3);
    let lanes = batch(EngineKind::Lanes, 3).save();
    for bytes in [&batch(EngineKind::Rapier, 4).save()[..], &lanes, b"rubbish", &[]] {
        few.load(bytes).unwrap_err();
    }
}

#[test]
fn pushes_are_drawn_up_to_the_curriculums_share_of_the_largest() {
    let trajectory = |largest: f64, share: f64| {
        let mut config = config(EngineKind::Lanes);
        config.push.enabled = true;
        config.push.interval = 0.2;
        config.push.force = largest;
        let mut batch = Batch::new(robot("nimbro_op2x"), &config, 3, 7).unwrap();
        batch.set_factors(Factors {
            velocity: 1.0,
            foot: 1.0,
            push: share,
        });
        let mut player = Player::new(1, &batch);
        (0..40).for_each(|_| player.step(&mut batch));
        bits(batch.observations())
    };
    assert_eq!(trajectory(100.0, 0.25), trajectory(25.0, 1.0));
    assert_ne!(trajectory(100.0, 0.25), trajectory(100.0, 1.0));
}

#[test]
fn a_number_that_is_not_finite_loses_its_episode_and_is_traced_to_where_it_came_up() {
    for engine in EngineKind::ALL {
        let mut bad_reward = batch(engine, 3);
        bad_reward.set_factors(Factors {
            velocity: f64::NAN,
            foot: 1.0,
            push: 1.0,
        });
        let lost_to = |batch: &mut Batch| {
            let actions = vec![0.5; 3 * batch.shared().spec.action_len()];
            for _ in 0..3 {
                batch.step(&actions);
                assert_eq!(batch.ends(), [Some(End::Lost); 3]);
                assert!(batch.terms().iter().all(|terms| terms.total() == 0.0));
            }
            batch
                .take_episodes()
                .for_each(|episode| assert!(episode.terms.total().is_finite()));
            batch.faults().to_vec()
        };
        let term = Fault::Reward("velocity");
        assert_eq!(lost_to(&mut bad_reward), [(0, term), (1, term), (2, term)]);
        bad_reward.set_factors(Factors {
            velocity: 1.0,
            foot: 1.0,
            push: 1.0,
        });
        bad_reward.step(&vec![0.5; 3 * bad_reward.shared().spec.action_len()]);
        assert_eq!((bad_reward.ends(), bad_reward.faults()), (&[None; 3][..], &[][..]));
        // A velocity sensor beyond single precision reads infinity.
        let mut config = config(engine);
        config.noise.enabled = true;
        config.noise.velocity = 1e300;
        let mut bad_sensor = Batch::new(robot("nimbro_op2x"), &config, 3, 7).unwrap();
        let names: Vec<String> = lost_to(&mut bad_sensor)
            .iter()
            .map(|&(_, fault)| match fault {
                Fault::Observation(entry) => bad_sensor.shared().spec.entry_name(entry).unwrap(),
                fault => panic!("{fault:?}"),
            })
            .collect();
        assert!(names.iter().all(|name| name.contains("joint_velocity")), "{names:?}");
    }
}

#[test]
fn episodes_end_by_falling_or_at_their_full_length_and_say_so() {
    let mut config = config(EngineKind::Lanes);
    config.task.random_first_length = false;
    config.task.episode_seconds = 1.0;
    let mut batch = Batch::new(robot("nimbro_op2x"), &config, 8, 1).unwrap();
    let still = vec![0.5; 8 * batch.shared().spec.action_len()];
    for step in 1..=40 {
        batch.step(&still);
        let expected = (step == 40).then_some(End::TimeOut);
        assert!(
            batch.ends().iter().all(|end| *end == expected),
            "{:?} at step {step}",
            batch.ends()
        );
    }
    let episodes: Vec<_> = batch.take_episodes().collect();
    assert!(
        episodes
            .iter()
            .all(|episode| episode.steps == 40 && episode.terms.alive > 0.0)
    );
    let wild: Vec<f32> = (0..still.len()).map(|i| (i % 2) as f32).collect();
    (0..40).for_each(|_| batch.step(&wild));
    assert!(
        batch
            .take_episodes()
            .any(|episode| episode.end != End::TimeOut && episode.steps < 40)
    );
}

#[test]
fn legs_that_pass_through_each_other_end_the_episode_unless_they_may() {
    for (engine, ends_it) in EngineKind::ALL
        .into_iter()
        .flat_map(|engine| [(engine, true), (engine, false)])
    {
        let mut config = config(engine);
        config.task.overlap_margin = 0.0;
        config.task.end_on_overlap = ends_it;
        let mut batch = Batch::new(robot("nimbro_op2x"), &config, 3, 7).unwrap();
        let spec = &batch.shared().spec;
        // Both hips roll inward as far as they go; the soles are 4 cm apart.
        let inward = spec.joints.iter().map(|joint| match joint.name.as_str() {
            "left_hip_roll" => 0.0,
            "right_hip_roll" => 1.0,
            _ => 0.5,
        });
        let actions: Vec<f32> = inward.collect::<Vec<_>>().repeat(3);
        let ends = (0..80).flat_map(|_| {
            batch.step(&actions);
            batch.ends().to_vec()
        });
        let first = ends.flatten().next();
        let expected = if ends_it { End::Overlap } else { End::Fallen };
        assert_eq!(first, Some(expected), "{engine:?}");
        let crossed = batch
            .take_episodes()
            .filter(|episode| episode.end == End::Overlap)
            .count();
        assert_eq!(crossed > 0, ends_it, "{engine:?}");
    }
}

#[test]
fn a_step_is_judged_by_the_command_its_action_was_chosen_for() {
    for engine in EngineKind::ALL {
        let mut config = config(engine);
        config.command.rate = [1e3; 3];
        config.command.resample_seconds = 0.2;
        let new = || Batch::new(robot("nimbro_op2x"), &config, 1, 3).unwrap();
        let (mut forward, mut backward) = (new(), new());
        let range = |x| CommandRange {
            lower: [x, 0.0, 0.0],
            upper: [x, 0.0, 0.0],
            zero_share: 0.0,
            axis_share: 0.0,
        };
        forward.set_range(range(0.5));
        backward.set_range(range(-0.5));
        let still = vec![0.5; forward.shared().spec.action_len()];
        // Only a new command makes the two differ: its first step is the one in which it is drawn.
        loop {
            forward.step(&still);
            backward.step(&still);
            assert_eq!(forward.terms(), backward.terms(), "{engine:?}");
            if bits(forward.observations()) != bits(backward.observations()) {
                break;
            }
        }
        forward.step(&still);
        backward.step(&still);
        assert_ne!(forward.terms(), backward.terms(), "{engine:?}");
    }
}
