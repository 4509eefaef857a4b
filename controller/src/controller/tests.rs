use alloc::{string::ToString, vec, vec::Vec};

use proptest::prelude::*;

use super::*;
use crate::testing::{STILL, biped, policy, policy_with};

const PERIOD: u64 = 25_000_000;

/// A controller with a clock and readings of a robot that stands.
struct Robot {
    controller: Controller,
    now: u64,
    position: Vec<f32>,
    attitude: [f32; 2],
    targets: Vec<f32>,
}

impl Robot {
    fn new() -> Self {
        let policy = policy();
        let position: Vec<f32> = policy.spec().joints.iter().map(|joint| joint.nominal).collect();
        Self {
            controller: Controller::new(&policy).expect("valid"),
            now: 1_000_000_000,
            targets: position.clone(),
            position,
            attitude: [0.0; 2],
        }
    }

    /// A step after `pause` ns with readings `age` ns old.
    fn step(&mut self, pause: u64, age: u64, desired: [f32; 3]) -> Status {
        self.now += pause;
        let sensors = Sensors {
            position: &self.position,
            velocity: &STILL,
            attitude: self.attitude,
            gyro: [0.0; 3],
            base_velocity: None,
        };
        let (controller, now) = (&mut self.controller, self.now);
        controller.step(now, now.saturating_sub(age), &sensors, desired, &mut self.targets)
    }

    fn good(&mut self) -> Status {
        self.step(PERIOD, 0, [0.1, 0.0, 0.0])
    }

    fn walk(&mut self, steps: usize) {
        for _ in 0..steps {
            self.good();
        }
    }

    fn nominal(&self) -> Vec<f32> {
        self.controller
            .spec()
            .joints
            .iter()
            .map(|joint| joint.nominal)
            .collect()
    }
}

#[test]
fn with_good_readings_every_step_is_that_of_the_golden_loop() {
    let policy = policy();
    let mut controller = Controller::new(&policy).expect("valid");
    controller.reset(policy.golden().clock_phase);
    let mut targets = vec![0.0; policy.spec().action_len()];
    for (k, step) in policy.golden().steps.iter().enumerate() {
        let now = k as u64 * PERIOD;
        let status = controller.step(now, now, &step.sensors(), step.desired, &mut targets);
        assert_eq!((status.mode, status.fault), (Mode::Walking, None), "step {k}");
        assert_eq!(targets, step.targets, "step {k}");
        assert_eq!(controller.observation(), step.observation);
    }
}

#[test]
fn a_robot_that_stands_is_ok() {
    let mut robot = Robot::new();
    for _ in 0..100 {
        let status = robot.good();
        assert!(status.is_ok(), "{status:?}");
    }
}

#[test]
fn a_lost_reading_holds_the_targets_and_the_next_one_walks_on() {
    let mut robot = Robot::new();
    robot.walk(20);
    let before = robot.targets.clone();
    let status = robot.step(PERIOD, 200_000_000, [0.1, 0.0, 0.0]);
    assert_eq!(status.mode, Mode::Holding);
    assert!(
        matches!(status.fault, Some(Fault::Stale { age }) if (age - 0.2).abs() < 1e-3),
        "{status:?}"
    );
    assert_eq!(robot.targets, before);
    assert_eq!(robot.good().mode, Mode::Walking);
    assert_ne!(robot.targets, before);
    let phase = robot.controller.pipeline().clock_phase();
    // 22 steps of 0.025 s at a period of 0.8 s: the clock went on while the targets were held.
    assert!((phase - 22.0 * 0.025 / 0.8).abs() < 1e-4, "{phase}");
}

#[test]
fn without_readings_the_robot_goes_to_the_nominal_pose_slowly_and_walks_when_they_are_back() {
    let mut robot = Robot::new();
    robot.position.iter_mut().for_each(|q| *q += 0.2);
    robot.walk(40);
    let mut before = robot.targets.clone();
    assert_ne!(before, robot.nominal());
    let ranges: Vec<f32> = robot
        .controller
        .spec()
        .joints
        .iter()
        .map(|j| j.upper - j.lower)
        .collect();
    let mut modes = Vec::new();
    for _ in 0..200 {
        let status = robot.step(PERIOD, 10_000_000_000, [0.1, 0.0, 0.0]);
        for ((target, before), range) in robot.targets.iter().zip(&before).zip(&ranges) {
            assert!((target - before).abs() <= 1.001 * range * 0.025 / RAMP_SECONDS);
        }
        before.clone_from(&robot.targets);
        if modes.last() != Some(&status.mode) {
            modes.push(status.mode);
        }
    }
    assert_eq!(modes, [Mode::Holding, Mode::Ramping, Mode::Resting]);
    assert_eq!(robot.targets, robot.nominal());
    let rest = (0..).find(|_| robot.good().mode == Mode::Walking).expect("walks");
    assert_eq!(
        rest,
        20 - 1,
        "half a second of good readings, the last of which it walks on"
    );
    assert!(
        robot.controller.pipeline().clock_phase() < 0.1,
        "from the start of an episode"
    );
}

#[test]
fn what_is_no_number_is_named_and_holds_the_targets() {
    let mut robot = Robot::new();
    robot.good();
    robot.position[3] = f32::NAN;
    let fault = robot.good().fault;
    assert_eq!(
        fault,
        Some(Fault::NotFinite {
            reading: Reading::Position,
            index: 3
        })
    );
    robot.position[3] = 0.0;
    robot.attitude[1] = f32::INFINITY;
    let fault = robot.good().fault;
    assert_eq!(
        fault,
        Some(Fault::NotFinite {
            reading: Reading::Attitude,
            index: 1
        })
    );
}

#[test]
fn a_fall_stays_one_until_the_reset() {
    let mut robot = Robot::new();
    robot.good();
    robot.attitude = [0.0, 0.9];
    assert_eq!(robot.good().fault, Some(Fault::Fallen));
    robot.attitude = [0.0; 2];
    let last = (0..400).map(|_| robot.good()).last().expect("steps");
    assert_eq!((last.mode, last.fault), (Mode::Resting, Some(Fault::Fallen)));
    assert_eq!(robot.targets, robot.nominal());
    robot.controller.reset(0.0);
    assert!(robot.good().is_ok());
}

#[test]
fn a_loop_that_runs_too_fast_is_told_and_walks_at_its_rate_all_the_same() {
    let mut robot = Robot::new();
    robot.good();
    let before = robot.targets.clone();
    assert_eq!(robot.step(PERIOD / 4, 0, [0.1, 0.0, 0.0]).fault, Some(Fault::OverRate));
    assert_eq!(robot.targets, before);
    // A tenth too fast: one step of eleven is too many.
    let mut robot = Robot::new();
    let steps = 1100;
    let refused = (0..steps)
        .filter(|_| robot.step(PERIOD * 10 / 11, 0, [0.1, 0.0, 0.0]).fault.is_some())
        .count();
    assert!((steps / 11 - 2..=steps / 11 + 2).contains(&refused), "{refused}");
}

#[test]
fn a_late_step_is_made_and_said_to_be_late() {
    let mut robot = Robot::new();
    robot.good();
    assert_eq!(robot.step(PERIOD + PERIOD / 4, 0, [0.1, 0.0, 0.0]).late, 0.0);
    let status = robot.step(2 * PERIOD, 0, [0.1, 0.0, 0.0]);
    assert!(
        (status.late - 0.03125).abs() < 1e-4 && status.mode == Mode::Walking,
        "{status:?}"
    );
    assert_eq!(robot.good().late, 0.0);
}

#[test]
fn after_a_late_step_a_loop_may_go_on_on_its_old_beat_or_on_a_new_one() {
    // Late by 0.9 of a period, the next again on the beat of before.
    let mut robot = Robot::new();
    robot.good();
    assert!(robot.step(PERIOD * 19 / 10, 0, [0.1, 0.0, 0.0]).late > 0.02);
    assert_eq!(robot.step(PERIOD / 10, 0, [0.1, 0.0, 0.0]).fault, None);
    assert!((0..50).all(|_| robot.good().is_ok()));
    // The same, but a whole period after it.
    let mut robot = Robot::new();
    robot.good();
    assert!(robot.step(PERIOD * 19 / 10, 0, [0.1, 0.0, 0.0]).late > 0.02);
    assert!((0..50).all(|_| robot.good().is_ok()));
    // A tenth too slow is told, if not in every step.
    let late = (0..50).filter(|_| robot.step(PERIOD * 11 / 10, 0, [0.1, 0.0, 0.0]).late > 0.0);
    assert!(late.count() >= 5);
}

#[test]
fn a_clock_that_goes_back_starts_the_schedule_anew() {
    let mut robot = Robot::new();
    robot.good();
    robot.now = u64::MAX - 2 * PERIOD;
    robot.good();
    robot.now = 0;
    let last = (0..400).map(|_| robot.good()).last().expect("steps");
    assert!(last.is_ok(), "{last:?}");
}

#[test]
fn a_robot_whose_joints_did_not_follow_does_not_walk() {
    let mut robot = Robot::new();
    let away: Vec<f32> = robot.controller.spec().joints.iter().map(|joint| joint.upper).collect();
    robot.controller.take_over(&away).expect("sound positions");
    robot.position = away.clone();
    let last = (0..600).map(|_| robot.good()).last().expect("steps");
    assert_eq!((last.mode, last.fault), (Mode::Resting, None));
    robot.position = robot.nominal();
    let last = (0..40).map(|_| robot.good()).last().expect("steps");
    assert!(last.is_ok(), "{last:?}");
}

#[test]
fn after_a_pause_the_robot_goes_to_the_nominal_pose_before_it_walks() {
    let mut robot = Robot::new();
    robot.position.iter_mut().for_each(|q| *q += 0.1);
    robot.walk(20);
    let before = robot.targets.clone();
    let status = robot.step(1_000_000_000, 0, [0.1, 0.0, 0.0]);
    assert_eq!(status.mode, Mode::Ramping);
    let moved = robot.targets.iter().zip(&before).any(|(a, b)| (a - b).abs() > 0.02);
    assert!(!moved, "from the pose that was held");
    assert!((0..400).any(|_| robot.good().mode == Mode::Walking));
}

#[test]
fn a_robot_that_is_taken_over_is_not_jerked() {
    let mut robot = Robot::new();
    robot.position.iter_mut().for_each(|q| *q += 0.3);
    assert_eq!(robot.controller.take_over(&robot.position), Ok(()));
    let status = robot.good();
    assert_eq!(status.mode, Mode::Ramping);
    for (target, nominal) in robot.targets.iter().zip(&robot.nominal()) {
        assert!((target - nominal - 0.3).abs() < 0.02, "{target} {nominal}");
    }
    let modes: Vec<Mode> = (0..200).map(|_| robot.good().mode).collect();
    assert!(modes.contains(&Mode::Resting) && modes.last() == Some(&Mode::Walking));
}

/// What no robot can be in: nothing is known to ramp from.
#[test]
fn positions_that_cannot_be_are_refused_and_the_first_good_ones_are_taken_over() {
    let spec = biped();
    let knee = &spec.joints[3];
    let far = knee.upper + 0.1 * (knee.upper - knee.lower) + 0.021;
    for value in [f32::NAN, f32::NEG_INFINITY, 1e9, far] {
        for walked in [0, 20] {
            let mut robot = Robot::new();
            robot.position.iter_mut().for_each(|q| *q += 0.05);
            robot.walk(walked);
            let before = robot.targets.clone();
            let good = robot.position.clone();
            robot.position[3] = value;
            let refused = robot.controller.take_over(&robot.position).expect_err("not believed");
            let text = refused.sentence(robot.controller.spec());
            assert!(text.starts_with("position[left_knee] is "), "{text}");
            for _ in 0..40 {
                let status = robot.good();
                assert_eq!((status.mode, status.fault.is_some()), (Mode::Holding, true), "{value}");
                assert_eq!(robot.targets, before, "what was told last");
            }
            // A pause does not make it known either.
            assert_eq!(robot.step(2_000_000_000, 0, [0.0; 3]).mode, Mode::Holding);
            robot.position.clone_from(&good);
            assert_eq!(
                robot.step(PERIOD, 10_000_000_000, [0.0; 3]).mode,
                Mode::Holding,
                "nor do old readings"
            );
            let status = robot.good();
            assert_eq!((status.mode, status.fault), (Mode::Ramping, None));
            assert_eq!(robot.targets, good, "the ramp begins where the joints are");
            assert!((0..400).any(|_| robot.good().mode == Mode::Walking));
        }
    }
}

#[test]
fn all_positions_lost_are_refused_as_well_and_a_reset_forgets_it() {
    let mut robot = Robot::new();
    robot.controller.take_over(&[f32::NAN; 10]).expect_err("not believed");
    assert_eq!(robot.good().mode, Mode::Ramping);
    robot.controller.take_over(&[f32::NAN; 10]).expect_err("not believed");
    robot.controller.reset(0.0);
    assert!(robot.good().is_ok());
}

/// At a limit, pressed into a stop or with an encoder that is off a joint is still where it says.
#[test]
fn readings_that_no_sensor_gives_hold_the_targets_and_those_near_the_limits_do_not() {
    let joint = biped().joints[3].clone();
    let mut robot = Robot::new();
    robot.walk(5);
    robot.position[3] = joint.upper + 0.1 * (joint.upper - joint.lower) + 0.019;
    assert_eq!(robot.good().fault, None);
    let before = robot.targets.clone();
    robot.position[3] = 1e9;
    let status = robot.good();
    assert_eq!(
        (status.mode, robot.targets == before),
        (Mode::Holding, true),
        "{status:?}"
    );
    let sentence = status.sentence(robot.controller.spec()).to_string();
    assert!(
        sentence.starts_with("position[left_knee] is 1000000000, which cannot be: its limits are"),
        "{sentence}"
    );
    robot.position[3] = joint.nominal;
    assert_eq!(robot.good().mode, Mode::Walking);
    robot.attitude = [4.0, 0.0];
    let fault = robot.good().fault;
    assert!(
        matches!(
            fault,
            Some(Fault::Absurd {
                reading: Reading::Attitude,
                index: 0,
                ..
            })
        ),
        "an angle beyond half a turn is no fall: {fault:?}"
    );
    robot.attitude = [0.0; 2];
    assert!(robot.good().is_ok());
}

#[test]
fn a_status_that_is_ok_needs_no_words_and_others_say_all_that_is_wrong() {
    let mut robot = Robot::new();
    let said = |status: Status, robot: &Robot| status.sentence(robot.controller.spec()).to_string();
    let status = robot.good();
    assert_eq!(said(status, &robot), "");
    let status = robot.step(2 * PERIOD, 200_000_000, [9.0, 0.0, 0.0]);
    assert_eq!(
        said(status, &robot),
        "the newest reading is 0.200 s old; the desired velocity is clipped to what was trained; the step came 0.025 s late"
    );
}

#[test]
fn a_desired_velocity_beyond_training_is_clipped_and_reported() {
    let mut robot = Robot::new();
    let curriculum = policy().identity().curriculum;
    let status = robot.step(PERIOD, 0, [5.0, 0.0, 0.0]);
    assert_eq!(status.command, Command::Clipped);
    assert_eq!(robot.controller.pipeline().desired()[0], curriculum.upper[0]);
    assert_eq!(robot.step(PERIOD, 0, [f32::NAN, 0.0, 0.0]).command, Command::NotFinite);
    assert_eq!(robot.controller.pipeline().desired()[0], curriculum.upper[0]);
}

#[test]
fn a_reading_beyond_training_is_named_and_measured() {
    let spec = biped();
    let policy = policy_with(spec, |lower, upper| (lower[3], upper[3]) = (0.0, 1.0));
    let mut robot = Robot::new();
    robot.controller = Controller::new(&policy).expect("valid");
    robot.position[3] = 1.5;
    let found = robot.good().out_of_range.expect("beyond its bound");
    assert_eq!(
        (found.entry, found.value, found.excess, found.entries),
        (3, 1.5, 0.5, 1)
    );
    robot.position[3] = 0.5;
    assert_eq!(robot.good().out_of_range, None);
}

/// In the mirror the right knee is seen where the left one was; the report names the joint that was measured.
#[test]
fn a_reading_that_is_seen_in_the_mirror_is_named_as_it_was_measured() {
    let spec = Spec {
        symmetry: Some(crate::testing::biped_mirror()),
        ..biped()
    };
    let policy = policy_with(spec, |lower, upper| (lower[3], upper[3]) = (0.0, 1.0));
    let mut robot = Robot::new();
    robot.controller = Controller::new(&policy).expect("valid");
    robot.controller.reset(0.6);
    robot.position[8] = 1.5;
    let found = robot.good().out_of_range.expect("beyond its bound");
    assert_eq!((found.entry, found.value), (8, 1.5));
}

/// Numbers a broken sensor could deliver.
fn hostile() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -0.5f32..0.5,
        1 => prop::num::f32::ANY,
        1 => prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 1e30, -0.0]),
    ]
}

/// Times a broken clock could deliver, as steps from the one before.
fn pause() -> impl Strategy<Value = i64> {
    prop_oneof![6 => Just(PERIOD as i64), 1 => 0i64..100_000_000, 1 => any::<i64>()]
}

proptest! {
    #[test]
    fn targets_are_finite_and_within_limits_whatever_comes_in(
        steps in prop::collection::vec((
            (pause(), pause()), prop::array::uniform10(hostile()), prop::array::uniform10(hostile()),
            prop::array::uniform2(hostile()), prop::array::uniform3(hostile()), prop::array::uniform3(hostile()),
            prop::option::of(prop::array::uniform3(hostile()))), 1..60),
    ) {
        let mut controller = Controller::new(&policy()).expect("valid");
        let (mut now, mut targets) = (0u64, vec![f32::NAN; 10]);
        for ((pause, age), position, velocity, attitude, gyro, desired, base_velocity) in steps {
            now = now.wrapping_add_signed(pause);
            let measured = if age == PERIOD as i64 { now } else { now.wrapping_sub(age as u64) };
            let sensors = Sensors { position: &position, velocity: &velocity, attitude, gyro, base_velocity };
            let status = controller.step(now, measured, &sensors, desired, &mut targets);
            for (target, joint) in targets.iter().zip(&controller.spec().joints) {
                prop_assert!(*target >= joint.lower && *target <= joint.upper, "{} {target} {status:?}", joint.name);
            }
            prop_assert!(status.fault.is_some() || position.iter().all(|x| x.is_finite()));
            prop_assert!(status.fault.is_none() || status.mode != Mode::Walking || status.fault == Some(Fault::OverRate));
        }
    }
}
