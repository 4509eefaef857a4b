//! What is fitted to, what is held out, and whether the logs can carry an answer at all.

use std::collections::BTreeSet;
use std::sync::Arc;

use omniwalk_env::robot::{Base, Robot};

use super::cut::{self, Lengths};
use super::fit::Data;
use super::model::Model;
use super::trial::{DT, Trial, TrialError};
use super::{contact, noise, windows};
use crate::recording::Recording;

/// Shortest time of all logs together, s.
const SHORTEST: f64 = 3.0;
/// Fewest readings of a joint.
const FEWEST: usize = 100;
/// Slowest readings, Hz.
const SLOWEST: f64 = 8.0;
/// No joint is farther from zero, rad or m.
const FARTHEST: f64 = 1e4;
/// A joint moves when its range is so many times its noise.
const MOVES: f64 = 10.0;

/// What is fitted to and what is held out.
pub struct Split {
    /// Pieces of logs to fit.
    pub fit: Vec<Trial>,
    /// Pieces set aside; empty when other logs are held out.
    pub heldout: Vec<Trial>,
    /// What was set aside, for the report.
    pub note: String,
}

/// Splits `logs`; `given` when other logs are held out. Without, the last group of logs, or the last quarter of the logs
/// or of the time, is set aside.
///
/// # Errors
/// [`TrialError`] when a log is not one of this robot.
pub fn split(robot: &Robot, logs: &[Recording], given: bool) -> Result<Split, TrialError> {
    if given {
        return Ok(Split {
            fit: cut_all(robot, logs, lengths(robot, logs))?,
            heldout: Vec::new(),
            note: "logs that were named as held out".into(),
        });
    }
    let (aside, note) = aside(logs);
    let lengths = lengths(robot, logs);
    let (mut fit, mut heldout) = (Vec::new(), Vec::new());
    for (i, log) in logs.iter().enumerate() {
        if aside.is_empty() {
            let split = 0.75 * log.duration();
            fit.extend(cut::cut(robot, log, i, (0.0, split), lengths)?);
            heldout.extend(cut::cut(robot, log, i, (split, f64::INFINITY), lengths)?);
        } else if aside.contains(&i) {
            heldout.extend(cut::cut(robot, log, i, (0.0, f64::INFINITY), lengths)?);
        } else {
            fit.extend(cut::cut(robot, log, i, (0.0, f64::INFINITY), lengths)?);
        }
    }
    renumber(&mut fit);
    Ok(Split { fit, heldout, note })
}

/// Leaves those of `trials` that can say something of a robot that walks freely: about which models of contact agree, and which are
/// not far off as a fall is. All where the base is held. Starts are fitted under the nominal model.
///
/// # Errors
/// When a log is not one of this robot, or an engine does not take the robot.
pub fn agreed(robot: &Robot, trials: Vec<Trial>) -> Result<Vec<Trial>, super::IdentifyError> {
    if robot.base != Base::Floating {
        return Ok(trials);
    }
    let mut data = Data::new(robot, trials)?;
    data.fit_starts(&Model::default())?;
    let mut trials = Arc::unwrap_or_clone(data.trials);
    contact::keep_agreed(&mut trials, &data.robots)?;
    let data = Data::new(robot, trials)?;
    let mut trials = Arc::unwrap_or_clone(data.trials);
    contact::keep_usual(&mut trials, &data.robots)?;
    renumber(&mut trials);
    Ok(trials)
}

/// All of `logs`, as long at a stretch as they can be followed.
///
/// # Errors
/// [`TrialError`] when a log is not one of this robot.
pub fn all(robot: &Robot, logs: &[Recording]) -> Result<Vec<Trial>, TrialError> {
    let piece = f64::INFINITY;
    cut_all(
        robot,
        logs,
        Lengths {
            block: block(seconds(logs)),
            piece,
        },
    )
}

fn cut_all(robot: &Robot, logs: &[Recording], lengths: Lengths) -> Result<Vec<Trial>, TrialError> {
    let mut trials = Vec::new();
    for (i, log) in logs.iter().enumerate() {
        trials.extend(cut::cut(robot, log, i, (0.0, f64::INFINITY), lengths)?);
    }
    renumber(&mut trials);
    Ok(trials)
}

/// Numbers logs without gaps, and leaves out pieces without readings.
fn renumber(trials: &mut Vec<Trial>) {
    trials.retain(|trial| trial.steps > 0 && !trial.readings.is_empty());
    let logs: BTreeSet<usize> = trials.iter().map(|trial| trial.log).collect();
    let order: Vec<usize> = logs.into_iter().collect();
    for trial in trials {
        trial.log = order.iter().position(|&log| log == trial.log).unwrap_or(0);
    }
}

fn seconds(logs: &[Recording]) -> f64 {
    logs.iter().map(Recording::duration).sum()
}

/// What logs to fit are cut into: windows to choose from where they hold more than a search follows.
fn lengths(robot: &Robot, logs: &[Recording]) -> Lengths {
    let (all, most) = (seconds(logs), windows::most(robot));
    let piece = if all > most { windows::LENGTH } else { f64::INFINITY };
    Lengths {
        block: block(all.min(most)),
        piece,
    }
}

/// Length of a block of time, s: some 60 of `seconds`, from half a second to five.
fn block(seconds: f64) -> f64 {
    (seconds / 60.0).clamp(0.5, 5.0)
}

/// The logs that are set aside, none to set aside the last quarter of the time of each, and what that is called.
fn aside(logs: &[Recording]) -> (Vec<usize>, String) {
    let keys: BTreeSet<&String> = logs.iter().flat_map(|log| log.groups.keys()).collect();
    for key in keys {
        let values: BTreeSet<Option<&String>> = logs.iter().map(|log| log.groups.get(key)).collect();
        let last = values.iter().next_back().copied().flatten();
        let Some(last) = last.filter(|_| values.len() >= 3 && !values.contains(&None)) else {
            continue;
        };
        let own: Vec<usize> = (0..logs.len())
            .filter(|&i| logs[i].groups.get(key) == Some(last))
            .collect();
        if own.len() * 2 <= logs.len() {
            return (
                own,
                format!("the logs whose {key} is {last}, the last of {}", values.len()),
            );
        }
    }
    if logs.len() >= 4 {
        let quarter = logs.len() / 4;
        let note = format!("the last {quarter} of {} logs", logs.len());
        return ((logs.len() - quarter..logs.len()).collect(), note);
    }
    (Vec::new(), "the last quarter of the time of each log".into())
}

/// Why `trials` cannot carry an answer; empty when they can.
pub fn insufficient(robot: &Robot, trials: &[Trial]) -> Vec<String> {
    // An empty sum is minus zero.
    let seconds = trials.iter().map(|trial| trial.steps as f64 * DT).sum::<f64>() + 0.0;
    if seconds < SHORTEST {
        return vec![format!(
            "the logs hold {seconds:.2} s to fit to; at least {SHORTEST} s are needed, and 20 s are good"
        )];
    }
    let mut reasons = Vec::new();
    let mut moving = 0;
    for d in 0..robot.dofs.len() {
        let name = &robot.dof(d).name;
        let readings: Vec<f64> = trials
            .iter()
            .flat_map(|trial| trial.readings.iter().filter(|r| r.dof == d).map(|r| r.position))
            .collect();
        let rate = readings.len() as f64 / seconds;
        if readings.len() < FEWEST || rate < SLOWEST {
            reasons.push(format!(
                "joint `{name}` has {} readings, {rate:.1} a second; at least {FEWEST} and {SLOWEST} a second are needed",
                readings.len()
            ));
            continue;
        }
        let (low, high) = readings
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), &q| (l.min(q), h.max(q)));
        if let Some(ratio) = degrees(trials, d, high - low) {
            reasons.push(format!(
                "joint `{name}` moves {ratio:.0} times as far as it is told to: positions look like degrees, commands like rad"
            ));
            continue;
        }
        let noise = noise::sensor(trials, d);
        if readings.iter().any(|q| !q.is_finite() || q.abs() > FARTHEST) {
            reasons.push(format!(
                "joint `{name}` is measured from {low} to {high}: no joint's position"
            ));
        } else if high > low && high - low > MOVES * noise {
            moving += 1;
        }
    }
    if reasons.is_empty() && moving == 0 {
        reasons.push("no joint moves beyond its noise: send commands that move them (omniwalk excite)".into());
    }
    let told = |d: usize| trials.iter().any(|trial| varies(&trial.told[d].command));
    if reasons.is_empty() && !(0..robot.dofs.len()).any(told) && !released(trials) {
        reasons.push("no command changes: the logs show nothing but rest or motion from outside".into());
    }
    reasons
}

/// The range of the readings over that of the commands, where it looks like degrees over radians.
fn degrees(trials: &[Trial], d: usize, range: f64) -> Option<f64> {
    let told = trials.iter().map(|trial| &trial.told[d]).filter(|told| !told.effort);
    let commands = told.flat_map(|told| &told.command).copied();
    let (low, high) = commands.fold((f64::MAX, f64::MIN), |(l, h), c| (l.min(c), h.max(c)));
    let ratio = range / (high - low);
    (high > low && (25.0..100.0).contains(&ratio)).then_some(ratio)
}

fn varies(values: &[f64]) -> bool {
    values.iter().any(|v| (v - values[0]).abs() > 1e-9)
}

/// Whether a motor is off for a while: a free swing says something too.
fn released(trials: &[Trial]) -> bool {
    trials
        .iter()
        .flat_map(|trial| &trial.told)
        .any(|told| told.enabled.iter().any(|on| !on))
}
