//! NimbRo-OP2X under the PD gains and torque limits of its own files.

use std::path::Path;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use omniwalk_env::engine::{Drive, Engine, Start};
use omniwalk_env::robot::{self, Robot};

use crate::robots::*;

fn nimbro() -> Robot {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/nimbro_op2x");
    robot::load(&folder).expect("the project's own robot")
}

fn nominal_targets(robot: &Robot) -> Drive {
    let mut drive = servo(robot, 1, 0.0, 0.0);
    for d in 0..robot.dofs.len() {
        let actuator = robot.dof(d).actuator.expect("every joint has a motor");
        drive.stiffness[d] = actuator.kp;
        drive.damping[d] = actuator.kd;
        drive.torque_min[d] = -actuator.torque_limit;
        drive.torque_max[d] = actuator.torque_limit;
    }
    drive
}

#[test]
fn nimbro_stands_for_ten_seconds_and_presses_with_its_weight() {
    let robot = nimbro();
    let drive = nominal_targets(&robot);
    for rate in [200, 400, 1000] {
        let dt = 1.0 / f64::from(rate);
        let mut engine = single(&robot, dt, &Start::nominal(&robot), &nominal(&robot));
        (0..9 * rate).for_each(|_| engine.step(&drive));
        let (mut force, before) = (Vector3::zeros(), engine.base(0));
        for _ in 0..rate {
            engine.step(&drive);
            force += (engine.foot_force(0, 0) + engine.foot_force(0, 1)) * dt;
        }
        let (weight, base) = (robot.mass() * G, engine.base(0));
        // What it has gained of momentum in this second comes on top.
        let momentum = (base.linear_velocity - before.linear_velocity).norm() / G;
        assert!(
            (force - Vector3::z() * weight).norm() < (1e-3 + momentum) * weight,
            "{force} N at {rate} Hz"
        );
        // The servos yield to the weight by tau / kp, less than 0.05 rad at any joint.
        assert!(base.orientation.angle() < 0.05, "tilt {} rad", base.orientation.angle());
        assert!((base.position - robot.base_pose.translation.vector).norm() < 0.03);
        assert!(
            base.linear_velocity.norm() < 1e-3,
            "{} m/s at {rate} Hz",
            base.linear_velocity.norm()
        );
    }
}

fn mirrored(robot: &Robot, start: &Start) -> Start {
    let flip = |v: Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
    let q = start.orientation.quaternion();
    let mut joints = start.joints.clone();
    let map = robot.mirror.as_ref().expect("a mirror map");
    for (i, image) in map.iter().enumerate() {
        joints[robot.policy[i]] = image.sign * start.joints[robot.policy[image.joint]];
    }
    Start {
        position: flip(start.position),
        orientation: UnitQuaternion::from_quaternion(Quaternion::new(q.w, -q.i, q.j, -q.k)),
        linear_velocity: flip(start.linear_velocity),
        angular_velocity: -flip(start.angular_velocity),
        joints,
        joint_velocities: start.joint_velocities.clone(),
    }
}

/// Landing askew from 5 mm and swaying: mirror images differ only by the order of the solver's sweeps.
#[test]
fn nimbro_mirrored_moves_mirrored() {
    let robot = nimbro();
    let drive = nominal_targets(&robot);
    let dt = 2.5e-3;
    let mut start = Start::nominal(&robot);
    start.position.z += 0.005;
    start.linear_velocity = Vector3::new(0.05, 0.1, 0.0);
    start.orientation = UnitQuaternion::from_euler_angles(0.02, 0.01, 0.03);
    start
        .joints
        .iter_mut()
        .enumerate()
        .for_each(|(d, q)| *q += 0.02 * (d as f64).sin());
    let mut original = single(&robot, dt, &start, &nominal(&robot));
    let mut image = single(&robot, dt, &mirrored(&robot, &start), &nominal(&robot));
    for _ in 0..200 {
        original.step(&drive);
        image.step(&drive);
    }
    let (a, b) = (original.base(0).position, image.base(0).position);
    let moved = (a - start.position).norm();
    let difference = (a - Vector3::new(b.x, -b.y, b.z)).norm();
    assert!(
        difference < 0.1 * moved && difference < 5e-3,
        "{difference} m of {moved} m"
    );
}
