//! The robots of the project load and are what their makers publish.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3};
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
