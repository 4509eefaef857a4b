//! From the last choice to the outcome: errors on both sets of logs, the verdict, and everything with its name and unit.

use std::collections::BTreeMap;

use omniwalk_env::effect::{Kind, Site};
use omniwalk_env::robot::{JointKind, Robot};

use super::IdentifyError;
use super::cross::Folds;
use super::fit::Data;
use super::information::Information;
use super::leftover::{Floor, Leftover};
use super::measure::{Measure, measure, measure_each};
use super::model::Model;
use super::report::{Accepted, NoiseFloor, Outcome, Parameter, Rejected, Sets, Unexplained, Verdict};
use super::scales::Scales;
use super::select::Selection;
use super::split::Split;
use super::trial::Trial;
use crate::check::Check;

/// What an outcome is made of.
pub struct Parts<'a> {
    /// The nominal robot.
    pub robot: &'a Robot,
    /// The robot that was written.
    pub corrected: &'a Robot,
    /// Logs that were fitted.
    pub data: &'a Data,
    /// Typical values.
    pub scales: &'a Scales,
    /// Folds.
    pub folds: &'a Folds,
    /// The floor.
    pub floor: &'a Floor,
    /// The steps.
    pub selection: &'a Selection,
    /// What is left.
    pub left: &'a Leftover,
    /// Half widths of the last fit's intervals.
    pub intervals: &'a [f64],
    /// Sets of re-tuned numbers with the supply that would do the same.
    pub supplies: &'a [Vec<String>],
    /// Every effect at once, where that was asked for.
    pub all_at_once: Option<&'a Model>,
    /// What was set aside.
    pub split: &'a Split,
    /// What the logs can carry.
    pub check: &'a Check,
    /// What they can tell of the nominal model.
    pub information: &'a [Information],
}

/// The outcome, with the errors on `heldout`.
///
/// # Errors
/// When a held-out log does not fit the robot.
pub fn outcome(parts: Parts<'_>, heldout: Vec<Trial>) -> Result<Outcome, IdentifyError> {
    let Parts {
        robot,
        selection,
        left,
        data,
        ..
    } = parts;
    let sets = |model: &Model| -> Result<Sets, IdentifyError> {
        Ok(Sets {
            fit: measure_model(robot, model, &data.trials, data.finer)?,
            heldout: measure_model(robot, model, &heldout, data.finer)?,
        })
    };
    let (nominal, refit) = (sets(&Model::default())?, sets(&selection.refit.model)?);
    let last = Sets {
        fit: measure(parts.corrected, &data.trials, data.finer)?,
        heldout: measure(parts.corrected, &heldout, data.finer)?,
    };
    let (floor, source) = floor(&parts);
    let gap = |sets: &Sets| sets.heldout.overall() - floor;
    let gap_closed = (gap(&refit) > 0.0).then(|| 1.0 - gap(&last).max(0.0) / gap(&refit));
    let mut alike: Vec<Vec<String>> = selection.alike.iter().map(|alike| set(robot, alike)).collect();
    alike.extend_from_slice(parts.supplies);
    let in_set = |kind, target| selection.alike.iter().any(|a| a.chosen == (kind, target));
    let mut accepted = Vec::new();
    for (i, term) in selection.last.model.terms.iter().enumerate() {
        if in_set(term.kind, term.target) {
            continue;
        }
        let mut without = selection.last.model.clone();
        without.terms.remove(i);
        let without = data.fit(&without, parts.scales, &|_| true).model;
        accepted.push(Accepted {
            effect: term.kind.id(),
            target: target(robot, term.kind, term.target),
            parameters: parameters(&parts, i),
            heldout_rmse_before: measure_model(robot, &without, &heldout, data.finer)?.overall(),
            heldout_rmse_after: measure_model(robot, &selection.last.model, &heldout, data.finer)?.overall(),
            p_value: selection.p_values.get(i).copied().unwrap_or(1.0),
        });
    }
    let verdict = if left.structured {
        Verdict::Unexplained
    } else if !alike.is_empty() {
        Verdict::Indistinguishable
    } else if accepted.is_empty() {
        Verdict::NoMissingEffect
    } else {
        Verdict::Explained
    };
    let rejected = selection.rejected.iter().map(|r| Rejected {
        effect: r.kind.id(),
        target: target(robot, r.kind, r.target),
        reason: r.reason.clone(),
    });
    Ok(Outcome {
        robot: robot.name.clone(),
        verdict,
        reasons: Vec::new(),
        nominal,
        refit,
        last,
        all_effects: parts.all_at_once.map(sets).transpose()?,
        noise_floor: NoiseFloor {
            value: (floor > 0.0).then_some(floor),
            source,
        },
        gap_closed,
        accepted,
        rejected: rejected.collect(),
        indistinguishable: alike,
        unexplained: unexplained(&parts),
        retuned: retuned(&parts),
        heldout: parts.split.note.clone(),
        folds: parts.folds.by.clone(),
        tried: selection.tried,
        check: parts.check.clone(),
        information: parts.information.to_vec(),
        physics_hz: data.finer as f64 / super::DT,
        torque: left
            .joints
            .iter()
            .map(|left| (robot.dof(left.dof).name.clone(), left.moments.clone()))
            .collect(),
        trials: [data.trials.to_vec(), heldout],
    })
}

fn measure_model(robot: &Robot, model: &Model, trials: &[Trial], finer: usize) -> Result<Measure, IdentifyError> {
    let robots = trials
        .iter()
        .map(|trial| Ok((model.robot(&trial.robot(robot)?), trial)));
    let robots: Vec<(Robot, &Trial)> = robots.collect::<Result<_, super::TrialError>>()?;
    Ok(measure_each(robot, &robots, finer)?)
}

/// Root mean square floor over the joints of one unit, rad or m, and where it comes from.
fn floor(parts: &Parts<'_>) -> (f64, &'static str) {
    let robot = parts.robot;
    let turning = (0..robot.dofs.len()).any(|d| robot.dof(d).kind == JointKind::Revolute);
    let own: Vec<usize> = (0..robot.dofs.len())
        .filter(|&d| (robot.dof(d).kind == JointKind::Revolute) == turning)
        .collect();
    let squares: f64 = own.iter().map(|&d| parts.floor.of(d).powi(2)).sum();
    let value = (squares / own.len().max(1) as f64).sqrt();
    let repeats = own.iter().any(|&d| parts.floor.repeats[d].is_some());
    let source = match (value > 0.0, repeats) {
        (false, _) => "none",
        (true, true) => "repeats",
        (true, false) => "sensor",
    };
    (value, source)
}

fn target(robot: &Robot, kind: Kind, target: usize) -> String {
    match kind.info().site {
        Site::Joint => robot.dof(target).name.clone(),
        Site::Link => robot.links[target].name.clone(),
    }
}

/// The ids of a set, the one in the model first; where they are not all on one joint, with their targets.
fn set(robot: &Robot, alike: &super::select::Alike) -> Vec<String> {
    let all: Vec<(Kind, usize)> = [alike.chosen].into_iter().chain(alike.others.iter().copied()).collect();
    let mut names: Vec<String> = Vec::new();
    for (kind, at) in all {
        let elsewhere = kind.info().site == alike.chosen.0.info().site && at != alike.chosen.1;
        let name = if elsewhere {
            format!("{} of {}", kind.id(), target(robot, kind, at))
        } else {
            kind.id().to_owned()
        };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

fn interval(value: f64, half: f64) -> Option<[f64; 2]> {
    half.is_finite().then_some([value - half, value + half])
}

/// The parameters of the model's term `index`.
fn parameters(parts: &Parts<'_>, index: usize) -> BTreeMap<&'static str, Parameter> {
    let model = &parts.selection.last.model;
    let before: usize = model.terms[..index].iter().map(|term| term.free.len()).sum();
    let mut half = parts.intervals[model.tuned.len() + before..].iter();
    let term = &model.terms[index];
    let info = term.kind.info();
    let sliding = info.site == Site::Joint && parts.robot.dof(term.target).kind == JointKind::Prismatic;
    let number = |(i, parameter): (usize, &omniwalk_env::effect::Parameter)| {
        let half = if term.free.contains(&i) {
            half.next().copied().unwrap_or(f64::INFINITY)
        } else {
            f64::INFINITY
        };
        let value = Parameter {
            value: term.values[i],
            unit: parameter.scale.unit(sliding),
            ci95: interval(term.values[i], half),
        };
        (parameter.name, value)
    };
    info.parameters.iter().enumerate().map(number).collect()
}

fn retuned(parts: &Parts<'_>) -> BTreeMap<String, BTreeMap<&'static str, Parameter>> {
    let mut out: BTreeMap<String, BTreeMap<&'static str, Parameter>> = BTreeMap::new();
    for (tuned, &half) in parts.selection.last.model.tuned.iter().zip(parts.intervals) {
        let joint = parts.robot.dof(tuned.dof);
        let value = Parameter {
            value: tuned.value,
            unit: tuned.own.scale().unit(joint.kind == JointKind::Prismatic),
            ci95: interval(tuned.value, half),
        };
        out.entry(joint.name.clone())
            .or_default()
            .insert(tuned.own.key(), value);
    }
    out
}

fn unexplained(parts: &Parts<'_>) -> Unexplained {
    let (robot, left) = (parts.robot, parts.left);
    let mut named: Vec<(f64, String)> = Vec::new();
    if left.structured {
        for own in &left.joints {
            let power = own.moments.iter().map(|m| m.torque * m.torque).sum::<f64>() / own.moments.len().max(1) as f64;
            let share = power.sqrt() / parts.scales.joints[own.dof].torque;
            for dependence in &own.depends_on {
                let variable = &own.names[dependence.variable];
                let name = if robot.dofs.len() == 1 {
                    variable.clone()
                } else {
                    format!("{} of {}", variable, robot.dof(own.dof).name)
                };
                named.push((share * dependence.gain, name));
            }
        }
    }
    named.sort_by(|a, b| b.0.total_cmp(&a.0));
    let autocorrelation = left.autocorrelation.iter().enumerate();
    let mut depends_on: Vec<String> = Vec::new();
    for (_, name) in named {
        if !depends_on.contains(&name) {
            depends_on.push(name);
        }
    }
    Unexplained {
        fraction: if left.structured { left.fraction } else { 0.0 },
        depends_on,
        autocorrelation: autocorrelation
            .map(|(d, value)| (robot.dof(d).name.clone(), *value))
            .collect(),
    }
}
