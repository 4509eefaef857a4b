use alloc::{vec, vec::Vec};

use proptest::prelude::*;

use super::*;
use crate::{
    spec::{Block, FilterSpec},
    testing::biped,
};

const STILL: [f32; 10] = [0.0; 10];

fn nominal(spec: &Spec) -> Vec<f32> {
    spec.joints.iter().map(|joint| joint.nominal).collect()
}

fn standing<'a>(position: &'a [f32], gyro: [f32; 3]) -> Sensors<'a> {
    Sensors {
        position,
        velocity: &STILL,
        attitude: [0.0; 2],
        gyro,
        base_velocity: None,
    }
}

/// A spec without filter and clamp, so that one step of the law shows.
fn bare(law: ActionLaw) -> Spec {
    let mut spec = biped();
    spec.action = crate::spec::ActionSpec {
        law,
        filter: None,
        torque_clamp: false,
    };
    spec
}

fn decode(spec: &Spec, position: &[f32], action: &[f32]) -> Vec<f32> {
    let mut pipeline = Pipeline::new(spec).expect("valid");
    let mut observation = vec![0.0; spec.observation_len()];
    let mut targets = vec![0.0; spec.action_len()];
    pipeline.observe(spec, &standing(position, [0.0; 3]), [0.0; 3], &mut observation);
    pipeline.decode(spec, action, &mut targets);
    targets
}

#[test]
fn what_was_read_nowhere_is_no_state_to_go_on_from() {
    let spec = biped();
    let own = Pipeline::new(&spec).expect("valid");
    assert!(own.clone().has_shape_of(&own));
    for place in [f32::NAN, f32::INFINITY] {
        let [mut read, mut told] = [own.clone(), own.clone()];
        (read.measured[0], told.previous_target[3]) = (place, place);
        assert!(!read.has_shape_of(&own) && !told.has_shape_of(&own), "{place}");
    }
}

#[test]
fn every_block_lands_at_its_place() {
    let spec = biped();
    let mut pipeline = Pipeline::new(&spec).expect("valid");
    pipeline.reset(&spec, 0.25);
    let position: Vec<f32> = (0..10).map(|i| 0.01 * i as f32).collect();
    let velocity: Vec<f32> = (0..10).map(|i| 0.1 * i as f32).collect();
    let sensors = Sensors {
        position: &position,
        velocity: &velocity,
        attitude: [0.1, 0.0],
        gyro: [0.4, 0.5, 0.6],
        base_velocity: Some([1.0, 2.0, 3.0]),
    };
    let mut out = vec![0.0; spec.observation_len()];
    pipeline.observe(&spec, &sensors, [0.3, -2.0, 0.0], &mut out);
    assert_eq!(out.len(), 10 + 10 + 2 + 3 + 3 + 3 + 3 + 3 + 2 + 10 + 3);
    assert_eq!(out[..10], position);
    assert_eq!(out[10..20], velocity);
    assert_eq!(out[20..25], [0.1, 0.0, 0.4, 0.5, 0.6]);
    // Rolled by 0.1 and level again: x stays, y and z turn by 0.1.
    let (sin, cos) = (0.1f32.sin(), 0.1f32.cos());
    let level = [1.0, 2.0 * cos - 3.0 * sin, 2.0 * sin + 3.0 * cos];
    for axis in 0..3 {
        assert!((out[25 + axis] - level[axis]).abs() < 1e-5, "{:?}", &out[25..28]);
    }
    assert_eq!(out[28..31], [1.0, 2.0, 3.0]);
    assert_eq!(out[31..34], [0.3, -0.6, 0.0], "the desired velocity is clipped");
    assert_eq!(
        out[34..37],
        [0.5 / 40.0, -0.5 / 40.0, 0.0],
        "the command moves by its rate"
    );
    assert!((out[37] - 1.0).abs() < 1e-6 && out[38].abs() < 1e-6, "a quarter cycle");
    assert_eq!(out[39..49], [0.0; 10]);
    let measured = [level[0], level[1], 0.6 + 0.5 * sin / (1.0 + cos)];
    for axis in 0..3 {
        let error = (out[34 + axis] - measured[axis]) / 40.0;
        assert!((out[49 + axis] - error).abs() < 1e-5, "{:?}", &out[49..]);
    }
}

#[test]
fn the_laws_do_what_they_say() {
    let position = vec![0.1; 10];
    let mut action = vec![0.5; 10];
    action[0] = 0.75;
    let scale = 0.3;
    let measured = decode(&bare(ActionLaw::IncrementOnMeasured), &position, &action);
    assert!((measured[0] - (0.1 + 0.5 * scale)).abs() < 1e-6);
    assert!((measured[2] - 0.1).abs() < 1e-6);
    for law in [ActionLaw::IncrementOnTarget, ActionLaw::OffsetFromNominal] {
        let spec = bare(law);
        let targets = decode(&spec, &position, &action);
        assert!((targets[0] - (spec.joints[0].nominal + 0.5 * scale)).abs() < 1e-6);
        assert!((targets[2] - spec.joints[2].nominal).abs() < 1e-6);
    }
}

#[test]
fn increments_on_the_target_add_up_and_offsets_do_not() {
    for (law, expected) in [(ActionLaw::IncrementOnTarget, 0.3), (ActionLaw::OffsetFromNominal, 0.1)] {
        let spec = bare(law);
        let mut pipeline = Pipeline::new(&spec).expect("valid");
        let mut targets = vec![0.0; 10];
        let mut action = [0.5; 10];
        action[0] = 0.5 + 0.5 / 3.0;
        for _ in 0..3 {
            pipeline.decode(&spec, &action, &mut targets);
        }
        assert!((targets[0] - expected).abs() < 1e-6, "{law:?} {}", targets[0]);
    }
}

#[test]
fn the_torque_clamp_keeps_the_target_within_reach() {
    let mut spec = bare(ActionLaw::OffsetFromNominal);
    spec.action.torque_clamp = true;
    for joint in &mut spec.joints {
        (joint.kp, joint.torque_limit) = (100.0, 5.0);
    }
    let position = nominal(&spec);
    let targets = decode(&spec, &position, &[1.0; 10]);
    for (target, q) in targets.iter().zip(&position) {
        assert!((target - (q + 0.05)).abs() < 1e-6);
    }
}

#[test]
fn the_command_reaches_the_desired_velocity_by_equal_steps() {
    let spec = biped();
    let mut pipeline = Pipeline::new(&spec).expect("valid");
    let position = nominal(&spec);
    let mut out = vec![0.0; spec.observation_len()];
    let mut commanded = Vec::new();
    for _ in 0..40 {
        pipeline.observe(&spec, &standing(&position, [0.0; 3]), [0.4, 0.0, -0.2], &mut out);
        commanded.push(pipeline.commanded());
    }
    assert!((commanded[9][0] - 0.125).abs() < 1e-6, "0.5 m/s^2 for a quarter second");
    assert_eq!(commanded[39], [0.4, 0.0, -0.2]);
    pipeline.reset(&spec, 0.0);
    pipeline.set_commanded(&spec, [0.2, 0.0, 9.0]);
    assert_eq!(pipeline.commanded(), [0.2, 0.0, 0.6]);
}

#[test]
fn the_inertial_frame_follows_the_gyro_and_is_set_again() {
    let spec = biped();
    let mut pipeline = Pipeline::new(&spec).expect("valid");
    let position = nominal(&spec);
    let mut out = vec![0.0; spec.observation_len()];
    for step in 0..90 {
        let mut sensors = standing(&position, [0.0, 0.0, 0.8]);
        sensors.base_velocity = Some([1.0, 0.0, 0.0]);
        pipeline.observe(&spec, &sensors, [0.0; 3], &mut out);
        let age = step % 40;
        assert_eq!(pipeline.frame_was_set(), age == 0, "step {step}");
        let heading = 0.8 * age as f32 / 40.0;
        assert!(
            (pipeline.heading() - heading).abs() < 1e-5,
            "step {step}: {}",
            pipeline.heading()
        );
        let (inertial, base) = pipeline.velocity();
        assert!((inertial[0] - heading.cos()).abs() < 1e-5 && (inertial[1] - heading.sin()).abs() < 1e-5);
        assert_eq!(base, [1.0, 0.0, 0.0]);
    }
}

#[test]
fn the_tracking_error_is_a_mean_over_a_second() {
    let spec = biped();
    let mut pipeline = Pipeline::new(&spec).expect("valid");
    pipeline.set_commanded(&spec, [0.5, -0.2, 0.3]);
    let position = nominal(&spec);
    let sensors = Sensors {
        base_velocity: Some([0.2, 0.1, 0.0]),
        ..standing(&position, [0.0, 0.0, 0.1])
    };
    let mut out = vec![0.0; spec.observation_len()];
    for step in 1..=120 {
        pipeline.observe(&spec, &sensors, [0.5, -0.2, 0.3], &mut out);
        let share = 1.0 - (1.0 - 1.0 / 40.0f32).powi(step);
        for (entry, error) in out[out.len() - 3..].iter().zip([0.3, -0.3, 0.2]) {
            assert!((entry - share * error).abs() < 1e-5, "step {step}: {entry}");
        }
    }
}

#[test]
fn the_clock_counts_cycles_and_names_the_swing_leg() {
    let spec = biped();
    let mut pipeline = Pipeline::new(&spec).expect("valid");
    let mut targets = vec![0.0; 10];
    assert_eq!(pipeline.clock_swing(&spec), Some((0, 0.0)));
    for _ in 0..24 {
        pipeline.decode(&spec, &[0.5; 10], &mut targets);
    }
    assert!((pipeline.clock_phase() - 0.75).abs() < 1e-5);
    let (leg, progress) = pipeline.clock_swing(&spec).expect("there is a clock");
    assert!(leg == 1 && (progress - 0.5).abs() < 1e-4);
}

#[test]
fn a_restored_loop_goes_on_with_the_same_bits() {
    let spec = biped();
    let mut original = Pipeline::new(&spec).expect("valid");
    let position = nominal(&spec);
    let mut out = vec![0.0; spec.observation_len()];
    let mut targets = vec![0.0; 10];
    for k in 0..17 {
        original.observe(&spec, &standing(&position, [0.1, 0.0, 0.3]), [0.4, 0.0, 0.1], &mut out);
        original.decode(&spec, &[0.1 * (k % 9) as f32; 10], &mut targets);
    }
    let bytes = postcard::to_stdvec(&original).expect("serialises");
    let mut restored: Pipeline = postcard::from_bytes(&bytes).expect("deserialises");
    assert_eq!(restored, original);
    let mut observations = [vec![0.0; spec.observation_len()], vec![0.0; spec.observation_len()]];
    let mut targets = [vec![0.0; 10], vec![0.0; 10]];
    for k in 0..60 {
        for (i, pipeline) in [&mut original, &mut restored].into_iter().enumerate() {
            pipeline.observe(
                &spec,
                &standing(&position, [0.1, 0.2, 0.3]),
                [0.4, 0.0, 0.1],
                &mut observations[i],
            );
            pipeline.decode(&spec, &[0.1 * (k % 9) as f32; 10], &mut targets[i]);
        }
        assert_eq!(observations[0], observations[1]);
        assert_eq!(targets[0], targets[1]);
    }
}

#[test]
fn a_reset_loop_is_a_new_one() {
    let spec = biped();
    let fresh = Pipeline::new(&spec).expect("valid");
    let mut used = fresh.clone();
    let position = nominal(&spec);
    let mut out = vec![0.0; spec.observation_len()];
    let mut targets = vec![0.0; 10];
    used.observe(&spec, &standing(&position, [0.1, 0.0, 0.3]), [0.4, 0.0, 0.1], &mut out);
    used.decode(&spec, &[0.9; 10], &mut targets);
    assert_ne!(used, fresh);
    used.reset(&spec, 0.0);
    assert_eq!(used, fresh);
}

#[test]
fn specs_that_cannot_work_are_refused() {
    let wrong: [fn(&mut Spec); 22] = [
        |spec| spec.control_hz = 0.0,
        |spec| spec.control_hz = f32::NAN,
        |spec| spec.joints.clear(),
        |spec| spec.joints[1].name = spec.joints[0].name.clone(),
        |spec| spec.joints[3].upper = f32::INFINITY,
        |spec| spec.joints[3].nominal = 3.0,
        |spec| spec.joints[3].kp = 0.0,
        |spec| spec.joints[3].action_scale = f32::NAN,
        |spec| spec.clock = None,
        |spec| spec.observation.push(Block::Gyro),
        |spec| spec.action.filter = Some(FilterSpec::Butterworth { cutoff_hz: 20.0 }),
        |spec| spec.command.upper[2] = -0.7,
        |spec| spec.legs[1].segments[4].joint = Some(10),
        |spec| spec.legs[0].segments[4].axis = [0.0; 3],
        |spec| spec.control_hz = 1e30,
        |spec| spec.joints[0].lower = -1e30,
        |spec| spec.joints[0].kp = 1e30,
        |spec| spec.joints[0].torque_limit = 1e30,
        |spec| spec.joints[0].action_scale = 1e30,
        |spec| spec.command.upper[0] = 1e30,
        |spec| spec.legs[0].segments[0].translation[1] = f32::NAN,
        |spec| spec.legs[0].corners[0][2] = 1e30,
    ];
    for (i, change) in wrong.iter().enumerate() {
        let mut spec = biped();
        change(&mut spec);
        let error = Pipeline::new(&spec).expect_err("wrong");
        assert!(!std::format!("{error}").is_empty(), "{i}");
    }
}

/// Numbers a broken sensor or policy could deliver.
fn hostile() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -2.0f32..2.0,
        1 => prop::num::f32::ANY,
        1 => prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 1e30, -0.0]),
    ]
}

proptest! {
    #[test]
    fn targets_are_finite_and_within_limits_whatever_comes_in(
        law in prop::sample::select(vec![
            ActionLaw::IncrementOnMeasured, ActionLaw::IncrementOnTarget, ActionLaw::OffsetFromNominal,
        ]),
        clamp in any::<bool>(),
        filter in prop::sample::select(vec![
            None, Some(FilterSpec::Exponential { gain: 0.3 }), Some(FilterSpec::Butterworth { cutoff_hz: 10.0 }),
        ]),
        steps in prop::collection::vec(
            (prop::array::uniform10(hostile()), prop::array::uniform10(hostile()), prop::array::uniform10(hostile()),
             prop::array::uniform2(hostile()), prop::array::uniform3(hostile()), prop::array::uniform3(hostile()),
             prop::option::of(prop::array::uniform3(hostile()))), 1..20),
    ) {
        let mut spec = biped();
        spec.action = crate::spec::ActionSpec { law, filter, torque_clamp: clamp };
        let mut pipeline = Pipeline::new(&spec).expect("valid");
        let mut out = vec![0.0; spec.observation_len()];
        let mut targets = vec![f32::NAN; 10];
        for (position, velocity, action, attitude, gyro, desired, base_velocity) in steps {
            let sensors = Sensors { position: &position, velocity: &velocity, attitude, gyro, base_velocity };
            pipeline.observe(&spec, &sensors, desired, &mut out);
            pipeline.decode(&spec, &action, &mut targets);
            for (target, joint) in targets.iter().zip(&spec.joints) {
                prop_assert!(*target >= joint.lower && *target <= joint.upper, "{} {target}", joint.name);
            }
            let (inertial, base) = pipeline.velocity();
            let memory = [inertial, base, pipeline.commanded(), pipeline.desired(), [pipeline.heading(); 3]];
            prop_assert!(memory.as_flattened().iter().all(|x| x.is_finite()), "{memory:?}");
        }
        // After the storm the loop works as ever.
        let position = nominal(&spec);
        pipeline.observe(&spec, &standing(&position, [0.0; 3]), [0.1, 0.0, 0.0], &mut out);
        prop_assert!(out.iter().all(|x| x.is_finite()), "{out:?}");
    }

    #[test]
    fn increments_never_exceed_their_scale(actions in prop::collection::vec(prop::array::uniform10(0.0f32..=1.0), 1..40)) {
        let mut spec = biped();
        spec.action.torque_clamp = false;
        let mut pipeline = Pipeline::new(&spec).expect("valid");
        let mut targets = vec![0.0; 10];
        for action in actions {
            let before = pipeline.previous_target().to_vec();
            pipeline.decode(&spec, &action, &mut targets);
            for (target, before) in targets.iter().zip(&before) {
                prop_assert!((target - before).abs() <= 0.3 + 1e-6);
            }
        }
    }
}
