//! Motions as files: MCAP for ROS tools, CSV for everything else, a table of what they show.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use omniwalk_env::robot::Robot;
use serde_json::json;

use super::{COMMAND_RATE, Motion, Plan};
use crate::log::messages::{Header, JointState};
use crate::log::{LogError, LogWriter, Message};

/// Writes `plan` for `robot` into `folder`: a `.mcap` and a `.csv` for each motion, and `motions.json`.
///
/// # Errors
/// [`LogError::Io`].
pub fn write(plan: &Plan, robot: &Robot, folder: &Path) -> Result<(), LogError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| LogError::Io { path, source }
    };
    fs::create_dir_all(folder).map_err(io(folder))?;
    let names: Vec<String> = (0..robot.policy.len())
        .map(|i| robot.policy_joint(i).name.clone())
        .collect();
    for motion in &plan.motions {
        log(motion, &names, &folder.join(format!("{}.mcap", motion.name)))?;
        let path = folder.join(format!("{}.csv", motion.name));
        fs::write(&path, table(motion, &names)).map_err(io(&path))?;
    }
    let motions = plan.motions.iter().map(|motion| {
        let seconds = motion.targets.len() as f64 / COMMAND_RATE;
        json!({ "name": motion.name, "seconds": seconds, "joints": motion.information })
    });
    let about = json!({ "robot": robot.name, "motions": motions.collect::<Vec<_>>(), "notes": plan.notes, "confused": plan.confused });
    let path = folder.join("motions.json");
    fs::write(&path, format!("{about:#}\n")).map_err(io(&path))
}

fn log(motion: &Motion, names: &[String], path: &Path) -> Result<(), LogError> {
    let mut log = LogWriter::create(path)?;
    let step = (1e9 / COMMAND_RATE) as u64;
    for (number, targets) in motion.targets.iter().enumerate() {
        // From one step on: a stamp of zero is none.
        let time = step * (number as u64 + 1);
        let command = JointState {
            header: Header::new(time, ""),
            name: names.to_vec(),
            position: targets.clone(),
            ..JointState::default()
        };
        log.write(time, &Message::JointCommands(command))?;
    }
    log.metadata("groups", BTreeMap::from([("motion".to_owned(), motion.name.clone())]))?;
    log.finish()
}

fn table(motion: &Motion, names: &[String]) -> String {
    let mut text = format!("t,{}\n", names.join(","));
    for (number, targets) in motion.targets.iter().enumerate() {
        let cells: Vec<String> = targets.iter().map(|target| format!("{target:.6}")).collect();
        // Writing to a string does not fail.
        let _ = writeln!(text, "{:.3},{}", number as f64 / COMMAND_RATE, cells.join(","));
    }
    text
}
