//! Hinges that swing, for tests.

use std::sync::Arc;

use omniwalk_env::robot::{Robot, load};

use super::cut::{self, Lengths};
use super::fit::Data;
use super::model::Model;
use super::trial::Trial;
use crate::recording::{JointRecord, Recording, Series};

/// What moves with the hinge called `name`, and that, on `parent`.
fn link(parent: &str, name: &str) -> String {
    format!(
        r#"<link name="of_{name}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="of_{name}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="8"/></joint>"#
    )
}

/// The robot of one, with `settings` of the joint.
pub fn robot(settings: &str) -> Robot {
    chain(&["hinge"], settings)
}

/// The robot of several `hinges`, one after the other, with `settings` of each.
pub fn chain(hinges: &[&str], settings: &str) -> Robot {
    let parents = ["base".to_owned()]
        .into_iter()
        .chain(hinges.iter().map(|name| format!("of_{name}")));
    let links: String = parents.zip(hinges).map(|(parent, name)| link(&parent, name)).collect();
    let folder = tempfile::tempdir().expect("a folder");
    let urdf = format!(r#"<robot name="arm"><link name="base"/>{links}</robot>"#);
    std::fs::write(folder.path().join("arm.urdf"), urdf).expect("written");
    let toml = format!("base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\n{settings}");
    std::fs::write(folder.path().join("robot.toml"), toml).expect("written");
    load(folder.path()).expect("a robot")
}

/// So many `logs` of 8 s at 200 Hz of swings that follow their commands at once, in blocks and pieces of `lengths`.
pub fn swings(robot: &Robot, logs: usize, lengths: Lengths) -> Data {
    let time: Vec<f64> = (0..1600).map(|k| f64::from(k) * 5e-3).collect();
    let value = time.iter().map(|t| (3.0 * t).sin()).collect();
    let series = Series { time, value };
    let joint = |d: usize| JointRecord {
        name: robot.dof(d).name.clone(),
        command: series.clone(),
        position: series.clone(),
        ..JointRecord::default()
    };
    let log = Recording {
        name: "log".into(),
        joints: (0..robot.dofs.len()).map(joint).collect(),
        ..Recording::default()
    };
    let cut = |index| cut::cut(robot, &log, index, (0.0, f64::INFINITY), lengths).expect("trials");
    let trials: Vec<Trial> = (0..logs).flat_map(cut).collect();
    Data::new(robot, trials).expect("data")
}

/// Reads in `data` what `truth` predicts, 0.2 mrad above or half of that below.
pub fn read(data: &mut Data, truth: &Model) {
    let predictions = data.predict(std::slice::from_ref(truth));
    for (trial, parts) in Arc::make_mut(&mut data.trials).iter_mut().zip(&predictions) {
        let width = parts[0].len() / trial.readings.len();
        for (i, reading) in trial.readings.iter_mut().enumerate() {
            let noise = if i * 7 % 3 == 0 { 2e-4 } else { -1e-4 };
            reading.position = parts[0][i * width] + noise;
        }
    }
}
