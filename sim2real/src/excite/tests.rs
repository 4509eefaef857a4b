//! Motions stay within the limits, do what their names say, and are the same every time.

use std::path::{Path, PathBuf};

use omniwalk_env::robot::load;

use super::*;
use crate::recording;

fn robot(name: &str) -> Robot {
    load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(name)).unwrap()
}

fn find<'p>(plan: &'p Plan, name: &str) -> &'p Motion {
    plan.motions.iter().find(|motion| motion.name == name).unwrap()
}

#[test]
fn targets_stay_within_position_and_speed_limits_and_come_back() {
    for name in ["pendulum", "nimbro_op2x_small"] {
        stays_within_limits(&robot(name));
    }
}

#[test]
fn wide_and_slow_joints_are_told_no_more_than_they_can_do() {
    for (side, speed) in [(60.0, 4.8), (1e9, 4.8), (1.5, 0.1)] {
        let mut robot = robot("pendulum");
        for joint in &mut robot.joints {
            joint.limits = (-side, side);
            if let Some(motor) = &mut joint.actuator {
                motor.speed_limit = speed;
            }
        }
        stays_within_limits(&robot);
    }
}

fn stays_within_limits(robot: &Robot) {
    let plan = Plan::new(robot);
    assert!(plan.motions.len() >= 5, "{:?}", plan.notes);
    for motion in &plan.motions {
        let (first, last) = (&motion.targets[0], &motion.targets[motion.targets.len() - 1]);
        for joint in 0..robot.policy.len() {
            let spec = robot.policy_joint(joint);
            assert!(
                (first[joint] - spec.nominal).abs() < 1e-9 && (last[joint] - spec.nominal).abs() < 1e-6,
                "{}",
                motion.name
            );
            let limit = spec.actuator.unwrap().speed_limit;
            for pair in motion.targets.windows(2) {
                let (lower, upper) = spec.limits;
                assert!(
                    (lower..=upper).contains(&pair[1][joint]),
                    "{} of {}",
                    spec.name,
                    motion.name
                );
                let speed = (pair[1][joint] - pair[0][joint]).abs() * COMMAND_RATE;
                assert!(
                    speed <= limit || motion.name.starts_with("steps"),
                    "{} of {}: {speed}",
                    spec.name,
                    motion.name
                );
            }
        }
    }
}

#[test]
fn each_shape_shows_what_it_is_for() {
    let robot = robot("pendulum");
    let plan = Plan::new(&robot);
    let of = |shape: &str| find(&plan, &format!("{shape}-hinge")).information[0].clone();
    assert!(of("triangle").slow_share > 0.9, "{:?}", of("triangle"));
    assert!(of("steps").jump > 0.1 && of("triangle").jump == 0.0);
    assert!(of("chirp").speed_share > 0.5 && of("chirp").reversals > 10);
    assert!(of("chirp").inertia_share > 5.0 * of("triangle").inertia_share);
    // The bar weighs 0.5 kg at 0.15 m, of 4.1 N m: up to 0.36 of the limit between both sides.
    let load = of("triangle").load_share;
    assert!((0.2..0.36).contains(&load), "{load}");
    assert!(plan.seconds() > 60.0);
}

#[test]
fn files_are_read_back_and_are_the_same_every_time() {
    let robot = robot("pendulum");
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    for folder in &folders {
        write(&Plan::new(&robot), &robot, folder.path()).unwrap();
    }
    let read = |folder: usize, file: &str| std::fs::read(folders[folder].path().join(file)).unwrap();
    for file in ["chirp-hinge.mcap", "chirp-hinge.csv", "motions.json"] {
        assert_eq!(read(0, file), read(1, file));
    }
    let path: PathBuf = folders[0].path().join("chirp-hinge.mcap");
    let recordings = recording::read(&path, None).unwrap();
    let plan = Plan::new(&robot);
    let targets: Vec<f64> = find(&plan, "chirp-hinge")
        .targets
        .iter()
        .map(|targets| targets[0])
        .collect();
    assert_eq!(recordings[0].joints[0].command.value, targets);
    assert_eq!(recordings[0].groups["motion"], "chirp-hinge");
}

#[test]
fn links_that_may_overlap_are_kept_apart() {
    let robot = robot("nimbro_op2x_small");
    let limits = Limits::new(&robot);
    let joint = |name: &str| {
        (0..robot.policy.len())
            .find(|&i| robot.policy_joint(i).name == name)
            .unwrap()
    };
    // Both legs swing inward, or both outward, as far as the tighter limit.
    let (left, right) = (joint("left_hip_roll"), joint("right_hip_roll"));
    let swing = |way: f64| {
        let nominal = limits.nominal();
        let targets = (0..200).map(|step| {
            let mut targets = nominal.clone();
            targets[left] += way * f64::from(step) * 0.002;
            targets[right] -= way * f64::from(step) * 0.002;
            targets
        });
        limits.fault(&targets.collect::<Vec<_>>())
    };
    let (inward, outward) = (swing(1.0), swing(-1.0));
    let overlaps = |fault: &Option<String>| fault.as_ref().is_some_and(|why| why.contains("overlap"));
    assert!(overlaps(&inward) != overlaps(&outward), "{inward:?} {outward:?}");
}

#[test]
fn targets_jump_by_what_a_stiffer_servo_can_do() {
    let jump = |kp_scale: f64| {
        let mut robot = robot("pendulum");
        for joint in &mut robot.joints {
            joint.actuator.as_mut().unwrap().kp_scale = kp_scale;
        }
        let plan = Plan::new(&robot);
        let jumps = plan.motions.iter().flat_map(|motion| &motion.information);
        jumps.map(|own| own.jump).fold(0.0, f64::max)
    };
    let (nominal, stiff) = (jump(1.0), jump(2.0));
    assert!(
        nominal > 0.0 && (2.0 * stiff / nominal - 1.0).abs() < 1e-9,
        "{stiff} of {nominal}"
    );
}

#[test]
fn an_arm_beside_a_column_is_kept_from_it_though_no_file_says_so() {
    let link = |name: &str, z: f64, size: &str| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="0 0 {z}"/><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 {z}"/><geometry><box size="{size}"/></geometry></collision></link>"#
        )
    };
    let (column, arm) = (link("column", 0.0, "0.2 0.2 0.6"), link("arm", -0.15, "0.04 0.04 0.3"));
    let joint = r#"<joint name="shoulder" type="revolute"><parent link="column"/><child link="arm"/><origin xyz="0.15 0 0.2"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="20" velocity="8"/></joint>"#;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("arm.urdf"),
        format!("<robot name=\"arm\">{column}{arm}{joint}</robot>"),
    )
    .unwrap();
    let toml =
        "base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\nkp = 40.0\nkd = 1.0\ntorque_limit = 20.0\nspeed_limit = 8.0\n";
    std::fs::write(folder.path().join("robot.toml"), toml).unwrap();
    let robot = commanded(&load(folder.path()).unwrap());
    // Three centimetres from the column, 0.3 m long and 4 cm thick, the arm is at it when it swings in by 0.1 rad.
    let plan = Plan::new(&robot);
    let targets = plan.motions.iter().flat_map(|motion| &motion.targets);
    let inmost = targets.map(|targets| targets[0]).fold(0.0, f64::max);
    assert!(plan.motions.len() >= 5, "{:?}", plan.notes);
    assert!((0.02..0.11).contains(&inmost), "{inmost} rad");
}

#[test]
fn joints_that_cannot_move_are_left_out_and_named() {
    let mut robot = robot("nimbro_op2x_small");
    let fixed = robot.policy[0];
    let joint = robot.dofs[fixed];
    let nominal = robot.joints[joint].nominal;
    robot.joints[joint].limits = (nominal - 1e-9, nominal + 1e-9);
    let name = robot.joints[joint].name.clone();
    let mut plan = Plan::new(&robot);
    plan.examine(&robot).expect("what the others show");
    let left_out = |note: &String| note.starts_with(&format!("{name} is left out"));
    assert!(plan.notes.iter().any(left_out), "{:?}", plan.notes);
    let moves = |motion: &Motion| motion.information.iter().any(|own| own.joint == name);
    assert!(!plan.motions.iter().any(moves) && !plan.motions.is_empty());
}
