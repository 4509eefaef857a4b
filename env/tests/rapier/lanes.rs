//! Both engines beside each other where nothing touches: they differ by their integrators alone, in proportion to the step.

use nalgebra::Vector3;
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Start};
use omniwalk_env::robot::{Base, JointKind, Mimic, Robot};

use crate::order::agree;
use crate::robots::*;

/// Rods in a row on a fixed base; every hinge is turned by `twist` rad about the vertical against the one before.
fn chain(rods: usize, twist: f64) -> Robot {
    let mut links = vec![link("base", None, 1.0, Vector3::zeros(), Vector3::repeat(0.01))];
    let mut joints = vec![];
    for rod in 0..rods {
        let length = if rod == 0 { 0.0 } else { -0.3 };
        let axis = Vector3::new((twist * rod as f64).sin(), (twist * rod as f64).cos(), 0.0);
        joints.push(joint("hinge", rod, Vector3::new(0.0, 0.0, length), axis));
        let com = Vector3::new(0.0, 0.02, -0.15);
        let inertia = Vector3::new(0.004, 0.004, 0.0005);
        links.push(link("rod", Some(rod), 0.5, com, inertia));
    }
    let mut robot = robot(Base::Fixed, links, joints);
    robot.base_pose.translation.vector.z = 5.0;
    robot
}

/// Joint positions of lanes and rapier every 10 ms of a swing from the side.
fn swings(robot: &Robot, seconds: f64, dt: f64) -> [Vec<f64>; 2] {
    let mut start = Start::nominal(robot);
    start.joints.fill(0.5);
    start.joints[0] = 1.2;
    start.position.z += 5.0;
    start.angular_velocity = Vector3::new(1.0, -0.5, 0.7);
    let world = nominal(robot);
    let mut lanes = Lanes::new(robot, dt, 1, Simd::Scalar).expect("any processor");
    let mut rapier = Rapier::new(robot, dt, 1).expect("engine");
    let engines: [&mut dyn Engine; 2] = [&mut lanes, &mut rapier];
    engines.map(|engine| {
        engine.reset(0, &start, &world);
        let drive = Drive::idle(robot.dofs.len(), 1);
        let mut samples = vec![];
        for step in 1..=(seconds / dt).round() as usize {
            engine.step(&drive);
            if step % (0.01 / dt).round() as usize == 0 {
                samples.extend_from_slice(&engine.joints().position);
            }
        }
        samples
    })
}

/// The engines' motions differ in proportion to the step, and extrapolated to no step at all they are the same.
fn compare(robot: &Robot, seconds: f64) {
    agree(&[1e-3, 5e-4, 2.5e-4].map(|dt| swings(robot, seconds, dt)));
}

#[test]
fn double_pendulum_differs_in_proportion_to_the_step() {
    compare(&chain(2, 0.0), 0.5);
}

#[test]
fn chain_differs_in_proportion_to_the_step() {
    compare(&chain(6, 0.7), 0.5);
}

#[test]
fn robots_of_one_joint_and_of_sixty_differ_in_proportion_to_the_step() {
    compare(&chain(1, 0.0), 0.5);
    // A long chain's swings grow apart at whatever step before they have come far.
    compare(&chain(60, 0.3), 0.1);
}

#[test]
fn sliding_joints_differ_in_proportion_to_the_step() {
    let mut robot = chain(3, 0.7);
    robot.joints[1].kind = JointKind::Prismatic;
    compare(&robot, 0.5);
}

#[test]
fn floating_robots_differ_in_proportion_to_the_step() {
    let mut robot = chain(4, 0.7);
    robot.base = Base::Floating;
    compare(&robot, 0.5);
}

/// Lets `follower` follow `leader`.
fn couple(robot: &mut Robot, follower: usize, leader: usize, multiplier: f64, offset: f64) {
    robot.joints[follower].mimic = Some(Mimic {
        joint: leader,
        multiplier,
        offset,
    });
    robot.dofs.retain(|&dof| dof != follower);
    robot.policy = (0..robot.dofs.len()).collect();
}

#[test]
fn sliding_joints_that_follow_differ_in_proportion_to_the_step() {
    let mut robot = chain(4, 0.7);
    robot.joints[1].kind = JointKind::Prismatic;
    robot.joints[3].kind = JointKind::Prismatic;
    couple(&mut robot, 3, 1, -0.6, 0.02);
    compare(&robot, 0.5);
    // One that slides after one that turns, m/rad.
    let mut robot = chain(4, 0.7);
    robot.joints[2].kind = JointKind::Prismatic;
    couple(&mut robot, 2, 0, 0.05, -0.01);
    compare(&robot, 0.5);
}

#[test]
fn floating_robots_with_joints_that_follow_differ_in_proportion_to_the_step() {
    let mut robot = chain(5, 0.7);
    robot.base = Base::Floating;
    couple(&mut robot, 3, 1, -0.6, 0.02);
    couple(&mut robot, 4, 0, 1.5, 0.0);
    compare(&robot, 0.5);
}
