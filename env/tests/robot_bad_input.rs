//! What makes no robot is refused with its place in the file; what merely looks odd loads.

use std::fs;

use omniwalk_env::robot::{Base, Robot, RobotError, load};

/// A sound robot: a base, a turning and a sliding joint, and a coupled one. Tests break one thing each.
const URDF: &str = r#"<robot name="rig">
  <link name="base"/>
  <joint name="swing" type="revolute">
    <parent link="base"/>
    <child link="arm"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="3"/>
  </joint>
  <link name="arm">
    <inertial>
      <origin xyz="0 0 -0.2"/>
      <mass value="1.0"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
    <collision><geometry><box size="0.1 0.1 0.4"/></geometry></collision>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="arm"/>
    <child link="rod"/>
    <axis xyz="0 0 1"/>
    <limit lower="-0.1" upper="0.1" effort="5" velocity="1"/>
  </joint>
  <link name="rod">
    <inertial>
      <mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/>
    </inertial>
  </link>
  <joint name="follower" type="revolute">
    <parent link="rod"/>
    <child link="tip"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="3"/>
    <mimic joint="swing" multiplier="-1"/>
  </joint>
  <link name="tip"/>
</robot>
"#;

const TOML: &str = "[[joint]]\nmatch = [\"swing\"]\nkp = 10.0\nkd = 0.1\n";

fn read(urdf: &str, toml: Option<&str>) -> Result<Robot, RobotError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("rig.urdf"), urdf).expect("written");
    if let Some(toml) = toml {
        fs::write(folder.path().join("robot.toml"), toml).expect("written");
    }
    load(folder.path())
}

/// Asserts that the robot is refused at `line` with a message that says `what`.
fn refused(urdf: &str, toml: Option<&str>, line: usize, what: &str) {
    match read(urdf, toml) {
        Err(RobotError::Content(error)) => {
            assert!(error.message.contains(what), "said: {}", error.message);
            assert_eq!(error.line, line, "{error}");
            assert!(!error.help.is_empty());
        }
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("loaded"),
    }
}

fn broken_urdf(from: &str, to: &str, line: usize, what: &str) {
    assert!(URDF.contains(from), "{from}");
    refused(&URDF.replacen(from, to, 1), None, line, what);
}

fn broken_toml(toml: &str, line: usize, what: &str) {
    refused(URDF, Some(toml), line, what);
}

fn loaded(from: &str, to: &str, toml: Option<&str>) -> Robot {
    assert!(URDF.contains(from), "{from}");
    read(&URDF.replacen(from, to, 1), toml).unwrap_or_else(|error| panic!("{error}"))
}

/// One test for each way to break the URDF.
macro_rules! urdf_refused {
    ($($name:ident: $from:expr => $to:expr, $line:expr, $what:expr;)*) => {
        $(#[test] fn $name() { broken_urdf($from, $to, $line, $what); })*
    };
}

/// One test for each way to write a wrong TOML.
macro_rules! toml_refused {
    ($($name:ident: $toml:expr, $line:expr, $what:expr;)*) => {
        $(#[test] fn $name() { broken_toml($toml, $line, $what); })*
    };
}

urdf_refused! {
    text_that_is_no_xml_is_refused: "<link name=\"base\"/>" => "<link name=\"base\">", 37, "not XML";
    a_number_that_is_none_is_refused: "xyz=\"0 0 -0.2\"" => "xyz=\"0 0 low\"", 11, "is not a number";
    a_nan_is_refused: "ixx=\"0.01\"" => "ixx=\"NaN\"", 13, "is not finite";
    an_infinite_mass_is_refused: "mass value=\"1.0\"" => "mass value=\"inf\"", 12, "is not finite";
    an_absurdly_large_number_is_refused: "mass value=\"1.0\"" => "mass value=\"1e300\"", 12, "is too large";
    two_coordinates_are_refused: "xyz=\"0 0 -0.2\"" => "xyz=\"0 -0.2\"", 11, "wrong number of values";
    a_mass_without_value_is_refused: "mass value=\"1.0\"" => "mass", 12, "no `value`";
    an_inertial_without_inertia_is_refused: "<inertia ixx=\"0.01\" ixy=\"0\" ixz=\"0\" iyy=\"0.01\" iyz=\"0\" izz=\"0.01\"/>" => "", 10, "no <inertia>";
    a_joint_without_child_is_refused: "<child link=\"arm\"/>" => "", 3, "no <child>";
    an_unknown_parent_link_is_refused: "<parent link=\"base\"/>" => "<parent link=\"trunk\"/>", 4, "does not exist";
    an_unknown_joint_type_is_refused: "type=\"revolute\"" => "type=\"hinge\"", 1, "not a URDF";
    two_links_of_one_name_are_refused: "<link name=\"tip\"/>" => "<link name=\"tip\"/><link name=\"arm\"/>", 36, "two <link>";
    two_joints_of_one_name_are_refused: "joint name=\"slide\"" => "joint name=\"swing\"", 17, "two <joint>";
    a_link_with_two_parents_is_refused: "<child link=\"tip\"/>" => "<child link=\"arm\"/>", 29, "two parents";
    a_loop_of_links_is_refused: "<parent link=\"base\"/>" => "<parent link=\"rod\"/>", 3, "closes a loop";
    a_link_apart_is_refused: "<link name=\"tip\"/>" => "<link name=\"tip\"/>\n<link name=\"island\"/>", 37, "not connected";
    a_revolute_joint_without_limits_is_refused: "<limit lower=\"-1\" upper=\"1\" effort=\"5\" velocity=\"3\"/>" => "", 3, "no position limits";
    a_prismatic_joint_without_limits_is_refused: "<limit lower=\"-0.1\" upper=\"0.1\" effort=\"5\" velocity=\"1\"/>" => "", 17, "no position limits";
    limits_without_positions_are_refused: "lower=\"-1\" upper=\"1\"" => "", 3, "no position limits";
    exchanged_limits_are_refused: "lower=\"-1\" upper=\"1\"" => "lower=\"1\" upper=\"-1\"", 3, "is above";
    an_axis_of_zero_length_is_refused: "xyz=\"0 1 0\"" => "xyz=\"0 0 0\"", 3, "zero length";
    a_planar_joint_is_refused: "type=\"revolute\"" => "type=\"planar\"", 3, "not supported";
    a_floating_joint_inside_the_tree_is_refused: "type=\"prismatic\"" => "type=\"floating\"", 17, "floats";
    a_negative_effort_is_refused: "effort=\"5\"" => "effort=\"-5\"", 3, "negative";
    a_mimic_of_an_unknown_joint_is_refused: "mimic joint=\"swing\"" => "mimic joint=\"wing\"", 29, "does not exist";
    a_mimic_of_itself_is_refused: "mimic joint=\"swing\"" => "mimic joint=\"follower\"", 29, "mimics itself";
    a_negative_mass_is_refused: "mass value=\"1.0\"" => "mass value=\"-1.0\"", 9, "negative mass";
    an_inertia_without_mass_is_refused: "mass value=\"1.0\"" => "mass value=\"0\"", 9, "no mass";
    an_inertia_that_is_not_positive_definite_is_refused: "ixy=\"0\"" => "ixy=\"0.02\"", 9, "not positive definite";
    an_inertia_far_from_any_body_is_refused: "izz=\"0.01\"" => "izz=\"0.05\"", 9, "triangle inequality";
    a_collision_shape_without_size_is_refused: "box size=\"0.1 0.1 0.4\"" => "box size=\"0.1 0 0.4\"", 9, "without size";
    a_second_inertial_is_refused: "    <collision><geometry><box" => "    <inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>\n    <collision><geometry><box", 15, "a second <inertial>";
    a_mimic_that_follows_nothing_is_refused: "multiplier=\"-1\"" => "multiplier=\"0\"", 29, "a multiplier of 0";
    a_joint_that_moves_no_mass_is_refused: "<mimic joint=\"swing\" multiplier=\"-1\"/>" => "", 29, "no mass or inertia";
}

toml_refused! {
    an_unknown_key_is_refused: "[[joint]]\nmatch = [\"swing\"]\nstiffness = 3.0\n", 3, "unknown field `stiffness`";
    an_unknown_section_is_refused: "\n[feet]\nleft = 1\n", 2, "unknown field `feet`";
    a_wrong_type_is_refused: "[[joint]]\nmatch = [\"swing\"]\nkp = \"stiff\"\n", 3, "invalid type";
    a_syntax_error_is_refused: "base = \n", 1, "";
    an_unknown_base_is_refused: "base = \"wheels\"\n", 1, "unknown variant";
    a_joint_that_does_not_exist_is_refused: "[[joint]]\nmatch = [\"swing\",\n  \"knee\"]\n", 3, "no joint matches `knee`";
    a_locked_joint_that_does_not_exist_is_refused: "locked = [\"neck\"]\n", 1, "no joint matches `neck`";
    a_pattern_without_match_is_refused: "policy = [\"left_*\"]\n", 1, "no joint matches `left_*`";
    a_negative_gain_is_refused: "[[joint]]\nmatch = [\"swing\"]\nkp = -3.0\n", 3, "impossible value";
    a_nan_gain_is_refused: "[[joint]]\nmatch = [\"swing\"]\nkp = nan\n", 3, "impossible value";
    an_infinite_torque_is_refused: "[[joint]]\nmatch = [\"swing\"]\ntorque_limit = inf\n", 3, "impossible value";
    a_torque_limit_of_zero_is_refused: "[[joint]]\nmatch = [\"swing\"]\ntorque_limit = 0.0\n", 3, "impossible value";
    exchanged_toml_limits_are_refused: "[[joint]]\nmatch = [\"swing\"]\nlimits = [1.0, -1.0]\n", 3, "not below";
    a_nominal_position_outside_the_limits_is_refused: "[[joint]]\nmatch = [\"swing\"]\nnominal = 2.0\n", 3, "outside its limits";
    a_nominal_position_of_a_follower_is_refused: "[[joint]]\nmatch = [\"follower\"]\nnominal = 0.1\n", 3, "follows another joint";
    an_actuator_of_a_follower_is_refused: "[[joint]]\nmatch = [\"follower\"]\nkp = 0.1\n", 3, "follows another joint";
    a_follower_in_the_policy_is_refused: "policy = [\"follower\"]\n", 1, "does not move by itself";
    a_locked_joint_in_the_policy_is_refused: "locked = [\"slide\"]\npolicy = [\"slide\"]\n", 2, "does not move by itself";
    a_policy_joint_named_twice_is_refused: "policy = [\"swing\", \"swing\"]\n", 1, "named twice";
    a_foot_on_an_unknown_link_is_refused: "[[foot]]\nlink = \"shoe\"\nsole = [0.0, 0.0, 0.0]\nsize = [0.1, 0.1]\n", 2, "no link `shoe`";
    a_sole_without_area_is_refused: "[[foot]]\nlink = \"tip\"\nsole = [0.0, 0.0, 0.0]\nsize = [0.1, 0.0]\n", 4, "impossible value";
    an_overlap_with_an_unknown_link_is_refused: "overlap_pairs = [[\"arm\", \"leg\"]]\n", 1, "no link `leg`";
    an_overlap_of_a_link_with_itself_is_refused: "overlap_pairs = [[\"arm\", \"arm\"]]\n", 1, "one rigid body";
    two_feet_on_one_link_are_refused: "[[foot]]\nname = \"a\"\nlink = \"arm\"\nsole = [0.0, 0.0, -0.4]\nsize = [0.1, 0.1]\n[[foot]]\nname = \"b\"\nlink = \"arm\"\nsole = [0.0, 0.0, -0.4]\nsize = [0.1, 0.1]\n", 8, "on one link";
    a_foot_above_the_centre_of_mass_is_refused: "[[foot]]\nlink = \"arm\"\nsole = [0.0, 0.0, 0.4]\nsize = [0.1, 0.1]\n", 2, "above the robot's centre of mass";
    an_armature_of_a_ship_is_refused: "[[joint]]\nmatch = [\"swing\"]\narmature = 1e9\n", 3, "an armature of 1e9";
    a_mirror_of_one_word_is_refused: "[mirror]\nleft = \"swing\"\nright = \"swing\"\n", 3, "the same word";
    a_mirror_sign_of_two_is_refused: "[mirror]\nleft = \"l\"\nright = \"r\"\nsigns = { swing = 2.0 }\n", 4, "sign of 2";
    a_mirror_without_partner_is_refused: "[mirror]\nleft = \"swing\"\nright = \"swung\"\n", 2, "no partner";
    a_floating_base_without_mass_is_refused_in_the_urdf: "base = \"floating\"\n", 2, "has no mass";
}

#[test]
fn another_root_element_is_refused() {
    refused("<sdf version=\"1.6\"/>", None, 1, "root element is <sdf>");
}

#[test]
fn a_mimic_cycle_is_refused() {
    let urdf = URDF.replace(
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 0 1\"/><mimic joint=\"follower\"/>",
    );
    let urdf = urdf.replace("mimic joint=\"swing\"", "mimic joint=\"slide\"");
    refused(&urdf, None, 17, "mimics itself");
}

#[test]
fn a_follower_whose_limits_leave_its_leader_nowhere_is_refused() {
    let urdf = "<robot name=\"apart\"><link name=\"base\"/>\n\
        <joint name=\"leader\" type=\"revolute\"><parent link=\"base\"/><child link=\"one\"/><axis xyz=\"0 1 0\"/><limit lower=\"0\" upper=\"2\" effort=\"1\" velocity=\"1\"/></joint>\n\
        <link name=\"one\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\n\
        <joint name=\"follower\" type=\"revolute\"><parent link=\"one\"/><child link=\"two\"/><axis xyz=\"0 1 0\"/><mimic joint=\"leader\" multiplier=\"-1\"/><limit lower=\"0.1\" upper=\"2\" effort=\"1\" velocity=\"1\"/></joint>\n\
        <link name=\"two\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link></robot>";
    refused(urdf, None, 2, "no position");
}

#[test]
fn a_policy_joint_without_limits_is_refused() {
    let limits = "<limit lower=\"-1\" upper=\"1\" effort=\"5\" velocity=\"3\"/>";
    let urdf = URDF
        .replacen("revolute", "continuous", 1)
        .replacen(limits, "<limit effort=\"5\" velocity=\"3\"/>", 1);
    refused(&urdf, Some("policy = [\"swing\"]"), 1, "no position limits");
    let toml = "policy = [\"swing\"]\n[[joint]]\nmatch = [\"swing\"]\nlimits = [-2.0, 2.0]\n";
    let robot = read(&urdf, Some(toml)).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(robot.policy_joint(0).limits, (-2.0, 2.0));
}

#[test]
fn an_element_of_very_many_attributes_is_refused() {
    let attributes: String = (0..200_000).map(|i| format!(" a{i}=\"0\"")).collect();
    let urdf = format!("<robot name=\"wide\"><link name=\"base\"{attributes}/></robot>");
    refused(&urdf, None, 1, "more than 100 attributes");
}

#[test]
fn a_text_that_readers_of_xml_do_not_agree_on_is_refused() {
    // Found by fuzzing: what follows the second `<?` is another file to one of them.
    let urdf = format!("<?odd<?x><link name=\"other\"/><link version=\"1.0\"?>{URDF}");
    refused(&urdf, None, 2, "not the same to every reader");
}

#[test]
fn elements_nested_a_million_deep_are_refused() {
    let urdf = format!(
        "<robot name=\"deep\">{}{}</robot>",
        "<a>".repeat(1_000_000),
        "</a>".repeat(1_000_000)
    );
    refused(&urdf, None, 1, "nested");
}

#[test]
fn a_file_of_more_than_eight_mebibytes_is_refused() {
    let error = read(&" ".repeat((8 << 20) + 1), None).expect_err("too large");
    assert!(error.to_string().contains("larger than 8 MiB"), "{error}");
}

#[test]
fn missing_files_and_folders_without_urdf_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (path, what) in [
        (folder.path().join("none.urdf"), "none.urdf"),
        (folder.path().into(), "holds 0 .urdf files"),
    ] {
        let error = load(&path).expect_err("refused");
        assert!(error.to_string().contains(what), "{error}");
    }
}

#[test]
fn a_mass_that_an_exporter_left_beside_the_inertial_is_nothing() {
    let stray = URDF.replacen("    <collision>", "    <mass>7.5</mass>\n    <collision>", 1);
    assert_eq!(read(&stray, None).unwrap().mass(), read(URDF, None).unwrap().mass());
}

#[test]
fn the_unbroken_robot_loads_with_and_without_toml() {
    let robot = loaded("rig", "rig", None);
    assert_eq!((robot.base, robot.dofs.len(), robot.policy.len()), (Base::Fixed, 2, 2));
    assert!(
        robot
            .notes
            .iter()
            .any(|note| note.contains("gains of `swing` are guessed")),
        "{:?}",
        robot.notes
    );
    assert!(
        robot
            .notes
            .iter()
            .any(|note| note.contains("no collision shape") && note.contains("rod"))
    );
    let robot = loaded("rig", "rig", Some(TOML));
    let actuator = robot.policy_joint(0).actuator.expect("an actuator");
    assert_eq!(
        (actuator.kp, actuator.kd, actuator.torque_limit, actuator.speed_limit),
        (10.0, 0.1, 5.0, 3.0)
    );
}

#[test]
fn massless_frames_merge_and_massless_followers_stay() {
    let robot = loaded(
        "<link name=\"tip\"/>",
        "<link name=\"tip\"/><link name=\"frame\"/><joint name=\"weld\" type=\"fixed\"><parent link=\"tip\"/><child link=\"frame\"/></joint>",
        None,
    );
    assert_eq!(robot.links.len(), 4);
    let mimic = robot.joints[2].mimic.expect("a follower");
    assert_eq!((mimic.joint, mimic.multiplier, mimic.offset), (0, -1.0, 0.0));
    assert_eq!(robot.links[3].inertial.mass, 0.0);
}

#[test]
fn a_chain_of_followers_resolves_to_the_joint_that_moves() {
    let urdf = URDF.replace(
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 0 1\"/><mimic joint=\"swing\" multiplier=\"2\" offset=\"0.1\"/>",
    );
    let urdf = urdf.replace(
        "mimic joint=\"swing\" multiplier=\"-1\"",
        "mimic joint=\"slide\" multiplier=\"-3\" offset=\"0.5\"",
    );
    let robot = read(&urdf, None).unwrap_or_else(|error| panic!("{error}"));
    let mimic = robot.joints[2].mimic.expect("a follower");
    assert_eq!((mimic.joint, mimic.multiplier), (0, -6.0));
    assert!((mimic.offset - 0.2).abs() < 1e-12, "-3 x 0.1 + 0.5");
}

#[test]
fn a_locked_joint_is_welded_at_its_nominal_position() {
    let toml = "locked = [\"slide\"]\n[[joint]]\nmatch = [\"slide\"]\nnominal = 0.05\n";
    let robot = loaded("rig", "rig", Some(toml));
    assert_eq!(robot.links.len(), 3);
    let arm = &robot.links[1].inertial;
    assert!((arm.mass - 1.5).abs() < 1e-12);
    assert!((arm.com.z - (-0.2 + 0.5 * 0.05) / 1.5).abs() < 1e-12, "{}", arm.com);
    // Parallel axes: 1 kg at -0.2 m and 0.5 kg at 0.05 m are 0.25 m apart.
    let expected = 0.01 + 0.001 + 1.0 * 0.5 / 1.5 * 0.25 * 0.25;
    assert!((arm.inertia[(0, 0)] - expected).abs() < 1e-12, "{}", arm.inertia);
}

#[test]
fn a_floating_joint_from_the_world_makes_the_base_float() {
    let world = "<link name=\"world\"/><joint name=\"free\" type=\"floating\"><parent link=\"world\"/><child link=\"base\"/></joint>\n  <link name=\"base\"><inertial><mass value=\"2\"/><inertia ixx=\"0.1\" ixy=\"0\" ixz=\"0\" iyy=\"0.1\" iyz=\"0\" izz=\"0.1\"/></inertial></link>";
    let robot = loaded("<link name=\"base\"/>", world, None);
    assert_eq!((robot.base, robot.links[0].name.as_str()), (Base::Floating, "base"));
}

#[test]
fn an_inertia_slightly_off_loads_with_a_note() {
    let robot = loaded("izz=\"0.01\"", "izz=\"0.0201\"", None);
    assert!(
        robot.notes.iter().any(|note| note.contains("triangle inequality")),
        "{:?}",
        robot.notes
    );
}
