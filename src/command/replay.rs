//! `omniwalk replay`: how far a robot's simulation is from logs of the real one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, miette};
use omniwalk_sim2real::identify::{self, Replay};
use omniwalk_sim2real::recording;
use serde_json::json;

use super::load;
use crate::files::can_write;
use crate::report::identification::{self, figure};
use crate::terminal::{say, tell};

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
    /// Also writes a page with pictures to FILE: measured and simulated over time, spectra, what the simulation lacks over what it may depend on.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with logs, map or robot.
pub fn run(args: &Args) -> miette::Result<()> {
    let inputs = args.logs.iter().chain(&args.map).chain([&args.robot]);
    let outputs: Vec<&Path> = args.json.iter().chain(&args.html).map(PathBuf::as_path).collect();
    load::writable(&outputs, &inputs.map(PathBuf::as_path).collect::<Vec<_>>())?;
    outputs.iter().try_for_each(|file| can_write(file))?;
    let robot = load::held(&args.robot, args.stand)?;
    let map = args.map.as_deref().map(recording::Map::load).transpose()?;
    let recordings = load::recordings(&args.logs, map.as_ref())?;
    let replayed = identify::replay(&robot, &recordings)?;
    let Replay {
        check,
        measure,
        lacking,
        ..
    } = &replayed;
    tell(check.to_string().trim_end());
    if measure.rmse.0.is_empty() {
        return Err(miette!(
            help = "readings too close to a log's start cannot be: nobody knows what came before; record a few seconds",
            "no reading of these logs can be compared"
        ));
    }
    let torque = lacking.iter().filter_map(|own| Some((own.joint.as_str(), own.root()?)));
    let torque: BTreeMap<&str, f64> = torque.collect();
    say(format_args!(
        "{:<24} {:>12} {:>12} {:>14}",
        "joint", "rmse", "mae", "lacks (rms)"
    ))?;
    for (name, rmse) in &measure.rmse.0 {
        let lacks = torque.get(name.as_str()).copied().map_or(String::new(), figure);
        say(format_args!(
            "{name:<24} {:>12} {:>12} {lacks:>14}",
            figure(*rmse),
            figure(measure.mae.0[name])
        ))?;
    }
    say("position in rad (m); torque that the simulation lacks to follow the logs in N m (N)")?;
    for (name, errors) in measure.by_quantity.iter().filter(|(name, _)| *name != "joint_position") {
        say(format_args!(
            "{:<24} {:>12} {:>12}",
            name,
            figure(errors["rmse"]),
            figure(errors["mae"])
        ))?;
    }
    if let Some(file) = &args.json {
        let result = json!({
            "robot": robot.name,
            "logs": recordings.iter().map(|log| &log.name).collect::<Vec<_>>(),
            "check": check,
            "rmse": measure.rmse,
            "mae": measure.mae,
            "by_quantity": measure.by_quantity,
            "lacking": lacking,
        });
        load::write(file, &(serde_json::to_string_pretty(&result).into_diagnostic()? + "\n"))?;
    }
    if let Some(file) = &args.html {
        load::write(file, &identification::replay(&robot.name, &replayed)?)?;
    }
    if check.unfounded().next().is_some() {
        return Err(miette!(
            help = "what is refused above says what is wrong with which log, and what would be right",
            "these logs are not what they should be: the errors say nothing of the simulation"
        ));
    }
    Ok(())
}
