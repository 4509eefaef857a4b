//! Joints without contact: inertia, couplings, limits, friction, momentum.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Start};
use omniwalk_env::robot::{JointKind, Robot};

use crate::order::first_order;
use crate::robots::*;

/// Mean period of degree of freedom 0 over `periods` upward zero crossings.
fn period(engine: &mut impl Engine, drive: &Drive, dt: f64, periods: usize) -> f64 {
    let (mut crossings, mut before) = (Vec::new(), engine.joints().position[0]);
    for step in 1..1_000_000 {
        engine.step(drive);
        let now = engine.joints().position[0];
        if before < 0.0 && now >= 0.0 {
            crossings.push((f64::from(step) - now / (now - before)) * dt);
        }
        if crossings.len() > periods {
            break;
        }
        before = now;
    }
    (crossings[periods] - crossings[0]) / periods as f64
}

/// Asserts the period that `measured` finds at a step: off by no more than what halving the step changes of it, which is all of
/// what is left of an error of first order and three times that of second.
fn assert_period(measured: impl Fn(f64) -> f64, exact: f64, unknown: f64) {
    let [coarse, fine] = [1e-3, 5e-4].map(measured);
    let bound = (coarse - fine).abs() + unknown * exact;
    assert!(
        (fine - exact).abs() < bound,
        "period {fine} s, exact {exact} s, {bound} s known"
    );
}

/// The amplitude of 0.02 rad changes the period by 1 + 0.02^2 / 16, and by 11 / 3072 of its fourth power.
#[test]
fn pendulum_swings_with_the_period_of_its_inertia_and_armature() {
    for armature in [0.0, 0.1] {
        let (robot, amplitude) = (pendulum(), 0.02_f64);
        let mut model = nominal(&robot);
        model.joints[0].armature = armature;
        let mut start = Start::nominal(&robot);
        start.joints[0] = amplitude;
        let measured = |dt| period(&mut single(&robot, dt, &start, &model), &Drive::idle(1, 1), dt, 10);
        let small = TAU * ((PENDULUM_INERTIA + armature) / (2.0 * G * 0.3)).sqrt();
        let exact = small * (1.0 + amplitude.powi(2) / 16.0);
        assert_period(measured, exact, 11.0 / 3072.0 * amplitude.powi(4));
    }
}

/// Symplectic Euler under a constant force gives x = a t (t + dt) / 2, exactly.
#[test]
fn slider_on_a_tilted_axis_accelerates_by_force_gravity_and_armature() {
    let dt = 5e-3;
    let mut robot = pendulum();
    robot.joints[0].kind = JointKind::Prismatic;
    robot.joints[0].axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, 2.0, -2.0));
    let mut model = nominal(&robot);
    model.joints[0].armature = 0.5;
    let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
    let mut drive = servo(&robot, 1, 0.0, 0.0);
    drive.feed_forward[0] = 7.0;
    (0..100).for_each(|_| engine.step(&drive));
    let (mass, t) = (2.0, 100.0 * dt);
    let acceleration = (7.0 + mass * G * 2.0 / 3.0) / (mass + 0.5);
    let exact = acceleration * t * (t + dt) / 2.0;
    assert!((engine.joints().position[0] - exact).abs() < 1e-9);
    assert!((engine.joints().torque[0] - 7.0).abs() < 1e-9);
}

/// An implicit Euler step damps: v (1 + c dt / I)^-n, here compared with the same formula.
#[test]
fn viscous_friction_slows_a_wheel_exponentially() {
    let (robot, dt) = (pendulum(), 1e-3);
    let mut model = nominal(&robot);
    model.gravity = Vector3::zeros();
    model.joints[0].damping = 0.4;
    let mut start = Start::nominal(&robot);
    start.joint_velocities[0] = 3.0;
    let mut engine = single(&robot, dt, &start, &model);
    (0..500).for_each(|_| engine.step(&Drive::idle(1, 1)));
    let exact = 3.0 * (1.0 + 0.4 * dt / PENDULUM_INERTIA).powi(-500);
    assert!((engine.joints().velocity[0] / exact - 1.0).abs() < 1e-6);
}

/// A follower with multiplier m adds m^2 times its inertia: w = sqrt(k / (I + m^2 I)).
#[test]
fn coupling_holds_and_adds_the_followers_inertia() {
    for (multiplier, offset) in [(-1.0, 0.0), (0.5, 0.3), (-2.0, 0.1)] {
        for armature in [0.0, 0.05] {
            let (robot, stiffness) = (coupled(multiplier, offset), 4.0);
            let mut model = nominal(&robot);
            model.gravity = Vector3::zeros();
            model.joints[0].armature = armature;
            let mut start = Start::nominal(&robot);
            start.joints[0] = 0.2;
            let measured = |dt| {
                let mut engine = single(&robot, dt, &start, &model);
                let period = period(&mut engine, &servo(&robot, 1, stiffness, 0.0), dt, 3);
                let q = engine.joints().position[0];
                let follower = engine.link_pose(0, 2).rotation.euler_angles().1;
                // Exact in coordinates; the pose of the link rounds.
                assert!((follower - (multiplier * q + offset)).abs() < 16.0 * f64::EPSILON);
                period
            };
            let arm = 0.01 + 0.2 * 0.2;
            let exact = TAU * ((arm + armature + multiplier * multiplier * arm) / stiffness).sqrt();
            assert_period(measured, exact, 0.0);
        }
    }
}

/// A joint that arrives with speed v passes its limit by at most v dt; then it rests there against the torque, but for what that
/// moves the joint in a step before the limit answers.
#[test]
fn joint_limits_hold_against_torque() {
    for dt in [1e-3, 5e-3] {
        let mut robot = pendulum();
        robot.joints[0].limits = (-0.4, 0.5);
        let mut engine = single(&robot, dt, &Start::nominal(&robot), &nominal(&robot));
        let mut drive = servo(&robot, 1, 0.0, 0.0);
        let torque = 20.0;
        drive.feed_forward[0] = torque;
        let (mut highest, mut fastest) = (0.0f64, 0.0f64);
        for _ in 0..(2.0 / dt) as usize {
            engine.step(&drive);
            highest = highest.max(engine.joints().position[0]);
            fastest = fastest.max(engine.joints().velocity[0]);
        }
        assert!(highest <= 0.5 + fastest * dt, "{highest} rad at {dt} s");
        let moved = torque / PENDULUM_INERTIA * dt * dt;
        assert!((engine.joints().position[0] - 0.5).abs() < moved);
    }
}

/// 4 N m of friction against 3 N m; rows that start cold each step leave a creep, stated as 1 mrad/s.
#[test]
fn dry_friction_holds_a_joint_and_slows_it_when_it_slips() {
    for dt in [1e-3, 5e-3] {
        let robot = pendulum();
        let mut model = nominal(&robot);
        model.gravity = Vector3::zeros();
        let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
        let mut drive = servo(&robot, 1, 0.0, 0.0);
        drive.friction[0] = 4.0;
        drive.feed_forward[0] = 3.0;
        let steps = (1.0 / dt) as usize;
        (0..steps).for_each(|_| engine.step(&drive));
        assert!(engine.joints().position[0].abs() < 1e-3);
        drive.feed_forward[0] = 6.0;
        let before = engine.joints().velocity[0];
        (0..steps).for_each(|_| engine.step(&drive));
        let gained = engine.joints().velocity[0] - before;
        assert!(
            (gained * PENDULUM_INERTIA / (6.0 - 4.0) - 1.0).abs() < 1e-3,
            "gained {gained} rad/s"
        );
    }
}

/// Total linear momentum and angular momentum about the origin over one step, from the links' poses alone.
fn momentum(engine: &mut Rapier, robot: &Robot, drive: &Drive, dt: f64) -> (Vector3<f64>, Vector3<f64>) {
    let poses = |engine: &Rapier| {
        (0..robot.links.len())
            .map(|l| engine.link_pose(0, l))
            .collect::<Vec<_>>()
    };
    let before = poses(engine);
    engine.step(drive);
    let after = poses(engine);
    let (mut linear, mut angular) = (Vector3::zeros(), Vector3::zeros());
    for ((a, b), link) in before.iter().zip(&after).zip(&robot.links) {
        let com = Point3::from(link.inertial.com);
        let velocity = (b * com - a * com) / dt;
        let turn = (b.rotation * a.rotation.inverse()).scaled_axis() / dt;
        let rotation = b.rotation.to_rotation_matrix();
        let inertia = rotation * link.inertial.inertia * rotation.inverse();
        linear += link.inertial.mass * velocity;
        angular += link.inertial.mass * (b * com).coords.cross(&velocity) + inertia * turn;
    }
    (linear, angular)
}

/// Nothing outside acts: what the integration does to both momenta is of first order in the step.
#[test]
fn momentum_is_kept_in_free_flight() {
    let robot = biped();
    let mut model = nominal(&robot);
    model.gravity = Vector3::zeros();
    let mut start = Start::nominal(&robot);
    start.position.z = 5.0;
    start.linear_velocity = Vector3::new(0.3, -0.2, 0.1);
    start.angular_velocity = Vector3::new(0.5, 1.0, -0.7);
    let drift = |dt: f64| {
        let mut engine = single(&robot, dt, &start, &model);
        let mut drive = servo(&robot, 1, 100.0, 1.0);
        drive
            .target
            .iter_mut()
            .enumerate()
            .for_each(|(i, q)| *q = 0.2 * (i as f64).sin());
        let (linear, angular) = momentum(&mut engine, &robot, &drive, dt);
        (0..(0.5 / dt) as usize).for_each(|_| engine.step(&drive));
        let (linear_after, angular_after) = momentum(&mut engine, &robot, &drive, dt);
        [linear_after - linear, angular_after - angular].map(|change| change.as_slice().to_vec())
    };
    let drifts = [2e-3, 1e-3, 5e-4].map(drift);
    for (i, name) in ["linear", "angular"].into_iter().enumerate() {
        first_order(name, &drifts.each_ref().map(|drift| drift[i].clone()));
    }
}
