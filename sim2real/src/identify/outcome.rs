//! From the last choice to the outcome: errors on both sets of logs, the verdict, and everything with its name and unit.

use std::collections::BTreeMap;

use omniwalk_env::effect::{Kind, Site};
use omniwalk_env::robot::{JointKind, Robot};

use super::IdentifyError;
use super::found::Found;
use super::heldout::Heldout;
use super::leftover::Left;
use super::measure::{Measure, measure_each};
use super::model::{Model, Term};
use super::motion;
use super::own::Own;
use super::report::{
    Accepted, Alternative, JointGap, MeasuredTable, NoiseFloor, Outcome, Parameter, Rejected, Sets, Unexplained,
    Verdict,
};
use super::split::Split;
use super::torque::Dependence;
use super::trial::{Trial, TrialError};
use crate::check::Check;

/// What an outcome is made of.
pub struct Parts<'a> {
    /// The nominal robot.
    pub robot: &'a Robot,
    /// The robot that was written.
    pub corrected: &'a Robot,
    /// What was found.
    pub found: &'a Found,
    /// Pieces of logs that were fitted.
    pub fitted: &'a [Trial],
    /// What was set aside.
    pub split: &'a Split,
    /// What the logs can carry.
    pub check: &'a Check,
}

/// The outcome, with the errors on `heldout`.
///
/// # Errors
/// When a held-out log does not fit the robot.
pub fn outcome(parts: Parts<'_>, heldout: Heldout) -> Result<Outcome, IdentifyError> {
    let Heldout {
        trials: heldout,
        left_out,
        error,
    } = heldout;
    let Parts {
        robot, found, split, ..
    } = parts;
    let sets = |model: &Model| -> Result<Sets, IdentifyError> {
        Ok(Sets {
            fit: measured(robot, model, parts.fitted, found.finer)?,
            heldout: measured(robot, model, &heldout, found.finer)?,
        })
    };
    let (nominal, refit) = (sets(&Model::default())?, sets(&found.refit)?);
    let last = Sets {
        fit: measured(parts.corrected, &Model::default(), parts.fitted, found.finer)?,
        heldout: measured(parts.corrected, &Model::default(), &heldout, found.finer)?,
    };
    let (floor, source) = floor(&parts);
    let gap_closed = closed([&refit, &last].map(|sets| sets.heldout.overall()), floor);
    let by_joint = by_joint(&parts, &refit, &last);
    let mut alike: Vec<Vec<String>> = found.alike.iter().map(|alike| set(robot, alike)).collect();
    alike.extend_from_slice(&found.causes);
    let accepted = accepted(&parts, &heldout)?;
    let rejected = found.rejected.iter().map(|r| Rejected {
        effect: r.kind.id(),
        target: target(robot, r.kind, r.target),
        reason: reason(&parts, r),
    });
    Ok(Outcome {
        robot: robot.name.clone(),
        verdict: verdict(found, &alike, &accepted),
        reasons: Vec::new(),
        nominal,
        refit,
        last,
        all_effects: found.all_at_once.as_ref().map(sets).transpose()?,
        noise_floor: NoiseFloor {
            value: (floor > 0.0).then_some(floor),
            source,
        },
        gap_closed,
        by_joint,
        accepted,
        rejected: rejected.collect(),
        indistinguishable: alike,
        alternatives: found.alike.iter().map(|alike| alternatives(&parts, alike)).collect(),
        separation: found.separations.clone(),
        unexplained: unexplained(&parts),
        tables: tables(&parts),
        retuned: retuned(&parts),
        heldout: [vec![split.note.clone()], left_out].concat().join("; left out: "),
        folds: found.folds.clone(),
        tried: found.tried,
        check: parts.check.clone(),
        information: found.information.clone(),
        physics_hz: found.finer as f64 / super::DT,
        lacking: found.left.joints.iter().map(|left| left.lacking(robot)).collect(),
        heldout_error: error,
        trials: [parts.fitted.to_vec(), heldout],
    })
}

/// The effects that were accepted by themselves, with the errors of `heldout` with and without each.
fn accepted(parts: &Parts<'_>, heldout: &[Trial]) -> Result<Vec<Accepted>, IdentifyError> {
    let Parts { robot, found, .. } = *parts;
    let error = |model: &Model| Ok::<_, IdentifyError>(measure_model(robot, model, heldout, found.finer)?.overall());
    let in_set = |kind, target| found.alike.iter().any(|alike| alike.chosen == (kind, target));
    let alone = found.last.terms.iter().enumerate();
    let alone: Vec<_> = alone.filter(|(_, term)| !in_set(term.kind, term.target)).collect();
    if alone.is_empty() {
        return Ok(Vec::new());
    }
    let after = error(&found.last)?;
    let one = |(i, term): (usize, &Term)| {
        Ok(Accepted {
            effect: term.kind.id(),
            target: target(robot, term.kind, term.target),
            parameters: parameters(parts, i),
            heldout_rmse_before: error(&found.without[i])?,
            heldout_rmse_after: after,
            p_value: found.p_values.get(i).copied().unwrap_or(1.0),
        })
    };
    alone.into_iter().map(one).collect()
}

fn verdict(found: &Found, alike: &[Vec<String>], accepted: &[Accepted]) -> Verdict {
    if found.left.structured().next().is_some() {
        Verdict::Unexplained
    } else if !alike.is_empty() {
        Verdict::Indistinguishable
    } else if accepted.is_empty() {
        Verdict::NoMissingEffect
    } else {
        Verdict::Explained
    }
}

/// Share of the gap between the error `before` and the floor that is gone `after`; none where there was none, or an error is not known.
fn closed([before, after]: [f64; 2], floor: f64) -> Option<f64> {
    let gap = before - floor;
    (gap > 0.0 && after.is_finite()).then(|| 1.0 - (after - floor).max(0.0) / gap)
}

/// The floor of every joint and the share of its gap that is closed.
fn by_joint(parts: &Parts<'_>, refit: &Sets, last: &Sets) -> BTreeMap<String, JointGap> {
    let one = |d: usize| {
        let name = &parts.robot.dof(d).name;
        let floor = parts.found.floor.of(d);
        let error = |sets: &Sets| sets.heldout.rmse.0.get(name).copied().unwrap_or(f64::NAN);
        let gap = JointGap {
            noise_floor: floor,
            gap_closed: closed([error(refit), error(last)], floor),
        };
        (name.clone(), gap)
    };
    (0..parts.robot.dofs.len()).map(one).collect()
}

/// How far `model` of `robot` is from `trials` in every quantity that was measured.
///
/// # Errors
/// When a log overrides what the robot does not have, or an engine does not take the robot.
pub fn measured(robot: &Robot, model: &Model, trials: &[Trial], finer: usize) -> Result<Measure, IdentifyError> {
    let robots = robots(robot, model, trials)?;
    let mut measure = measure_each(robot, &robots, finer)?;
    measure.by_quantity.extend(motion::errors(robot, &robots, finer)?);
    Ok(measure)
}

/// `model` of `robot` as it was in each of `trials`.
fn robots<'a>(robot: &Robot, model: &Model, trials: &'a [Trial]) -> Result<Vec<(Robot, &'a Trial)>, TrialError> {
    let own = |trial: &'a Trial| Ok((trial.robot(robot)?.with(model), trial));
    trials.iter().map(own).collect()
}

fn measure_model(robot: &Robot, model: &Model, trials: &[Trial], finer: usize) -> Result<Measure, IdentifyError> {
    Ok(measure_each(robot, &robots(robot, model, trials)?, finer)?)
}

/// Root mean square floor over the joints of one unit, rad or m, and where it comes from.
fn floor(parts: &Parts<'_>) -> (f64, &'static str) {
    let robot = parts.robot;
    let turning = (0..robot.dofs.len()).any(|d| robot.dof(d).kind == JointKind::Revolute);
    let own: Vec<usize> = (0..robot.dofs.len())
        .filter(|&d| (robot.dof(d).kind == JointKind::Revolute) == turning)
        .collect();
    let squares: f64 = own.iter().map(|&d| parts.found.floor.of(d).powi(2)).sum();
    let value = (squares / own.len().max(1) as f64).sqrt();
    let repeats = own.iter().any(|&d| parts.found.floor.repeats[d].is_some());
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
    let model = &parts.found.last;
    let term = &model.terms[index];
    let halves = term.free.iter().zip(model.of_term(index, &parts.found.intervals));
    let half = |i: usize| {
        halves
            .clone()
            .find(|(free, _)| **free == i)
            .map_or(f64::INFINITY, |(_, half)| *half)
    };
    named(parts.robot, (term.kind, term.target), &term.values, half)
}

/// `values` of an effect on its target by name, with half widths of intervals.
fn named(
    robot: &Robot,
    (kind, target): (Kind, usize),
    values: &[f64],
    half: impl Fn(usize) -> f64,
) -> BTreeMap<&'static str, Parameter> {
    let info = kind.info();
    let sliding = info.site == Site::Joint && robot.dof(target).kind == JointKind::Prismatic;
    let number = |((i, parameter), &value): ((usize, &omniwalk_env::effect::Parameter), &f64)| {
        let value = Parameter {
            value,
            unit: parameter.scale.unit(sliding),
            ci95: interval(value, half(i)),
        };
        (parameter.name, value)
    };
    info.parameters.iter().enumerate().zip(values).map(number).collect()
}

/// What each effect of a set would be.
fn alternatives(parts: &Parts<'_>, alike: &super::select::Alike) -> Vec<Alternative> {
    let robot = parts.robot;
    let of = |(kind, at): (Kind, usize), parameters, in_robot| Alternative {
        effect: kind.id(),
        target: target(robot, kind, at),
        parameters,
        in_robot,
    };
    let terms = &parts.found.last.terms;
    let index = terms.iter().position(|term| (term.kind, term.target) == alike.chosen);
    let chosen = index.map(|index| of(alike.chosen, parameters(parts, index), true));
    let others = alike.others.iter().zip(&alike.values);
    let others = others.map(|(&own, values)| of(own, named(robot, own, values, |_| f64::INFINITY), false));
    chosen.into_iter().chain(others).collect()
}

/// What the nominal model has as it was written: with the effects, or beside a table.
fn retuned(parts: &Parts<'_>) -> BTreeMap<String, BTreeMap<String, Parameter>> {
    let mut out: BTreeMap<String, BTreeMap<String, Parameter>> = BTreeMap::new();
    let written = &parts.found.left.model;
    for (tuned, &half) in written.tuned.iter().zip(&parts.found.intervals) {
        let joint = parts.robot.dof(tuned.dof);
        let tabled = written.has(Kind::ResidualTorque, tuned.dof);
        // An interval that has every lower limit as well says that none was met.
        let is_limit = matches!(tuned.own, Own::TorqueLimit | Own::SpeedLimit);
        let tells = |[low, _]: &[f64; 2]| !tabled && (!is_limit || *low > 0.0);
        let value = Parameter {
            value: tuned.value,
            unit: tuned.own.scale().unit(joint.kind == JointKind::Prismatic),
            ci95: interval(tuned.value, half).filter(tells),
        };
        out.entry(joint.name.clone())
            .or_default()
            .insert(tuned.own.name(), value);
    }
    out
}

fn tables(parts: &Parts<'_>) -> Vec<MeasuredTable> {
    let terms = parts.found.left.model.terms.iter();
    let tables = terms.filter_map(|term| Some((term, term.table.as_ref()?)));
    let said = tables.map(|(term, table)| MeasuredTable {
        joint: parts.robot.dof(term.target).name.clone(),
        over: table.axes[0].0.name(),
        friction: table.friction,
        grid: table.axes[0].1.clone(),
        values: term.values.clone(),
    });
    said.collect()
}

/// Why an effect was not taken; of one that stands in a set with one that was, that they cannot be told apart.
fn reason(parts: &Parts<'_>, rejected: &super::select::Rejected) -> String {
    let own = (rejected.kind, rejected.target);
    match parts.found.alike.iter().find(|alike| alike.others.contains(&own)) {
        Some(alike) => format!("predicts as well as {}: they cannot be told apart", alike.chosen.0.id()),
        None => rejected.reason.clone(),
    }
}

fn unexplained(parts: &Parts<'_>) -> Unexplained {
    let (robot, left) = (parts.robot, &parts.found.left);
    let name = |own: &Left, dependence: &Dependence| {
        let variable = &own.names[dependence.variable];
        if robot.dofs.len() == 1 {
            variable.clone()
        } else {
            format!("{} of {}", variable, robot.dof(own.dof).name)
        }
    };
    let mut named: Vec<(f64, String)> = Vec::new();
    for own in left.structured() {
        let all = own.leading.iter().chain(&own.depends_on);
        named.extend(all.map(|dependence| (own.above_floor * dependence.gain, name(own, dependence))));
    }
    let of_nominal = left
        .structured()
        .flat_map(|own| own.leading.iter().map(move |leading| (own, leading)));
    named.sort_by(|a, b| b.0.total_cmp(&a.0));
    let autocorrelation = left.autocorrelation.iter().enumerate();
    let mut depends_on: Vec<String> = Vec::new();
    for (_, name) in named {
        if !depends_on.contains(&name) {
            depends_on.push(name);
        }
    }
    Unexplained {
        fraction: left.fraction(),
        depends_on,
        of_nominal: of_nominal.map(|(own, leading)| name(own, leading)).collect(),
        autocorrelation: autocorrelation
            .map(|(d, value)| (robot.dof(d).name.clone(), *value))
            .collect(),
    }
}
