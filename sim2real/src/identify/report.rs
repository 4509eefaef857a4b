//! What `report.json` holds, beside what only the page shows.

use std::collections::BTreeMap;
use std::fmt;

use omniwalk_env::robot::Robot;
use serde::Serialize;

use super::information::Information;
use super::measure::Measure;
use super::separate::Separation;
use super::trial::Trial;
use crate::check::Check;

/// What the logs say about the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Effects were missing and were found.
    Explained,
    /// Nothing is missing beyond other values of what the model has.
    NoMissingEffect,
    /// Something is missing that several effects explain equally well.
    Indistinguishable,
    /// Something is missing that is no effect of the library.
    Unexplained,
    /// The logs cannot carry an answer.
    InsufficientData,
}

/// A fitted number.
#[derive(Clone, Debug, Serialize)]
pub struct Parameter {
    /// Its value, SI units.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// 95 % interval; none where the logs cannot tell.
    pub ci95: Option<[f64; 2]>,
}

impl fmt::Display for Parameter {
    /// With as many digits as the interval's width has meaning, two of it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = self.ci95.map_or(0.01 * self.value.abs(), |[low, high]| high - low);
        let digits = if known > 0.0 {
            (1.0 - known.log10().floor()).clamp(0.0, 12.0)
        } else {
            0.0
        } as usize;
        write!(f, "{:.digits$}", self.value)?;
        if self.unit != "1" {
            write!(f, " {}", self.unit)?;
        }
        match self.ci95 {
            Some([low, high]) => write!(f, " ({low:.digits$} to {high:.digits$})"),
            None => Ok(()),
        }
    }
}

/// An effect that was taken.
#[derive(Clone, Debug, Serialize)]
pub struct Accepted {
    /// Its id.
    pub effect: &'static str,
    /// Joint or link.
    pub target: String,
    /// By name.
    pub parameters: BTreeMap<&'static str, Parameter>,
    /// Error on held-out logs of the model without it, the rest fitted again, rad or m.
    pub heldout_rmse_before: f64,
    /// The same with it.
    pub heldout_rmse_after: f64,
    /// Probability of its gain by chance, corrected for the number of effects tried.
    pub p_value: f64,
}

/// One of several effects that the logs cannot tell apart.
#[derive(Clone, Debug, Serialize)]
pub struct Alternative {
    /// Its id.
    pub effect: &'static str,
    /// Joint or link.
    pub target: String,
    /// What it would be, by name; with intervals where it is in the robot.
    pub parameters: BTreeMap<&'static str, Parameter>,
    /// Whether it is the one that was put into the robot.
    pub in_robot: bool,
}

/// An effect that was not taken.
#[derive(Clone, Debug, Serialize)]
pub struct Rejected {
    /// Its id.
    pub effect: &'static str,
    /// Joint or link.
    pub target: String,
    /// Why not.
    pub reason: String,
}

/// Errors on both sets of logs.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Sets {
    /// Logs that were fitted.
    pub fit: Measure,
    /// Logs that were held out.
    pub heldout: Measure,
}

/// What no model gets below.
#[derive(Clone, Debug, Serialize)]
pub struct NoiseFloor {
    /// rad or m.
    pub value: Option<f64>,
    /// `repeats`, `sensor` or `none`.
    pub source: &'static str,
}

/// How near the last model is to what no model gets below, at one joint.
#[derive(Clone, Debug, Serialize)]
pub struct JointGap {
    /// rad or m.
    pub noise_floor: f64,
    /// Share of the re-tuned model's held-out error above the floor that is gone.
    pub gap_closed: Option<f64>,
}

/// A measured table that stands in the robot for what no effect explains.
#[derive(Clone, Debug, Serialize)]
pub struct MeasuredTable {
    /// The joint.
    pub joint: String,
    /// What it is over.
    pub over: &'static str,
    /// Whether it is a dry friction, against the motion, or a torque.
    pub friction: bool,
    /// Its points: rad or m, rad/s or m/s, N m or N, by what it is over.
    pub grid: Vec<f64>,
    /// N m or N at each.
    pub values: Vec<f64>,
}

impl fmt::Display for MeasuredTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = if self.friction { "dry friction" } else { "torque" };
        write!(
            f,
            "a measured table of {what} over {} at {} points, on {}",
            self.over,
            self.grid.len(),
            self.joint
        )
    }
}

/// What is left.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Unexplained {
    /// Share of the last model's mean square that noise does not explain.
    pub fraction: f64,
    /// What it depends on, in order.
    pub depends_on: Vec<String>,
    /// Those of them that predict what the nominal robot lacks: where re-tuning makes up for most of that, what it leaves may go with nothing.
    pub of_nominal: Vec<String>,
    /// Autocorrelation of the residual over 0.1 s, by joint.
    pub autocorrelation: BTreeMap<String, f64>,
}

/// Everything.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// The robot.
    pub robot: String,
    /// The answer.
    pub verdict: Verdict,
    /// Why there is none, if so.
    pub reasons: Vec<String>,
    /// What the logs can carry, looked at before anything else.
    pub check: Check,
    /// What they can tell of the nominal model's parameters, about their re-tuned values.
    pub information: Vec<Information>,
    /// The robot as given.
    pub nominal: Sets,
    /// Its own parameters re-tuned.
    pub refit: Sets,
    /// The robot that was written, read again.
    #[serde(rename = "final")]
    pub last: Sets,
    /// Every effect of the catalogue fitted at once, where that was asked for: what is compared with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub all_effects: Option<Sets>,
    /// What no model gets below.
    pub noise_floor: NoiseFloor,
    /// Share of the re-tuned model's held-out error above the floor that is gone.
    pub gap_closed: Option<f64>,
    /// The same of each joint.
    pub by_joint: BTreeMap<String, JointGap>,
    /// Effects taken.
    pub accepted: Vec<Accepted>,
    /// Effects tried and not taken.
    pub rejected: Vec<Rejected>,
    /// Sets of effects that these logs cannot tell apart.
    pub indistinguishable: Vec<Vec<String>>,
    /// What each of those effects would be; not of sets with numbers that were re-tuned.
    pub alternatives: Vec<Vec<Alternative>>,
    /// What would tell those apart, pair by pair.
    pub separation: Vec<Separation>,
    /// What is left.
    pub unexplained: Unexplained,
    /// Measured tables in the robot that was written.
    pub tables: Vec<MeasuredTable>,
    /// Re-tuned parameters of the nominal model as they were written, by joint and key; beside a table without intervals.
    pub retuned: BTreeMap<String, BTreeMap<String, Parameter>>,
    /// Which logs were held out.
    pub heldout: String,
    /// What the folds of the cross-validation are.
    pub folds: String,
    /// Effects tried in a step.
    pub tried: usize,
    /// Physics steps a second of the rollouts.
    pub physics_hz: f64,
    /// Pieces of the logs that were fitted, then of those held out.
    #[serde(skip)]
    pub trials: [Vec<Trial>; 2],
    /// What the last model lacks, of every joint, before tables.
    pub lacking: Vec<super::Lacking>,
    /// Why no held-out log could be compared, if so.
    #[serde(skip)]
    pub heldout_error: Option<String>,
}

impl Outcome {
    /// No answer, for `reasons`.
    pub fn insufficient(robot: &Robot, reasons: Vec<String>, check: Check) -> Self {
        Self {
            robot: robot.name.clone(),
            verdict: Verdict::InsufficientData,
            reasons,
            check,
            information: Vec::new(),
            nominal: Sets::default(),
            refit: Sets::default(),
            last: Sets::default(),
            all_effects: None,
            noise_floor: NoiseFloor {
                value: None,
                source: "none",
            },
            gap_closed: None,
            by_joint: BTreeMap::new(),
            accepted: Vec::new(),
            rejected: Vec::new(),
            indistinguishable: Vec::new(),
            alternatives: Vec::new(),
            separation: Vec::new(),
            unexplained: Unexplained::default(),
            tables: Vec::new(),
            retuned: BTreeMap::new(),
            heldout: String::new(),
            folds: String::new(),
            tried: 0,
            physics_hz: 1.0 / super::DT,
            trials: [Vec::new(), Vec::new()],
            lacking: Vec::new(),
            heldout_error: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_are_known() {
        let said = |value, ci95| {
            Parameter {
                value,
                unit: "rad",
                ci95,
            }
            .to_string()
        };
        assert_eq!(
            said(6.12e-5, Some([4.4e-5, 7.83e-5])),
            "0.000061 rad (0.000044 to 0.000078)"
        );
        assert_eq!(said(1234.5, Some([1200.0, 1269.0])), "1234 rad (1200 to 1269)");
        assert_eq!(said(0.25, None), "0.2500 rad");
        assert_eq!(said(0.0, None), "0 rad");
    }
}
