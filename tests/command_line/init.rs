//! `omniwalk init`: a robot folder from a URDF alone.

use std::fs;
use std::path::Path;

use super::support::{contents, omniwalk, refuses_in, robot, succeeds};

/// The URDF of one of the repository's robots, without its robot.toml.
fn urdf_of(name: &str, folder: &Path) {
    let file = format!("{name}.urdf");
    fs::copy(robot(name).join(&file), folder.join(&file)).unwrap();
}

/// The same without the collision shapes, like a robot whose shapes are all meshes.
fn without_shapes(name: &str, folder: &Path) {
    let text = fs::read_to_string(robot(name).join(format!("{name}.urdf"))).unwrap();
    let mut bare = String::new();
    for (i, part) in text.split("<collision>").enumerate() {
        let rest = if i == 0 {
            part
        } else {
            part.split_once("</collision>").unwrap().1
        };
        bare += rest;
    }
    assert!(!bare.contains("collision"));
    fs::write(folder.join("bare.urdf"), bare).unwrap();
}

/// Drafts the robot, has it described, and expects that it stands in both engines.
fn stands(folder: &Path, urdf: &str) -> String {
    let drafted = succeeds(folder, &["init", urdf, "--out", "drafted"]).out;
    assert!(drafted.contains("it stands 10 s in both engines"), "{drafted}");
    let described = succeeds(folder, &["inspect", "drafted"]).out;
    assert_eq!(
        described.matches("targets at the nominal pose   stands 10").count(),
        2,
        "{described}"
    );
    drafted
}

#[test]
fn a_drafted_robot_stands_and_trains() {
    let folder = tempfile::tempdir().unwrap();
    urdf_of("nimbro_op2x", folder.path());
    let drafted = stands(folder.path(), "nimbro_op2x.urdf");
    assert!(
        drafted.contains("`left` and `right`") && drafted.contains("left_ankle_roll_link and right_ankle_roll_link")
    );
    let small = [
        "--steps",
        "1024",
        "--set",
        "train.steps_per_update=16",
        "--set",
        "ppo.hidden=[16, 16]",
        "--quiet",
    ];
    succeeds(
        folder.path(),
        &[&["train", "drafted/train.toml", "--run", "run"], &small[..]].concat(),
    );
}

#[test]
fn feet_without_shapes_are_guessed_from_where_the_legs_end() {
    let folder = tempfile::tempdir().unwrap();
    without_shapes("nimbro_op2x", folder.path());
    let drafted = stands(folder.path(), "bare.urdf");
    assert!(drafted.contains("soles from where the legs end"), "{drafted}");
    let settings = fs::read_to_string(folder.path().join("drafted/robot.toml")).unwrap();
    assert!(settings.contains("[[foot]]"));
    for key in ["policy =", "overlap_pairs =", "nominal =", "kp =", "sole =", "size ="] {
        let mut lines = settings.lines().filter(|line| line.starts_with(key)).peekable();
        assert!(
            lines.peek().is_some() && lines.all(|line| line.contains("guess")),
            "{key} in\n{settings}"
        );
    }
}

#[test]
fn a_robot_without_legs_is_drafted_with_a_fixed_base() {
    let folder = tempfile::tempdir().unwrap();
    urdf_of("pendulum", folder.path());
    succeeds(folder.path(), &["init", "pendulum.urdf"]);
    let drafted = folder.path().join("robots/pendulum");
    assert!(
        fs::read_to_string(drafted.join("robot.toml"))
            .unwrap()
            .contains("base = \"fixed\"")
    );
    assert!(!drafted.join("train.toml").exists());
    succeeds(folder.path(), &["inspect", "robots/pendulum"]);
}

#[test]
fn what_is_there_is_not_overwritten_and_bad_files_leave_nothing() {
    refuses_in(
        |folder| fs::create_dir(folder.join("mine")).unwrap(),
        &["init", "a.urdf", "--out", "mine"],
        &["mine is there already", "--out"],
    );
    refuses_in(|_| (), &["init", "tiny.toml"], &["tiny.toml is not a .urdf file"]);
    refuses_in(
        |folder| fs::write(folder.join("a.urdf"), "<robot").unwrap(),
        &["init", "a.urdf"],
        &["a.urdf:1:"],
    );
    refuses_in(|_| (), &["init", "gone.urdf"], &["gone.urdf"]);
}

#[test]
fn the_same_urdf_gives_the_same_folder() {
    let folder = tempfile::tempdir().unwrap();
    urdf_of("nimbro_op2x", folder.path());
    let mut drafts = Vec::new();
    for _ in 0..2 {
        assert_eq!(
            omniwalk(folder.path(), &["init", "nimbro_op2x.urdf", "--out", "drafted"]).code,
            0
        );
        drafts.push(contents(&folder.path().join("drafted")));
        fs::remove_dir_all(folder.path().join("drafted")).unwrap();
    }
    assert!(drafts[0] == drafts[1]);
}

#[test]
fn joints_that_move_no_mass_are_locked_and_named() {
    let folder = tempfile::tempdir().unwrap();
    urdf_of("nimbro_op2x", folder.path());
    let path = folder.path().join("nimbro_op2x.urdf");
    let frame = "<link name=\"rod\"/>
        <joint name=\"rod_pitch\" type=\"continuous\"><parent link=\"trunk_link\"/><child link=\"rod\"/><axis xyz=\"0 1 0\"/></joint>
        </robot>";
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("</robot>", frame)).unwrap();
    let drafted = stands(folder.path(), "nimbro_op2x.urdf");
    assert!(drafted.contains("locked, as they move no mass: rod_pitch"), "{drafted}");
    let settings = fs::read_to_string(folder.path().join("drafted/robot.toml")).unwrap();
    assert!(settings.contains("locked = [\"rod_pitch\"] # guess"), "{settings}");
}
