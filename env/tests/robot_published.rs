//! Robots of other makers load as they are published. Skipped where their files are not at hand.

use std::path::PathBuf;

use omniwalk_env::robot::{Base, Robot, describe, load};

fn path(file: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("OMNIWALK_SHARED").map(|folder| PathBuf::from(folder).join("robots/urdf"));
    if folder.is_none() {
        println!("skipped: OMNIWALK_SHARED is not set");
    }
    folder.map(|folder| folder.join(file))
}

/// Loads the robot and compares its mass with the sum of all masses in the text.
fn loads(file: &str, dofs: usize) -> Option<Robot> {
    let path = path(file)?;
    let robot = load(&path).unwrap_or_else(|error| panic!("{error}"));
    let text = std::fs::read_to_string(path).expect("the file that was just loaded");
    let document = roxmltree::Document::parse(&text).expect("XML");
    let masses = document.descendants().filter(|node| node.has_tag_name("mass"));
    let mass: f64 = masses
        .filter_map(|node| node.attribute("value")?.parse::<f64>().ok())
        .sum();
    assert!((robot.mass() - mass).abs() < 1e-9, "{} of {mass} kg", robot.mass());
    assert_eq!(robot.dofs.len(), dofs);
    println!("{}", describe(&robot));
    Some(robot)
}

#[test]
fn unitree_g1_loads_with_feet_guessed_from_its_spheres() {
    let Some(robot) = loads("unitree_g1/g1_12dof.urdf", 12) else {
        return;
    };
    assert_eq!(
        (robot.base, robot.feet.len(), robot.policy.len()),
        (Base::Floating, 2, 12)
    );
}

#[test]
fn booster_t1_loads_with_feet_guessed_from_its_boxes() {
    let Some(robot) = loads("booster_t1/T1_locomotion.urdf", 12) else {
        return;
    };
    assert_eq!(
        (robot.base, robot.feet.len(), robot.policy.len()),
        (Base::Floating, 2, 12)
    );
    assert_eq!(
        robot.feet[0].half_extents.map(|half| (half * 2e3).round()),
        [223.0, 100.0]
    );
}

#[test]
fn igus_op_loads_although_its_joints_have_no_limits() {
    let Some(robot) = loads("igus_op/igus_op.urdf", 20) else {
        return;
    };
    assert!(
        robot.policy.is_empty(),
        "continuous joints need limits before a policy moves them"
    );
}

#[test]
fn the_makers_nimbro_is_refused_for_its_bars_without_mass() {
    let Some(path) = path("nimbro_op2x/nimbro_op2x_hull.urdf") else {
        return;
    };
    let error = load(&path).expect_err("the display links have no mass").to_string();
    assert!(
        error.contains("parallel_right_thigh_pitch") && error.contains("no mass or inertia"),
        "{error}"
    );
}
