//! Robots as their makers publish them: no TOML, meshes that are not at hand, soles made of spheres or boxes, joints without
//! limits, display links without mass. Each humanoid here is written as one of those URDFs is, with numbers to check by hand.

use std::fs;

use omniwalk_env::robot::{Base, Robot, RobotError, describe, load};

/// Four spheres under the foot, as Unitree's G1 has them.
const SPHERES: &str = r#"
    <collision><origin xyz="-0.05 0.025 -0.03"/><geometry><sphere radius="0.005"/></geometry></collision>
    <collision><origin xyz="-0.05 -0.025 -0.03"/><geometry><sphere radius="0.005"/></geometry></collision>
    <collision><origin xyz="0.12 0.03 -0.03"/><geometry><sphere radius="0.005"/></geometry></collision>
    <collision><origin xyz="0.12 -0.03 -0.03"/><geometry><sphere radius="0.005"/></geometry></collision>"#;

/// A box under the foot, as Booster's T1 has it.
const BOX: &str =
    r#"<collision><origin xyz="0.01 0 -0.015"/><geometry><box size="0.223 0.1 0.03"/></geometry></collision>"#;

/// A bar beside the thigh for the display only, as the makers of NimbRo-OP2X draw of their parallelograms.
const BAR: &str = r#"
  <joint name="left_bar" type="revolute">
    <parent link="left_hip_link"/>
    <child link="left_bar_link"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="50" velocity="4"/>
  </joint>
  <link name="left_bar_link"/>"#;

const LIMITED: &str = r#"lower="-1.2" upper="1.2" "#;

fn link(name: &str, mass: f64, collision: &str) -> String {
    format!(
        r#"
  <link name="{name}">
    <inertial>
      <origin xyz="0 0 -0.05"/>
      <mass value="{mass}"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
    <visual><geometry><mesh filename="package://humanoid/meshes/{name}.STL"/></geometry></visual>
    {collision}
  </link>"#
    )
}

fn joint(name: &str, kind: &str, (parent, child): (&str, &str), xyz: &str, limits: &str) -> String {
    format!(
        r#"
  <joint name="{name}" type="{kind}">
    <origin xyz="{xyz}"/>
    <parent link="{parent}"/>
    <child link="{child}"/>
    <axis xyz="0 1 0"/>
    <limit {limits}effort="50" velocity="4"/>
  </joint>"#
    )
}

/// A humanoid of 2 x 4 joints: legs with hip, knee and ankle, and arms; `sole` is the collision geometry of a foot, `more` what
/// else is in the file.
fn humanoid(sole: &str, kind: &str, limits: &str, more: &str) -> String {
    let mut text = link("pelvis", 5.0, "");
    for (side, y) in [("left", 0.1), ("right", -0.1)] {
        let name = |part: &str| format!("{side}_{part}");
        for (part, on, xyz, mass, shape) in [
            ("hip", "pelvis".to_owned(), format!("0 {y} -0.05"), 2.0, ""),
            ("knee", name("hip_link"), "0 0 -0.3".to_owned(), 1.5, ""),
            ("ankle", name("knee_link"), "0 0 -0.3".to_owned(), 0.5, sole),
            ("shoulder", "pelvis".to_owned(), format!("0 {} 0.4", 2.0 * y), 1.0, ""),
        ] {
            let child = format!("{side}_{part}_link");
            text += &link(&child, mass, shape);
            text += &joint(&name(part), kind, (&on, &child), &xyz, limits);
        }
    }
    format!("<robot name=\"humanoid\">{text}{more}\n</robot>\n")
}

fn read(text: &str) -> Result<Robot, RobotError> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("humanoid.urdf"), text).unwrap();
    load(folder.path())
}

/// It loads with the masses of all links and two feet whose soles are 2 x `half` m, with their centres at `centre` of their links.
#[track_caller]
fn stands_on(sole: &str, half: [f64; 2], centre: [f64; 3]) {
    let robot = read(&humanoid(sole, "revolute", LIMITED, "")).unwrap_or_else(|error| panic!("{error}"));
    assert!((robot.mass() - (5.0 + 2.0 * (2.0 + 1.5 + 0.5 + 1.0))).abs() < 1e-9);
    assert_eq!(
        (robot.base, robot.dofs.len(), robot.policy.len()),
        (Base::Floating, 8, 8)
    );
    let names: Vec<&str> = robot.feet.iter().map(|foot| foot.name.as_str()).collect();
    assert_eq!(names, ["left_ankle_link", "right_ankle_link"]);
    for foot in &robot.feet {
        let found = foot.sole.translation.vector;
        for k in 0..3 {
            assert!((found[k] - centre[k]).abs() < 1e-9, "centre {found}");
        }
        assert!(
            (0..2).all(|k| (foot.half_extents[k] - half[k]).abs() < 1e-9),
            "{:?}",
            foot.half_extents
        );
    }
    // Hip, thigh and shank above the sole.
    let height = 0.05 + 0.3 + 0.3 - centre[2];
    assert!((robot.base_pose.translation.z - height).abs() < 1e-9);
    assert!(describe(&robot).contains("left_ankle_link"));
}

#[test]
fn soles_are_guessed_from_spheres() {
    stands_on(SPHERES, [0.085, 0.03], [0.035, 0.0, -0.035]);
}

#[test]
fn soles_are_guessed_from_boxes() {
    stands_on(BOX, [0.1115, 0.05], [0.01, 0.0, -0.03]);
}

#[test]
fn a_robot_whose_joints_have_no_limits_loads_but_has_no_policy_joints() {
    let robot = read(&humanoid(BOX, "continuous", "", "")).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(robot.dofs.len(), 8);
    assert!(
        robot.policy.is_empty(),
        "continuous joints need limits before a policy moves them"
    );
}

#[test]
fn a_robot_with_bars_without_mass_is_refused_with_what_to_do() {
    let error = read(&humanoid(BOX, "revolute", LIMITED, BAR)).expect_err("the bars have no mass");
    let RobotError::Content(error) = error else {
        panic!("{error}");
    };
    assert!(
        error.message.contains("left_bar") && error.message.contains("no mass or inertia"),
        "{error}"
    );
    assert!(error.help.contains("locked = [\"left_bar\"]"), "{}", error.help);
}
