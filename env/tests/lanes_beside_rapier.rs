//! The lanes engine does what the engine of record does: they differ in proportion to the step.

use std::path::Path;

use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Friction, GRAVITY, Start, World};
use omniwalk_env::robot::{self, Base, Robot};

fn nimbro() -> Robot {
    robot::load(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/nimbro_op2x"))).expect("the robot loads")
}

/// The NimbRo-OP2X on a stand: a fixed base above the ground.
fn on_a_stand() -> Robot {
    let mut robot = nimbro();
    robot.base = Base::Fixed;
    robot.base_pose.translation.vector.z += 1.0;
    robot
}

fn world(robot: &Robot) -> World {
    let friction = Friction {
        tangential: 0.7,
        torsional: 0.01,
        rolling: 0.005,
    };
    World::nominal(robot, friction)
}

/// Actuators track a chirp about the nominal pose.
fn chirp(robot: &Robot, amplitude: f64, time: f64) -> Drive {
    let mut drive = Drive::idle(robot.dofs.len(), 1);
    for d in 0..robot.dofs.len() {
        let joint = robot.dof(d);
        let Some(actuator) = joint.actuator else { continue };
        let phase = (3.0 + 6.0 * time) * time + d as f64;
        drive.target[d] = joint.nominal + amplitude * (phase.sin() - (d as f64).sin());
        drive.stiffness[d] = actuator.kp;
        drive.damping[d] = actuator.kd;
        drive.torque_min[d] = -actuator.torque_limit;
        drive.torque_max[d] = actuator.torque_limit;
    }
    drive
}

/// Joint positions of both engines at multiples of 20 ms.
fn trajectories(robot: &Robot, level: Simd, amplitude: f64, dt: f64, seconds: f64) -> [Vec<Vec<f64>>; 2] {
    let mut lanes = Lanes::new(robot, dt, 1, level).expect("available");
    let mut rapier = Rapier::new(robot, dt, 1).expect("rapier takes the robot");
    let engines: [&mut dyn Engine; 2] = [&mut lanes, &mut rapier];
    engines.map(|engine| {
        engine.reset(0, &Start::nominal(robot), &world(robot));
        let mut samples = vec![];
        let every = (0.02 / dt).round() as usize;
        for step in 0..(seconds / dt).round() as usize {
            engine.step(&chirp(robot, amplitude, step as f64 * dt));
            if (step + 1) % every == 0 {
                samples.push(engine.joints().position.clone());
            }
        }
        samples
    })
}

/// Largest distance of two trajectories.
fn distance(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    a.iter()
        .flatten()
        .zip(b.iter().flatten())
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

#[test]
fn chirped_robot_on_a_stand_differs_from_rapier_in_proportion_to_the_step() {
    let robot = on_a_stand();
    let [coarse, fine] = [0.002, 0.001].map(|dt| {
        let [lanes, rapier] = trajectories(&robot, Simd::Scalar, 0.15, dt, 0.6);
        distance(&lanes, &rapier)
    });
    assert!(coarse < 0.02, "{coarse} rad at 2 ms");
    assert!(fine < 0.65 * coarse, "{coarse} rad at 2 ms, {fine} rad at 1 ms");
}

#[test]
fn every_level_follows_the_scalar_one_within_single_precision() {
    let robot = on_a_stand();
    let [exact, _] = trajectories(&robot, Simd::Scalar, 0.15, 0.005, 1.0);
    for level in Simd::ALL.into_iter().filter(|level| level.is_available()) {
        let [own, _] = trajectories(&robot, level, 0.15, 0.005, 1.0);
        let error = distance(&own, &exact);
        let bound = if level.name().starts_with("f32") { 2e-4 } else { 1e-9 };
        assert!(error < bound, "{}: {error} rad", level.name());
    }
}

#[test]
fn standing_robot_carries_its_weight_as_in_rapier() {
    let robot = nimbro();
    let mut lanes = Lanes::new(&robot, 0.002, 1, Simd::detect()).expect("available");
    let mut rapier = Rapier::new(&robot, 0.002, 1).expect("rapier takes the robot");
    let engines: [&mut dyn Engine; 2] = [&mut lanes, &mut rapier];
    let [a, b] = engines.map(|engine| {
        engine.reset(0, &Start::nominal(&robot), &world(&robot));
        for _ in 0..2000 {
            engine.step(&chirp(&robot, 0.0, 0.0));
        }
        (engine.base(0), engine.foot_force(0, 0).z, engine.foot_force(0, 1).z)
    });
    let weight = robot.mass() * GRAVITY;
    assert!(
        (a.1 + a.2 - weight).abs() < 1e-3 * weight,
        "{} N of {weight} N",
        a.1 + a.2
    );
    assert!(
        (a.1 - b.1).abs() < 0.02 * weight,
        "left foot {} N, in rapier {} N",
        a.1,
        b.1
    );
    // The soles give by 0.2 mm on points, not at all in rapier.
    assert!(
        (a.0.position - b.0.position).norm() < 2e-3,
        "{} and {}",
        a.0.position,
        b.0.position
    );
    assert!(a.0.orientation.angle_to(&b.0.orientation) < 2e-3);
}
