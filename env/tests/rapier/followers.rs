//! The limits of a joint that follows another, in both engines.

use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::{Drive, Engine, Start};
use omniwalk_env::robot::Robot;

use crate::robots::*;

/// Two arms of which the second follows and has limits, the first none.
fn limited(multiplier: f64, offset: f64) -> Robot {
    let mut robot = coupled(multiplier, offset);
    robot.joints[1].limits = (-0.3, 0.4);
    robot
}

/// Where the follower is at most beyond its limits, where it is at the end, and how fast it was: 2 s under a torque.
fn pushed(engine: &mut dyn Engine, robot: &Robot, torque: f64, dt: f64) -> [f64; 3] {
    let mimic = robot.joints[1].mimic.expect("a follower");
    let (lower, upper) = robot.joints[1].limits;
    let mut drive = Drive::idle(1, 1);
    drive.feed_forward[0] = torque;
    (drive.torque_min[0], drive.torque_max[0]) = (-torque.abs(), torque.abs());
    let (mut beyond, mut end, mut fastest) = (0.0_f64, 0.0, 0.0_f64);
    for _ in 0..(2.0 / dt) as usize {
        engine.step(&drive);
        end = mimic.multiplier * engine.joints().position[0] + mimic.offset;
        beyond = beyond.max(lower - end).max(end - upper);
        fastest = fastest.max((mimic.multiplier * engine.joints().velocity[0]).abs());
    }
    [beyond, end, fastest]
}

/// What the rounding of a position makes of another, relative to 1 rad: some few operations.
const ROUNDED: f64 = 16.0;

#[test]
fn a_follower_stops_at_its_own_limits_although_its_leader_has_none() {
    for (multiplier, offset) in [(-1.0, 0.0), (0.5, 0.3), (-2.0, 0.1)] {
        for dt in [1e-3, 5e-3] {
            let robot = limited(multiplier, offset);
            let world = nominal(&robot);
            for torque in [20.0, -20.0] {
                let limit = if torque * multiplier > 0.0 { 0.4 } else { -0.3 };
                for level in Simd::ALL.into_iter().filter(|level| level.is_available()) {
                    let mut lanes = Lanes::new(&robot, dt, 1, level).expect("available");
                    lanes.reset(0, &Start::nominal(&robot), &world);
                    let [beyond, end, _] = pushed(&mut lanes, &robot, torque, dt);
                    let single = level.name().starts_with("f32");
                    let epsilon = if single { f64::from(f32::EPSILON) } else { f64::EPSILON };
                    // A joint that is alone ends its step at the limit, however fast it came.
                    let name = format!("{} at {dt} s, multiplier {multiplier}", level.name());
                    assert!(beyond < ROUNDED * epsilon, "{name}: {beyond} rad beyond");
                    assert!(
                        (end - limit).abs() < ROUNDED * epsilon,
                        "{name}: {end} rad, limit {limit}"
                    );
                }
                // In rapier a limit answers once it is passed, and then to what moves the joint in a step.
                let mut rapier = single(&robot, dt, &Start::nominal(&robot), &world);
                let [beyond, end, fastest] = pushed(&mut rapier, &robot, torque, dt);
                let inertia = (0.01 + 0.2 * 0.2) * (1.0 + multiplier * multiplier);
                let weight = 0.2 * G * (1.0 + multiplier.abs());
                let moved = multiplier.abs() * (torque.abs() + weight) / inertia * dt * dt;
                let name = format!("rapier at {dt} s, multiplier {multiplier}");
                assert!(beyond <= fastest * dt, "{name}: {beyond} rad beyond, {fastest} rad/s");
                assert!((end - limit).abs() < moved, "{name}: {end} rad, limit {limit}");
            }
        }
    }
}

#[test]
fn viscous_friction_of_a_follower_slows_its_leader_in_both_engines() {
    for multiplier in [-1.0, 0.5, -2.0] {
        let ends = |damping: f64| {
            let mut robot = coupled(multiplier, 0.0);
            robot.joints[1].passive.damping = damping;
            let world = nominal(&robot);
            let mut start = Start::nominal(&robot);
            start.joint_velocities[0] = 2.0;
            let mut lanes = Lanes::new(&robot, 1e-3, 1, Simd::ALL[0]).expect("available");
            lanes.reset(0, &start, &world);
            let mut rapier = single(&robot, 1e-3, &start, &world);
            let coast = |engine: &mut dyn Engine| {
                (0..200).for_each(|_| engine.step(&Drive::idle(1, 1)));
                engine.joints().position[0]
            };
            [coast(&mut lanes), coast(&mut rapier)]
        };
        let ([free, _], [lanes, rapier]) = (ends(0.0), ends(0.1));
        let slowed = free - lanes;
        assert!(slowed.abs() > 1e-3, "{free} {lanes}");
        assert!(
            (rapier - lanes).abs() < 0.05 * slowed.abs(),
            "{rapier} for {lanes}, {free} without"
        );
    }
}
