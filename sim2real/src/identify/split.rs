//! What is fitted to, what is held out, and whether the logs can carry an answer at all.

use std::collections::{BTreeMap, BTreeSet};
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
            let split = 0.75 * cut::seconds(robot, log)?;
            fit.extend(cut::cut(robot, log, i, (0.0, split), lengths)?);
            heldout.extend(cut::cut(robot, log, i, (split, f64::INFINITY), lengths)?);
        } else if aside.contains(&i) {
            heldout.extend(cut::cut(robot, log, i, (0.0, f64::INFINITY), lengths)?);
        } else {
            fit.extend(cut::cut(robot, log, i, (0.0, f64::INFINITY), lengths)?);
        }
    }
    renumber(&mut fit);
    renumber(&mut heldout);
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

/// Numbers logs without gaps, and leaves out pieces without readings and what only some of the others measured beside motion.
fn renumber(trials: &mut Vec<Trial>) {
    trials.retain(|trial| trial.steps > 0 && !trial.readings.is_empty());
    let named = |trial: &Trial| -> BTreeSet<(Option<usize>, String)> {
        let names = trial.conditions.iter().map(|(joint, name, _)| (*joint, name.clone()));
        names.collect()
    };
    let common = trials.iter().map(named).reduce(|a, b| &a & &b).unwrap_or_default();
    for trial in trials.iter_mut() {
        let is_common = |(joint, name, _): &(Option<usize>, String, Vec<f64>)| common.contains(&(*joint, name.clone()));
        trial.conditions.retain(is_common);
    }
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
    let mut reasons = few_readings(robot, trials);
    let mut moving = 0;
    for d in 0..robot.dofs.len() {
        let name = &robot.dof(d).name;
        let readings: Vec<f64> = trials
            .iter()
            .flat_map(|trial| trial.readings.iter().filter(|r| r.dof == d).map(|r| r.position))
            .collect();
        let (low, high) = readings
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), &q| (l.min(q), h.max(q)));
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
    // Within a log, or from log to log: each may be one step.
    let told = |d: usize| {
        let commands = trials.iter().flat_map(|trial| &trial.told[d].command.mean);
        varies(commands.copied())
    };
    if reasons.is_empty() && !(0..robot.dofs.len()).any(told) && !released(trials) {
        reasons.push("no command changes: the logs show nothing but rest or motion from outside".into());
    }
    reasons
}

/// What is said of joints with too few readings in the time that is compared, once for those that have as few.
fn few_readings(robot: &Robot, trials: &[Trial]) -> Vec<String> {
    let compared = |trial: &Trial| {
        let first = trial.readings.first().map_or(trial.steps as f64, |reading| reading.at);
        (trial.steps as f64 - first) * DT
    };
    let seconds: f64 = trials.iter().map(compared).sum();
    let mut few: BTreeMap<usize, Vec<&str>> = BTreeMap::new();
    for d in 0..robot.dofs.len() {
        let own = trials
            .iter()
            .flat_map(|trial| &trial.readings)
            .filter(|reading| reading.dof == d);
        let count = own.count();
        if count < FEWEST || (count as f64) < SLOWEST * seconds {
            few.entry(count).or_default().push(&robot.dof(d).name);
        }
    }
    let said = few.into_iter().map(|(count, joints)| {
        let (joints, rate) = (joints.join(", "), count as f64 / seconds.max(DT));
        format!("{joints}: {count} readings, {rate:.1} a second; at least {FEWEST} and {SLOWEST} a second are needed")
    });
    said.collect()
}

fn varies(mut values: impl Iterator<Item = f64>) -> bool {
    let first = values.next();
    first.is_some_and(|first| values.any(|value| (value - first).abs() > 1e-9))
}

/// Whether a motor is off for a while: a free swing says something too.
fn released(trials: &[Trial]) -> bool {
    trials
        .iter()
        .flat_map(|trial| &trial.told)
        .any(|told| told.enabled.iter().any(|on| !on))
}
