//! `omniwalk replay`: how far a robot's simulation is from logs of the real one.

use std::path::PathBuf;

use miette::IntoDiagnostic;
use omniwalk_sim2real::identify::{self, Replay};
use omniwalk_sim2real::recording;
use serde_json::json;

use super::load;
use crate::terminal::say;

/// Compares logs with the simulation: the logged commands go through actuators and engine at 1 kHz.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Logs: MCAP, or CSV and JSON with a column map.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The robot: a folder or a URDF.
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// The logs are of a robot on a stand: its base is held, its feet hang free.
    #[arg(long)]
    stand: bool,
    /// Column map.
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Also writes the result to FILE.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with logs, map or robot.
pub fn run(args: &Args) -> miette::Result<()> {
    let robot = load::held(&args.robot, args.stand)?;
    let map = args.map.as_deref().map(recording::Map::load).transpose()?;
    let recordings = load::recordings(&args.logs, map.as_ref())?;
    let Replay { measure, torque } = identify::replay(&robot, &recordings)?;
    say(format_args!(
        "{:<24} {:>12} {:>12} {:>14}",
        "joint", "rmse", "mae", "lacks (rms)"
    ))?;
    for (name, rmse) in &measure.rmse.0 {
        let lacks = torque.get(name).map_or(String::new(), |rms| format!("{rms:.4}"));
        say(format_args!(
            "{name:<24} {rmse:>12.5} {:>12.5} {lacks:>14}",
            measure.mae.0[name]
        ))?;
    }
    say("position in rad (m); torque that the simulation lacks to follow the logs in N m (N)")?;
    if let Some(file) = &args.json {
        let result = json!({
            "robot": robot.name,
            "logs": recordings.iter().map(|log| &log.name).collect::<Vec<_>>(),
            "rmse": measure.rmse,
            "mae": measure.mae,
            "by_quantity": measure.by_quantity,
            "torque_rms": torque,
        });
        load::write(file, &(serde_json::to_string_pretty(&result).into_diagnostic()? + "\n"))?;
    }
    Ok(())
}
