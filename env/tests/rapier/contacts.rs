//! Contact with the ground: weight, friction, symmetry.

use nalgebra::{UnitQuaternion, Vector3};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Start};
use omniwalk_env::robot::Robot;

use crate::robots::*;

/// Lets a robot settle for `seconds` under `drive`.
fn run(engine: &mut Rapier, drive: &Drive, dt: f64, seconds: f64) {
    (0..(seconds / dt).round() as usize).for_each(|_| engine.step(drive));
}

fn standing_drive(robot: &Robot) -> Drive {
    servo(robot, 1, 300.0, 3.0)
}

#[test]
fn weight_equals_contact_force_when_standing() {
    let robot = biped();
    for dt in [1e-3, 2.5e-3, 5e-3] {
        let mut engine = single(&robot, dt, &Start::nominal(&robot), &nominal(&robot));
        let drive = standing_drive(&robot);
        run(&mut engine, &drive, dt, 9.0);
        let (mut force, before, steps) = (Vector3::zeros(), engine.base(0), (1.0 / dt) as usize);
        for _ in 0..steps {
            engine.step(&drive);
            force += (engine.foot_force(0, 0) + engine.foot_force(0, 1)) / steps as f64;
        }
        let (weight, base) = (robot.mass() * G, engine.base(0));
        // What it has gained of momentum in this second comes on top.
        let momentum = (base.linear_velocity - before.linear_velocity).norm() / G;
        assert!(
            (force - Vector3::new(0.0, 0.0, weight)).norm() < (1e-3 + momentum) * weight,
            "{force} N at {dt} s"
        );
        let tilt = base.orientation.angle();
        assert!(
            base.position.z > 0.68 && tilt < 0.05,
            "{} m, {tilt} rad at {dt} s",
            base.position.z
        );
    }
}

/// v^2 / (2 mu g); a step moves the end by at most v dt, and rapier's sweeps change friction by little.
#[test]
fn sliding_box_stops_after_the_distance_of_coulomb() {
    let robot = sled();
    for (mu, dt) in [(0.3, 1e-3), (0.8, 1e-3), (0.5, 5e-3)] {
        let mut model = nominal(&robot);
        model.friction.tangential = mu;
        let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
        let drive = Drive::idle(1, 1);
        run(&mut engine, &drive, dt, 0.5);
        let settled = engine.base(0).position;
        let mut start = Start::nominal(&robot);
        start.position.z = settled.z;
        start.linear_velocity = Vector3::new(1.2, -0.9, 0.0);
        engine.reset(0, &start, &model);
        run(&mut engine, &drive, dt, 2.0);
        let travelled = engine.base(0).position - start.position;
        let exact = 1.5f64.powi(2) / (2.0 * mu * G);
        assert!(
            (travelled.norm() - exact).abs() < 0.01 * exact + 1.5 * dt,
            "{travelled} m, exact {exact} m"
        );
        assert!(engine.base(0).linear_velocity.norm() < 1e-3);
    }
}

/// Without tangential friction only the torsional one slows a spinning box: w0 - mu N t / I, then rest.
#[test]
fn torsional_friction_stops_a_spinning_box_at_its_rate() {
    let robot = sled();
    let (dt, torsional, speed) = (1e-3, 0.02, 5.0);
    let mut model = nominal(&robot);
    model.friction.tangential = 0.0;
    model.friction.torsional = torsional;
    let mut start = Start::nominal(&robot);
    start.angular_velocity.z = speed;
    let mut engine = single(&robot, dt, &start, &model);
    let inertia = robot.links[0].inertial.inertia[(2, 2)];
    let rate = torsional * robot.mass() * G / inertia;
    let half = 0.5 * speed / rate;
    run(&mut engine, &Drive::idle(1, 1), dt, half);
    let spin = engine.base(0).angular_velocity.z;
    assert!((spin - 0.5 * speed).abs() < 0.01 * speed + rate * dt, "{spin} rad/s");
    run(&mut engine, &Drive::idle(1, 1), dt, 1.5 * half);
    assert!(engine.base(0).angular_velocity.z.abs() < 1e-3);
}

/// A torque about the vertical on a box without tangential friction: below the limit the box holds within the spring
/// that sticking is (5 dt^2 torque / I), above it turns with what is left, (torque - limit) / I.
#[test]
fn torsional_friction_holds_a_torque_below_its_limit_and_no_more() {
    let robot = sled();
    let (torsional, inertia) = (0.1, robot.links[0].inertial.inertia[(2, 2)]);
    let limit = torsional * robot.mass() * G;
    for dt in [1e-3, 5e-3] {
        let turned = |torque: f64, seconds: f64| {
            let mut model = nominal(&robot);
            model.friction.tangential = 0.0;
            model.friction.torsional = torsional;
            model.links[1].inertia *= 1e9;
            let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
            let mut drive = Drive::idle(1, 1);
            run(&mut engine, &drive, dt, 0.5);
            drive.feed_forward[0] = -torque;
            (drive.torque_min[0], drive.torque_max[0]) = (-torque, torque);
            run(&mut engine, &drive, dt, seconds);
            (
                engine.base(0).orientation.scaled_axis().z,
                engine.base(0).angular_velocity.z,
            )
        };
        let (angle, speed) = turned(0.5 * limit, 1.0);
        let spring = 5.0 * dt * dt * 0.5 * limit / inertia;
        assert!(
            (angle - spring).abs() < 0.1 * spring && speed.abs() < 1e-6,
            "{angle} rad, {speed} rad/s at {dt} s"
        );
        // Friction answers a step late: by then the whole torque has acted once.
        let (_, speed) = turned(1.5 * limit, 0.2);
        let exact = 0.5 * limit / inertia * 0.2;
        let late = 1.5 * limit / inertia * dt;
        assert!((speed - exact).abs() < late, "{speed} rad/s, exact {exact} at {dt} s");
    }
}

/// Sliding and spinning at once: there is no cone that both share. The ball is braked by the whole of tangential friction and the
/// whole of torsional friction, each as if it were alone; what a step does before the normal force of the last one is known is
/// what each does in a step.
#[test]
fn friction_of_a_ball_that_slides_and_spins_is_two_separate_clamps() {
    let robot = ball();
    let (dt, mu, torsional) = (1e-3, 0.4, 0.005);
    let mut model = nominal(&robot);
    (model.friction.tangential, model.friction.torsional) = (mu, torsional);
    let mut start = Start::nominal(&robot);
    start.linear_velocity.x = 2.0;
    start.angular_velocity.z = 8.0;
    let mut engine = single(&robot, dt, &start, &model);
    run(&mut engine, &Drive::idle(1, 1), dt, 0.5);
    let resting = engine.base(0).position.z;
    start.position.z = resting;
    engine.reset(0, &start, &model);
    // It rolls without slip at v / (1 + 5 / 2) less: after 0.15 s.
    let seconds = 0.1;
    run(&mut engine, &Drive::idle(1, 1), dt, seconds);
    let (mass, inertia) = (robot.mass(), robot.links[0].inertial.inertia[(2, 2)]);
    let rates = [mu * G, torsional * mass * G / inertia];
    let base = engine.base(0);
    let lost = [2.0 - base.linear_velocity.x, 8.0 - base.angular_velocity.z];
    for (lost, rate) in lost.into_iter().zip(rates) {
        assert!(
            (lost - rate * seconds).abs() < 2.0 * rate * dt,
            "lost {lost}, {} alone",
            rate * seconds
        );
    }
}

/// A ball rolling without slip: (I + m r^2) dw = -rolling m g dt.
#[test]
fn rolling_friction_slows_a_rolling_ball_at_its_rate() {
    let robot = ball();
    let (dt, rolling, speed) = (1e-3, 0.01, 8.0);
    let mut model = nominal(&robot);
    model.friction.rolling = rolling;
    let mut start = Start::nominal(&robot);
    start.angular_velocity.y = speed;
    start.linear_velocity.x = speed * 0.1;
    let mut engine = single(&robot, dt, &start, &model);
    let inertia = 0.4 * 0.01 + 0.01;
    let rate = rolling * robot.mass() * G / inertia;
    run(&mut engine, &Drive::idle(1, 1), dt, 0.5 * speed / rate);
    let spin = engine.base(0).angular_velocity.y;
    assert!((spin - 0.5 * speed).abs() < 0.02 * speed, "{spin} rad/s");
    run(&mut engine, &Drive::idle(1, 1), dt, speed / rate);
    assert!(engine.base(0).linear_velocity.norm() < 2e-3);
}

/// A ball that is pushed with a torque below rolling friction's limit creeps at the speed that its brake, inertia / dt,
/// answers with that torque: the inertia is what the ball feels through its axle's armature, not its own alone.
#[test]
fn rolling_friction_brakes_with_the_inertia_the_link_feels() {
    let (dt, radius, force) = (1e-3, 0.1, 2.0);
    for armature in [0.0, 0.02] {
        let mut robot = ball();
        robot.joints[0].axis = Vector3::y_axis();
        robot.joints[0].passive.armature = armature;
        let mut model = nominal(&robot);
        model.friction.rolling = 0.05;
        model.links[1].inertia *= 1e9;
        let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
        engine.push(0, Vector3::new(force, 0.0, 0.0));
        run(&mut engine, &Drive::idle(1, 1), dt, 0.5);
        let spin = engine.base(0).angular_velocity.y;
        let creep = force * radius * dt / (0.4 * radius * radius + armature);
        assert!(
            (spin - creep).abs() < 0.01 * creep,
            "{spin} rad/s, {creep} expected at {armature} kg m^2"
        );
    }
}

/// A sled at rest pushed below and above mu m g.
#[test]
fn push_at_the_base_moves_the_sled_only_beyond_friction() {
    let robot = sled();
    let (dt, mu) = (2.5e-3, 0.5);
    let mut model = nominal(&robot);
    model.friction.tangential = mu;
    let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
    let hold = mu * robot.mass() * G;
    run(&mut engine, &Drive::idle(1, 1), dt, 0.5);
    engine.push(0, Vector3::new(0.9 * hold, 0.0, 0.0));
    run(&mut engine, &Drive::idle(1, 1), dt, 1.0);
    assert!(engine.base(0).position.x.abs() < 5e-3);
    let before = engine.base(0).linear_velocity.x;
    engine.push(0, Vector3::new(1.5 * hold, 0.0, 0.0));
    run(&mut engine, &Drive::idle(1, 1), dt, 0.2);
    let gained = engine.base(0).linear_velocity.x - before;
    let exact = 0.5 * hold / robot.mass() * 0.2;
    assert!((gained / exact - 1.0).abs() < 0.03, "{gained} m/s, exact {exact} m/s");
    let ground = engine.foot_force(0, 0);
    assert!((ground.x / -hold - 1.0).abs() < 0.03, "{ground} N");
}

/// Slope: gravity tilted beyond the friction angle slides the box with g (sin - mu cos).
#[test]
fn tilted_gravity_slides_a_box_down_the_slope() {
    let robot = sled();
    let (dt, mu, angle) = (2.5e-3, 0.3, 0.5f64);
    let mut model = nominal(&robot);
    model.friction.tangential = mu;
    model.gravity = Vector3::new(G * angle.sin(), 0.0, -G * angle.cos());
    let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
    run(&mut engine, &Drive::idle(1, 1), dt, 0.5);
    let exact = G * (angle.sin() - mu * angle.cos()) * 0.5;
    assert!((engine.base(0).linear_velocity.x / exact - 1.0).abs() < 0.03);
}

fn mirrored(start: &Start) -> Start {
    let flip = |v: Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
    let q = start.orientation.quaternion();
    let side = |values: &[f64], d: usize| {
        if matches!(d % 4, 0 | 3) {
            -values[(d + 4) % 8]
        } else {
            values[(d + 4) % 8]
        }
    };
    Start {
        position: flip(start.position),
        orientation: UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.w, -q.i, q.j, -q.k)),
        linear_velocity: flip(start.linear_velocity),
        angular_velocity: -flip(start.angular_velocity),
        joints: (0..8).map(|d| side(&start.joints, d)).collect(),
        joint_velocities: (0..8).map(|d| side(&start.joint_velocities, d)).collect(),
    }
}

/// Gauss-Seidel visits left before right, so mirror images differ by what its sweeps leave of an impact; in the air
/// it is what they leave of the couplings.
#[test]
fn mirrored_start_gives_a_mirrored_motion() {
    let robot = biped();
    let dt = 2.5e-3;
    let mut start = Start::nominal(&robot);
    start.linear_velocity = Vector3::new(0.1, 0.15, 0.0);
    start.orientation = UnitQuaternion::from_euler_angles(0.03, 0.02, 0.05);
    start.joints = vec![0.05, -0.1, 0.15, 0.02, -0.03, -0.05, 0.1, 0.01];
    for (height, bound) in [(1.0, 1e-6), (0.0, 5e-3)] {
        start.position.z = robot.base_pose.translation.z + height;
        let drive = standing_drive(&robot);
        let mut original = single(&robot, dt, &start, &nominal(&robot));
        let mut image = single(&robot, dt, &mirrored(&start), &nominal(&robot));
        run(&mut original, &drive, dt, 0.4);
        run(&mut image, &drive, dt, 0.4);
        let (a, b) = (original.base(0).position, image.base(0).position);
        let difference = (a - Vector3::new(b.x, -b.y, b.z)).norm();
        assert!(difference < bound, "{difference} m from {height} m");
    }
}
