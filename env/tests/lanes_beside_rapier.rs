//! The lanes engine does what the engine of record does: they differ in proportion to the step.

#[path = "support/order.rs"]
mod order;

use std::path::Path;
use std::sync::Arc;

use nalgebra::{IsometryMatrix3, UnitQuaternion, Vector3};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Friction, GRAVITY, Start, World};
use omniwalk_env::ground::{CELLS, Field, Ground};
use omniwalk_env::robot::{self, Base, Robot};
use order::{Motion, agree, distance};

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

/// Joint positions at multiples of 20 ms.
fn motion(engine: &mut dyn Engine, robot: &Robot, amplitude: f64, dt: f64, seconds: f64, start: &Start) -> Motion {
    engine.reset(0, start, &world(robot));
    let mut samples = vec![];
    let every = (0.02 / dt).round() as usize;
    for step in 0..(seconds / dt).round() as usize {
        engine.step(&chirp(robot, amplitude, step as f64 * dt));
        if (step + 1) % every == 0 {
            samples.extend_from_slice(&engine.joints().position);
        }
    }
    samples
}

fn in_lanes(robot: &Robot, level: Simd, amplitude: f64, dt: f64, seconds: f64, start: &Start) -> Motion {
    let mut engine = Lanes::new(robot, dt, 1, level).expect("available");
    motion(&mut engine, robot, amplitude, dt, seconds, start)
}

fn in_rapier(robot: &Robot, amplitude: f64, dt: f64, seconds: f64, start: &Start) -> Motion {
    let mut engine = Rapier::new(robot, dt, 1).expect("rapier takes the robot");
    motion(&mut engine, robot, amplitude, dt, seconds, start)
}

#[test]
fn chirped_robot_on_a_stand_differs_from_rapier_in_proportion_to_the_step() {
    let (robot, seconds, amplitude) = (on_a_stand(), 0.6, 0.15);
    let start = Start::nominal(&robot);
    agree(&[0.002, 0.001, 0.0005].map(|dt| {
        let lanes = in_lanes(&robot, Simd::Scalar, amplitude, dt, seconds, &start);
        [lanes, in_rapier(&robot, amplitude, dt, seconds, &start)]
    }));
}

/// Rounding errors of a step: a joint's position and velocity are sums that are rounded a few times on their way.
const ROUNDINGS: f64 = 8.0;

/// Every step rounds, and what a step has rounded away the motion carries on as it does a start that is off. How much it makes of
/// that a start off by a millionth of a radian shows.
#[test]
fn every_level_follows_the_scalar_one_within_its_precision() {
    let (robot, dt, seconds, off) = (on_a_stand(), 0.005, 1.0, 1e-6);
    let begin = Start::nominal(&robot);
    let mut moved = begin.clone();
    moved.joints.iter_mut().for_each(|q| *q += off);
    let run = |level, start| in_lanes(&robot, level, 0.15, dt, seconds, start);
    let exact = run(Simd::Scalar, &begin);
    let growth = distance(&run(Simd::Scalar, &moved), &exact) / off;
    for level in Simd::ALL.into_iter().filter(|level| level.is_available()) {
        let epsilon = if level.name().starts_with("f32") {
            f64::from(f32::EPSILON)
        } else {
            f64::EPSILON
        };
        let bound = growth * ROUNDINGS * epsilon * (seconds / dt);
        let error = distance(&run(level, &begin), &exact);
        assert!(error <= bound, "{}: {error} rad, {bound} rad by rounding", level.name());
    }
}

/// A height field of 10 cm cells that rises forward by `angle`.
fn rising(angle: f64) -> Ground {
    let height = |i: usize| angle.tan() * 0.1 * (i as f64 - 0.5 * CELLS as f64);
    Ground::Field(Arc::new(Field {
        cell: 0.1,
        heights: (0..=CELLS).flat_map(|i| [height(i); CELLS + 1]).collect(),
    }))
}

/// A robot at rest: its base from its left ankle, and the mean ground force.
struct Rest {
    position: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
    /// The left ankle, m.
    ankle: Vector3<f64>,
    force: Vector3<f64>,
    /// Share of the left foot.
    left: f64,
    /// Distance of the ankles, m.
    stance: f64,
    /// By how much the base's velocity has changed during the mean, m/s.
    change: f64,
}

/// Over which forces are averaged, s.
const MEAN: f64 = 0.5;

/// After 4 s on `ground`, from standing at right angles to it.
fn stood(engine: &mut dyn Engine, ground: &Ground, robot: &Robot, dt: f64) -> Rest {
    let mut start = Start::nominal(robot);
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &ground.at(0.0, 0.0).normal());
    start.orientation = turn.expect("not upside down");
    start.position = start.orientation * start.position;
    engine.reset(0, &start, &world(robot));
    let drive = chirp(robot, 0.0, 0.0);
    for _ in 0..((4.0 - MEAN) / dt) as usize {
        engine.step(&drive);
    }
    let (mut feet, before, steps) = ([Vector3::zeros(); 2], engine.base(0), (MEAN / dt) as usize);
    for _ in 0..steps {
        engine.step(&drive);
        for (f, force) in feet.iter_mut().enumerate() {
            *force += engine.foot_force(0, f) / steps as f64;
        }
    }
    let force = feet[0] + feet[1];
    let base = engine.base(0);
    let mut ankles = [IsometryMatrix3::identity(); 2];
    engine.link_poses(&[robot.feet[0].link, robot.feet[1].link], &mut ankles);
    let [left, right] = ankles.map(|ankle| ankle.translation.vector);
    Rest {
        position: base.position - left,
        orientation: base.orientation,
        ankle: left,
        force,
        left: feet[0].z / force.z,
        stance: (left - right).norm(),
        change: (base.linear_velocity - before.linear_velocity).norm(),
    }
}

fn stood_in_lanes(ground: &Ground, robot: &Robot, dt: f64) -> Rest {
    let mut engine = Lanes::on(ground, robot, dt, 1, Simd::Scalar).expect("any processor");
    stood(&mut engine, ground, robot, dt)
}

fn stood_in_rapier(ground: &Ground, robot: &Robot, dt: f64) -> Rest {
    let mut engine = Rapier::on(ground, robot, dt, 1).expect("rapier takes the robot");
    stood(&mut engine, ground, robot, dt)
}

/// How deep an edge of a sole may be in either engine, m. In lanes the whole weight on its two points, 1e5 N/m each. In rapier
/// what it leaves alone, and what a contact of 30 Hz, its default, gives under gravity.
fn sinking(robot: &Robot) -> f64 {
    let in_lanes = robot.mass() * GRAVITY / 2e5;
    let in_rapier = 5e-4 + GRAVITY / (std::f64::consts::TAU * 30.0).powi(2);
    in_lanes + in_rapier
}

/// How far bases may be apart because the soles do not lie on the ground alike. A sole lies askew by at most the depth of one
/// edge over its shorter side; what that does to the base shows a ground that is steeper by as much.
fn askew(robot: &Robot, angle: f64, depth: f64, dt: f64) -> f64 {
    let side = 2.0 * robot.feet[0].half_extents[0].min(robot.feet[0].half_extents[1]);
    let tilt = depth / side;
    let even = stood_in_lanes(&Ground::Slope([angle.tan(), 0.0]), robot, dt);
    let along = stood_in_lanes(&Ground::Slope([(angle + tilt).tan(), 0.0]), robot, dt);
    let across = stood_in_lanes(&Ground::Slope([angle.tan(), tilt.tan()]), robot, dt);
    (along.position - even.position).norm() + (across.position - even.position).norm()
}

/// Asserts that the mean force is the weight, but for the momentum that the robot has gained meanwhile.
fn assert_carried(name: &str, rest: &Rest, weight: f64) {
    let off = (rest.force - Vector3::z() * weight).norm() / weight;
    let momentum = rest.change / (MEAN * GRAVITY);
    assert!(off < 1e-3 + momentum, "{name}: {} N of {weight} N", rest.force);
}

#[test]
fn standing_robot_carries_its_weight_as_in_rapier() {
    let (robot, dt) = (nimbro(), 0.002);
    let engines = [stood_in_lanes, stood_in_rapier];
    let [lanes, rapier] = engines.map(|stood| stood(&Ground::Plane, &robot, dt));
    assert_carried("lanes", &lanes, robot.mass() * GRAVITY);
    assert_carried("rapier", &rapier, robot.mass() * GRAVITY);
    // In rapier soles that begin flat on the ground stay flat. In lanes a sole that lies on all its points has none that carries
    // more than twice its share, 1e5 N/m each, and this robot and its pose are mirror images: it lies askew forward alone.
    let depth = 2.0 * robot.mass() * GRAVITY / 8.0 / 1e5;
    let tilt = depth / (2.0 * robot.feet[0].half_extents[0]);
    let tilted = stood_in_lanes(&Ground::Slope([tilt.tan(), 0.0]), &robot, dt);
    let bound = (tilted.position - lanes.position).norm();
    let apart = (lanes.position - rapier.position).norm();
    assert!(apart < bound, "{apart} m apart, {bound} m by soles askew");
    let most = tilted.orientation.angle_to(&lanes.orientation);
    let turned = lanes.orientation.angle_to(&rapier.orientation);
    assert!(turned < most, "{turned} rad apart, {most} rad by soles askew");
    let (stepped, sunk) = ((lanes.ankle - rapier.ankle).norm(), sinking(&robot));
    assert!(stepped < sunk, "ankles {stepped} m apart, {sunk} m by soles that give");
    // A base that is aside by the distance of the ankles has moved all its weight from one foot to the other.
    let (shares, bound) = ((lanes.left - rapier.left).abs(), bound / lanes.stance);
    assert!(shares < bound, "shares {shares} apart, {bound} by soles askew");
}

#[test]
fn robot_stands_on_a_slope_as_in_rapier_whether_it_is_a_plane_or_a_height_field() {
    let robot = nimbro();
    let (angle, dt) = (5.0_f64.to_radians(), 0.002);
    let weight = robot.mass() * GRAVITY;
    let bound = askew(&robot, angle, sinking(&robot), dt);
    let mut found = vec![];
    for ground in [Ground::Slope([angle.tan(), 0.0]), rising(angle)] {
        let (lanes, rapier) = (
            stood_in_lanes(&ground, &robot, dt),
            stood_in_rapier(&ground, &robot, dt),
        );
        for (name, own) in [("lanes", &lanes), ("rapier", &rapier)] {
            assert_carried(name, own, weight);
        }
        let apart = (lanes.position - rapier.position).norm();
        assert!(apart < bound, "{apart} m apart, {bound} m by soles askew");
        found.push((lanes, rapier));
    }
    let [plane, field] = &found[..] else {
        unreachable!("two grounds")
    };
    // The same surface, but rounded otherwise: where soles come to stick may differ by what they may lie askew.
    for (name, on_plane, on_field) in [("lanes", &plane.0, &field.0), ("rapier", &plane.1, &field.1)] {
        let apart = (on_plane.position - on_field.position).norm();
        assert!(
            apart < bound,
            "{name} on plane and field: {apart} m, {bound} m by soles askew"
        );
    }
}
