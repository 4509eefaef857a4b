//! The robots of the project load and are what their makers publish.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3, Quaternion, Unit, UnitQuaternion, Vector3};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Friction, GRAVITY, Start, World};
use omniwalk_env::robot::{Kinematics, Robot, load};

fn robots() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots")
}

fn nimbro() -> Robot {
    load(&robots().join("nimbro_op2x")).unwrap_or_else(|error| panic!("{error}"))
}

/// Highest and lowest corner of all shapes, m.
fn extent(robot: &Robot, kinematics: &Kinematics) -> (f64, f64) {
    use omniwalk_env::robot::Geometry::{Box, Cylinder};
    let mut range = (f64::INFINITY, f64::NEG_INFINITY);
    for (index, link) in robot.links.iter().enumerate() {
        for shape in &link.shapes {
            let half = match shape.geometry {
                Box(half) => half,
                Cylinder(radius, half) => [radius, radius, half].into(),
                _ => continue,
            };
            for corner in 0..8 {
                let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
                let point = Point3::new(sign(0) * half.x, sign(1) * half.y, sign(2) * half.z);
                let z = (kinematics.pose(index) * shape.pose * point).z;
                range = (range.0.min(z), range.1.max(z));
            }
        }
    }
    range
}

#[test]
fn nimbro_has_19_kg_and_16_policy_joints_and_parallelogram_legs() {
    let robot = nimbro();
    assert!((robot.mass() - 19.0).abs() < 0.19, "{} kg", robot.mass());
    assert_eq!(robot.policy.len(), 16);
    assert_eq!(robot.joints.iter().filter(|joint| joint.mimic.is_some()).count(), 4);
    for joint in robot.joints.iter().filter(|joint| joint.mimic.is_some()) {
        assert_eq!(joint.mimic.map(|mimic| mimic.multiplier), Some(-1.0));
    }
}

#[test]
fn nimbro_is_135_cm_tall_with_straight_legs() {
    let robot = nimbro();
    let mut kinematics = Kinematics::new(&robot);
    kinematics.set_pose(&robot, &Isometry3::identity(), &vec![0.0; robot.dofs.len()]);
    let (low, high) = extent(&robot, &kinematics);
    assert!((high - low - 1.35).abs() < 0.02, "{} m", high - low);
}

#[test]
fn nimbro_stands_on_flat_soles_with_its_mass_over_their_middle() {
    let robot = nimbro();
    let kinematics = Kinematics::new(&robot);
    for foot in 0..2 {
        let sole = kinematics.sole(&robot, foot);
        assert!(sole.translation.z.abs() < 1e-9, "height {}", sole.translation.z);
        assert!(sole.rotation.angle() < 1e-9, "tilt {}", sole.rotation.angle());
    }
    let (left, right) = (kinematics.sole(&robot, 0), kinematics.sole(&robot, 1));
    let [half_x, half_y] = robot.feet[0].half_extents;
    let gap = left.translation.y - right.translation.y - 2.0 * half_y;
    assert!(gap > 0.03, "soles are {gap} m apart");
    let com = kinematics.center_of_mass(robot.links.iter().map(|link| &link.inertial));
    assert!(
        (com.x - left.translation.x).abs() < half_x / 3.0,
        "{com} over {}",
        left.translation.x
    );
    assert!(com.y.abs() < 1e-9);
    println!(
        "gap {gap:.4} com {com} sole {:.4} trunk {:.4}",
        left.translation.x, robot.base_pose.translation.z
    );
}

#[test]
fn nimbro_is_its_own_mirror_image() {
    let robot = nimbro();
    let link = |name: &str| robot.links.iter().find(|link| link.name == name);
    for left in robot.links.iter().filter(|link| link.name.starts_with("left_")) {
        let right = link(&left.name.replacen("left", "right", 1)).expect("a right link");
        let (l, r) = (&left.inertial, &right.inertial);
        assert_eq!(l.mass, r.mass);
        assert_eq!(
            [l.com.x, l.com.y, l.com.z],
            [r.com.x, -r.com.y, r.com.z],
            "{}",
            left.name
        );
        assert_eq!(l.inertia.diagonal(), r.inertia.diagonal());
    }
    let mirror = robot.mirror.as_ref().expect("a mirror map");
    for (i, mirrored) in mirror.iter().enumerate() {
        let (joint, partner) = (robot.policy_joint(i), robot.policy_joint(mirrored.joint));
        assert_eq!(mirror[mirrored.joint].joint, i, "mirroring twice changes nothing");
        assert_eq!(joint.nominal, mirrored.sign * partner.nominal, "{}", joint.name);
        let limits = if mirrored.sign > 0.0 {
            partner.limits
        } else {
            (-partner.limits.1, -partner.limits.0)
        };
        assert_eq!(joint.limits, limits, "{}", joint.name);
        assert_eq!(joint.actuator, partner.actuator);
        assert_eq!(joint.passive, partner.passive);
    }
}

#[test]
fn a_pendulum_is_a_robot_with_a_fixed_base() {
    let robot = load(&robots().join("pendulum")).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(robot.base, omniwalk_env::robot::Base::Fixed);
    assert_eq!((robot.links.len(), robot.joints.len(), robot.policy.len()), (2, 1, 1));
    assert_eq!(robot.base_pose.translation.z, 0.5);
}

#[test]
fn the_small_robot_is_the_large_one_at_seventy_percent() {
    let (large, small) = (
        nimbro(),
        load(&robots().join("nimbro_op2x_small")).unwrap_or_else(|error| panic!("{error}")),
    );
    assert!((small.mass() - 8.0).abs() < 1e-6, "{} kg", small.mass());
    assert!((small.base_pose.translation.z / large.base_pose.translation.z - 0.7).abs() < 1e-6);
    let com = |robot: &Robot| Kinematics::new(robot).center_of_mass(robot.links.iter().map(|link| &link.inertial));
    assert!((com(&small) - com(&large) * 0.7).norm() < 1e-6);
}

#[test]
fn the_controllers_legs_reach_the_soles_of_the_kinematics() {
    let robot = nimbro();
    let mut kinematics = Kinematics::new(&robot);
    let positions: Vec<f64> = (0..robot.dofs.len())
        .map(|d| robot.dof(d).nominal + 0.1 * (d as f64).sin())
        .collect();
    kinematics.set_pose(&robot, &Isometry3::identity(), &positions);
    for (foot, leg) in robot.legs().iter().enumerate() {
        let mut pose = Isometry3::identity();
        for segment in &leg.segments {
            let [x, y, z, w] = segment.rotation.map(f64::from);
            let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            let q = segment.joint.map_or(0.0, |i| positions[robot.policy[usize::from(i)]]);
            let angle = f64::from(segment.multiplier) * q + f64::from(segment.offset);
            let axis = Unit::new_normalize(Vector3::from(segment.axis.map(f64::from)));
            pose *= Isometry3::from_parts(Vector3::from(segment.translation.map(f64::from)).into(), rotation)
                * UnitQuaternion::from_axis_angle(&axis, angle);
        }
        let link = robot.feet[foot].link;
        for (corner, exact) in leg.corners.iter().zip(robot.feet[foot].corners()) {
            let corner = pose * Point3::from(corner.map(f64::from));
            assert!((corner - kinematics.pose(link) * exact).norm() < 1e-6);
        }
    }
}

#[test]
fn velocities_are_the_derivatives_of_poses() {
    let robot = nimbro();
    let rates: Vec<f64> = (0..robot.dofs.len()).map(|d| (1.0 + d as f64).cos()).collect();
    let (linear, angular) = (Vector3::new(0.3, -0.2, 0.1), Vector3::new(0.5, 0.7, -0.4));
    let pose_at = |time: f64| {
        let mut kinematics = Kinematics::new(&robot);
        let turn = UnitQuaternion::from_scaled_axis(angular * time);
        let base = Isometry3::from_parts((robot.base_pose.translation.vector + linear * time).into(), turn);
        let positions: Vec<f64> = robot
            .nominal()
            .iter()
            .zip(&rates)
            .map(|(q, rate)| q + rate * time)
            .collect();
        kinematics.set_pose(&robot, &base, &positions);
        kinematics
    };
    let (mut now, step) = (pose_at(0.0), 1e-5);
    now.set_velocity(&robot, &linear, &angular, &rates);
    let (before, after) = (pose_at(-step), pose_at(step));
    for link in 0..robot.links.len() {
        let local = Point3::new(0.1, -0.05, 0.2);
        let expected = (after.pose(link) * local - before.pose(link) * local) / (2.0 * step);
        let velocity = now.velocity_at(link, &(now.pose(link) * local));
        assert!(
            (velocity - expected).norm() < 1e-7,
            "link {link}: {velocity} against {expected}"
        );
    }
}

/// Holds the nominal pose for `seconds` under PD alone; the largest tilt of the trunk (rad) over the second half,
/// the ground force at the end relative to the weight, and the joint speed (rad/s) at the end.
fn stand(robot: &Robot, dt: f64, seconds: f64) -> (f64, f64, f64) {
    let mut engine = Rapier::new(robot, dt, 1).unwrap_or_else(|error| panic!("{error}"));
    let friction = Friction {
        tangential: 0.6,
        torsional: 0.2,
        rolling: 0.1,
    };
    engine.reset(0, &Start::nominal(robot), &World::nominal(robot, friction));
    let mut drive = Drive::idle(robot.dofs.len(), 1);
    drive.target = robot.nominal();
    for d in 0..robot.dofs.len() {
        let actuator = robot.dof(d).actuator.expect("an actuator");
        (drive.stiffness[d], drive.damping[d]) = (actuator.kp, actuator.kd);
        (drive.torque_min[d], drive.torque_max[d]) = (-actuator.torque_limit, actuator.torque_limit);
    }
    let steps = (seconds / dt) as usize;
    let (mut tilt, mut force) = (0.0_f64, 0.0);
    for step in 0..steps {
        engine.step(&drive);
        if step > steps / 2 {
            tilt = tilt.max(engine.base(0).orientation.angle());
        }
        if step >= steps - steps / 10 {
            force += (0..2).map(|foot| engine.foot_force(0, foot).z).sum::<f64>() / (steps / 10) as f64;
        }
    }
    let speed = engine
        .joints()
        .velocity
        .iter()
        .fold(0.0_f64, |speed, v| speed.max(v.abs()));
    (tilt, force / (robot.mass() * GRAVITY), speed)
}

#[test]
fn nimbro_stands_for_ten_seconds_under_pd_alone() {
    for folder in ["nimbro_op2x", "nimbro_op2x_small"] {
        let robot = load(&robots().join(folder)).unwrap_or_else(|error| panic!("{error}"));
        let (tilt, force, speed) = stand(&robot, 0.005, 10.0);
        println!("{folder}: tilt {tilt:.4} rad, force over weight {force:.4}, joint speed {speed:.4} rad/s");
        assert!(tilt < 0.05, "{folder} tilts by {tilt} rad");
        assert!((force - 1.0).abs() < 0.01, "{folder}: force over weight {force}");
    }
}
