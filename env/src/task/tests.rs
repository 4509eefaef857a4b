//! The task's formulas beside what they give when they are worked out by hand.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use omniwalk_controller::ActionLaw;

use super::environment::{Asked, Environment, Scratch};
use super::gait::Sole;
use super::reward::Factors;
use super::shared::Shared;
use crate::actuators::Actuators;
use crate::config::{EngineKind, EnvConfig};
use crate::engine::{self, BaseState, Engine, GRAVITY, Start};
use crate::random::Stream;
use crate::robot::{self, Robot};
use crate::truth::Truth;

fn nimbro() -> Arc<Robot> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/nimbro_op2x");
    Arc::new(robot::load(&folder).unwrap_or_else(|error| panic!("{error}")))
}

/// The thesis's reward, action and termination, without anything random.
fn plain() -> EnvConfig {
    let mut config: EnvConfig = toml::from_str(include_str!("../../../configs/default.toml")).expect("the defaults");
    config.engine.kind = EngineKind::Rapier;
    config.action.law = ActionLaw::IncrementOnMeasured;
    config.action.scale = 0.1;
    config.action.torque_clamp = false;
    config.action.filter.enabled = false;
    config.clock.enabled = false;
    config.reward.clock_swing = false;
    config.reward.velocity_filter = 0.0;
    config.reward.commanded_heading = false;
    config.reward.slip_weight = 0.0;
    config.noise.enabled = false;
    config.latency.enabled = false;
    config.friction.enabled = false;
    config.randomise.pd_noise = 0.0;
    config.randomise.mass = 0.0;
    config.randomise.centre_of_mass = 0.0;
    config.randomise.start_position = 0.0;
    config.push.enabled = false;
    config
}

/// One environment at the beginning of an episode, with everything around it.
struct Stage {
    shared: Shared,
    engine: Box<dyn Engine>,
    actuators: Actuators,
    environment: Environment,
}

impl Stage {
    fn new(config: &EnvConfig) -> Self {
        let shared = Shared::new(nimbro(), config, 1).expect("a humanoid");
        let mut engine = engine::build(&shared.robot, &shared.ground, config, 1).expect("an engine");
        let mut actuators = Actuators::new(&shared.robot, config.physics_dt(), 1);
        let mut environment = Environment::new(&shared, 0).expect("a layout");
        let mut observation = vec![0.0; shared.spec.observation_len()];
        let mut scratch = Scratch::new(&shared);
        environment.reset(&shared, &mut *engine, &mut actuators, 0, &mut scratch, &mut observation);
        Self {
            shared,
            engine,
            actuators,
            environment,
        }
    }

    /// Acts and gives the actuators' targets in the policy's order.
    fn targets(&mut self, action: &[f32]) -> Vec<f64> {
        let Self {
            shared,
            engine,
            actuators,
            environment,
        } = self;
        environment.act(shared, &mut **engine, actuators, 0, action, 0.0);
        let target = |joint: &super::shared::PolicyJoint| actuators.target(joint.dof, 0);
        shared.joints.iter().map(target).collect()
    }
}

/// A base at the height `z` (m), turned from upright by `rotation`, moving at `velocity` (m/s, world frame) and turning at
/// `turn` (rad/s) about the vertical.
fn truth(z: f64, rotation: UnitQuaternion<f64>, velocity: [f64; 3], turn: f64) -> Truth {
    Truth::new(&BaseState {
        position: Vector3::new(0.0, 0.0, z),
        orientation: rotation,
        linear_velocity: Vector3::from(velocity),
        angular_velocity: Vector3::new(0.0, 0.0, turn),
    })
}

#[test]
fn the_reward_of_a_step_is_weight_times_factor_times_kernel_times_the_duration_of_the_step() {
    let mut config = plain();
    config.reward.velocity_weight = 42.0;
    config.reward.velocity_kernel = 9.0;
    config.reward.action_rate_weight = 2.0;
    let mut stage = Stage::new(&config);
    let robot = stage.shared.robot.clone();
    // Two joints away from the nominal pose by 0.1 and 0.2 rad: equation 7.10 has the error sqrt(0.05).
    let mut start = Start::nominal(&robot);
    start.joints[robot.policy[0]] += 0.1;
    start.joints[robot.policy[3]] += 0.2;
    let world = stage.shared.nominal.clone();
    stage.engine.reset(0, &start, &world);
    let environment = &mut stage.environment;
    environment.asked = Asked {
        commanded: [0.4, 0.0, 0.1],
        desired: [0.4, 0.0, 0.1],
    };
    environment.heading = [0.6, 0.8];
    environment.action_change = 0.3;
    // The left foot swings, 3 cm up and rolled by 0.1 rad; the right one stands 2 mm off the ground, rolled by -0.05 rad.
    let sole = |z: f64, roll: f64| Sole {
        centre: [0.0, 0.0, z],
        lowest: z,
        roll,
    };
    environment.soles = vec![sole(0.03, 0.1), sole(0.002, -0.05)];
    let truth = truth(0.8, UnitQuaternion::identity(), [0.3, 0.1, 0.0], 0.2);
    let factors = Factors {
        velocity: 0.5,
        foot: 0.25,
        push: 1.0,
    };
    let terms = environment.judge(&stage.shared, &*stage.engine, 0, &truth, true, factors);
    let near = |value: f64, by_hand: f64| assert!((value - by_hand).abs() < 1e-12, "{value} is not {by_hand}");
    // Equation 7.9: (0.3, 0.1) in the base's frame is (0.26, -0.18) along the heading (0.6, 0.8), so that the errors are 0.1,
    // -0.1, 0.14, 0.18 and -0.1: e_v = sqrt(0.082), K(e_v | 9) = 0.151099..., times 42, 0.5 and 0.025 s.
    near(terms.velocity, 0.079_327_147_013_365_07);
    // K(sqrt(0.05) | 3) = 0.810658..., times 4 and 0.025 s.
    near(terms.pose, 0.081_065_848_285_254_3);
    near(terms.alive, 4.0 * 0.025);
    // Equation 7.12 with 4 rad per m: 4 (0.05 - 0.03) = 0.08, 0.1, -0.05 and 4 0.002 = 0.008, e_foot = 0.137709...,
    // K(e_foot | 10) = 0.474417..., times 18, 0.25 and 0.025 s.
    near(terms.foot, 0.053_371_990_674_504_835);
    near(terms.action_rate, -2.0 * 0.3 * 0.025);
    let fallen = environment.judge(&stage.shared, &*stage.engine, 0, &truth, false, factors);
    assert_eq!(fallen.alive, 0.0);
}

#[test]
fn pose_joints_are_named_by_patterns_with_any_number_of_stars() {
    let mut config = plain();
    config.reward.pose_joints = vec!["*_hip_*".into()];
    let shared = Shared::new(nimbro(), &config, 1).expect("a humanoid");
    let named = |&i: &usize| shared.robot.policy_joint(i).name.contains("_hip_");
    assert_eq!(shared.pose_joints.len(), 6);
    assert!(shared.pose_joints.iter().all(named));
}

#[test]
fn a_robot_has_fallen_below_its_height_and_beyond_its_roll_and_pitch_and_not_before() {
    let mut config = plain();
    (config.task.min_height, config.task.max_roll, config.task.max_pitch) = (0.7, 0.6, 0.5);
    let shared = Shared::new(nimbro(), &config, 1).expect("a humanoid");
    let nominal = shared.robot.base_pose.translation.z;
    let upright = UnitQuaternion::identity();
    let stands = |z: f64, rotation| shared.stands(&truth(z, rotation, [0.0; 3], 0.0));
    assert!(stands(0.701 * nominal, upright) && !stands(0.699 * nominal, upright));
    for sign in [1.0, -1.0] {
        let roll = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), sign * angle);
        let pitch = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), sign * angle);
        assert!(stands(nominal, roll(0.599)) && !stands(nominal, roll(0.601)));
        assert!(stands(nominal, pitch(0.499)) && !stands(nominal, pitch(0.501)));
        assert!(!stands(nominal, roll(std::f64::consts::PI)), "head down");
    }
}

#[test]
fn targets_are_the_position_plus_the_response_times_the_increment_within_the_limits() {
    let mut stage = Stage::new(&plain());
    let joints = stage.shared.joints.len();
    let position: Vec<f64> = stage.shared.joints.iter().map(|joint| joint.nominal).collect();
    stage.environment.response[0] = 1.1;
    stage.environment.response[3] = 0.9;
    // An action of 0.75 is half the half range of 0.1 rad.
    let targets = stage.targets(&vec![0.75; joints]);
    for (i, (&target, &position)) in targets.iter().zip(&position).enumerate() {
        let response = stage.environment.response[i];
        // Targets come in single precision, of magnitude 1 and less.
        let by_hand = position + response * 0.05;
        assert!(
            (target - by_hand).abs() < 2.0 * f64::from(f32::EPSILON),
            "{i}: {target} is not {by_hand}"
        );
    }
    let mut config = plain();
    config.action.scale = 3.0;
    let mut stage = Stage::new(&config);
    stage.environment.response.fill(1.5);
    let targets = stage.targets(&vec![1.0; joints]);
    for (target, joint) in targets.iter().zip(&stage.shared.joints) {
        assert_eq!(*target, joint.limits.1);
    }
}

/// Mean, smallest and largest.
fn spread(values: &[f64]) -> (f64, f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let (low, high) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
            (low.min(x), high.max(x))
        });
    (mean, low, high)
}

/// Asserts that `values` are uniform between `lower` and `upper` as far as so many can tell.
#[track_caller]
fn assert_uniform(values: &[f64], lower: f64, upper: f64) {
    let (mean, low, high) = spread(values);
    let (n, width) = (values.len() as f64, upper - lower);
    assert!(
        lower <= low && high <= upper,
        "{low} to {high} is not within {lower} to {upper}"
    );
    // The mean of n uniform numbers deviates by width / sqrt(12 n); that an end of 20 / n is not reached has the
    // probability e^-20.
    assert!(
        (mean - 0.5 * (lower + upper)).abs() < 5.0 * width / (12.0 * n).sqrt(),
        "mean {mean}"
    );
    let gap = 20.0 / n * width;
    assert!(
        low < lower + gap && high > upper - gap,
        "{low} to {high} does not fill {lower} to {upper}"
    );
}

#[test]
fn what_is_drawn_for_an_episode_fills_its_configured_range_uniformly() {
    let mut config = plain();
    config.friction.enabled = true;
    config.friction.tangential = [0.4, 0.8];
    config.friction.torsional = [0.1, 0.3];
    config.friction.rolling = [0.0, 0.2];
    config.randomise.mass = 0.1;
    config.randomise.centre_of_mass = 0.02;
    config.latency.enabled = true;
    (config.latency.lower, config.latency.upper, config.latency.jitter) = (0.01, 0.05, 0.02);
    let shared = Shared::new(nimbro(), &config, 1).expect("a humanoid");
    let mut stream = Stream::new(3, 0, 0);
    let mut world = shared.nominal.clone();
    let (mut friction, mut factors, mut shifts) = ([const { Vec::new() }; 3], vec![], vec![]);
    let (mut latencies, mut jitters) = (vec![], vec![]);
    for _ in 0..4000 {
        shared.draw_world(&mut stream, &mut world);
        let f = &world.friction;
        for (list, value) in friction.iter_mut().zip([f.tangential, f.torsional, f.rolling]) {
            list.push(value);
        }
        let (drawn, nominal) = (&world.links[1], &shared.nominal.links[1]);
        let factor = drawn.mass / nominal.mass;
        factors.push(factor);
        assert!((drawn.inertia - nominal.inertia * factor).norm() < 1e-12 && drawn.com == nominal.com);
        shifts.extend((world.links[0].com - shared.nominal.links[0].com).iter());
        latencies.push(shared.draw_latency(&mut stream));
        jitters.push(shared.draw_jitter(&mut stream));
    }
    assert_uniform(&friction[0], 0.4, 0.8);
    assert_uniform(&friction[1], 0.1, 0.3);
    assert_uniform(&friction[2], 0.0, 0.2);
    // A shift is a difference of numbers near 0.1, rounded to the last bit.
    assert_uniform(&factors, 0.9 - 1e-12, 1.1 + 1e-12);
    assert_uniform(&shifts, -0.02 - 1e-12, 0.02 + 1e-12);
    // In control steps of 25 ms.
    assert_uniform(&latencies, 0.4, 2.0);
    assert_uniform(&jitters, 0.0, 0.8);
    assert!((shared.longest_latency() - 2.8).abs() < 1e-12);
}

#[test]
fn the_response_of_each_joint_is_drawn_for_itself_at_each_episode() {
    let mut config = plain();
    config.randomise.pd_noise = 0.1;
    let mut stage = Stage::new(&config);
    let mut drawn = Vec::new();
    for _ in 0..400 {
        stage.environment.draw_episode(&stage.shared);
        drawn.extend(&stage.environment.response);
    }
    assert_uniform(&drawn, 0.9, 1.1);
    let mut different = drawn.clone();
    different.sort_by(f64::total_cmp);
    different.dedup();
    assert_eq!(different.len(), drawn.len());
}

#[test]
fn each_sensor_has_the_noise_it_is_configured_with() {
    let mut config = plain().noise;
    config.enabled = true;
    (config.gyro, config.accelerometer, config.position, config.velocity) = (0.1, 0.2, 0.3, 0.4);
    let upright = truth(0.8, UnitQuaternion::identity(), [0.0; 3], 0.0);
    let mut stream = Stream::new(4, 0, 0);
    let mut reading = crate::sensors::Reading::zero(1);
    let mut squares = [0.0; 4];
    let n = 20_000_u32;
    for _ in 0..n {
        reading.measure(&upright, std::iter::once((1.0, -2.0)), &config, &mut stream);
        let misses = [
            reading.gyro[1],
            reading.attitude[0],
            reading.position[0] - 1.0,
            reading.velocity[0] + 2.0,
        ];
        for (sum, miss) in squares.iter_mut().zip(misses) {
            *sum += f64::from(miss).powi(2);
        }
    }
    // An accelerometer that is off by a is a tilt of a over g.
    for (sum, expected) in squares.into_iter().zip([0.1, 0.2 / GRAVITY, 0.3, 0.4]) {
        let deviation = (sum / f64::from(n)).sqrt();
        // The deviation of n normal numbers itself deviates by its share 1 / sqrt(2 n).
        let allowed = 5.0 * expected / (2.0 * f64::from(n)).sqrt();
        assert!((deviation - expected).abs() < allowed, "{deviation} is not {expected}");
    }
}
