//! A hinge that swings, for tests.

use omniwalk_env::robot::{Robot, load};

use super::cut::{self, Lengths};
use super::fit::Data;
use super::trial::Trial;
use crate::recording::{JointRecord, Recording, Series};

const URDF: &str = r#"<robot name="arm"><link name="base"/>
<link name="arm"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="8"/></joint></robot>"#;

/// Its robot, with `settings` of the joint.
pub fn robot(settings: &str) -> Robot {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("arm.urdf"), URDF).expect("written");
    let toml = format!("base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\n{settings}");
    std::fs::write(folder.path().join("robot.toml"), toml).expect("written");
    load(folder.path()).expect("a robot")
}

/// So many `logs` of 8 s at 200 Hz of a swing that follows its command at once, in blocks and pieces of `lengths`.
pub fn swings(robot: &Robot, logs: usize, lengths: Lengths) -> Data {
    let time: Vec<f64> = (0..1600).map(|k| f64::from(k) * 5e-3).collect();
    let value = time.iter().map(|t| (3.0 * t).sin()).collect();
    let series = Series { time, value };
    let hinge = JointRecord {
        name: "hinge".into(),
        command: series.clone(),
        position: series,
        ..JointRecord::default()
    };
    let log = Recording {
        name: "log".into(),
        joints: vec![hinge],
        ..Recording::default()
    };
    let cut = |index| cut::cut(robot, &log, index, (0.0, f64::INFINITY), lengths).expect("trials");
    let trials: Vec<Trial> = (0..logs).flat_map(cut).collect();
    Data::new(robot, trials).expect("data")
}
