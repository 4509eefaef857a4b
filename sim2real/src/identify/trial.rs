//! A piece of a log made ready for rollouts: commands by the millisecond, readings to compare with, and where it starts.

use std::collections::BTreeMap;
use std::sync::Arc;

use omniwalk_env::robot::{Limb, Robot};

use super::base::MeasuredBase;
use super::motion::Motion;
use super::own::{self, Logged};
use super::starts::Starts;
use crate::recording::{Jump, overrides};

/// Physics step of rollouts, s.
pub const DT: f64 = 1e-3;
/// Longest delay whose past is known at the start of a rollout, s: it begins this late in the log.
pub const LEAD: f64 = 0.15;

/// Why a log cannot be compared with a robot.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum TrialError {
    /// The log is of another robot.
    #[error("log {log}: none of its joints ({found}) is a joint of robot `{robot}`")]
    #[diagnostic(help("name the joints as the URDF does ({wanted}), in the log or in the column map"))]
    OtherRobot {
        /// The log.
        log: String,
        /// Its joints.
        found: String,
        /// The robot.
        robot: String,
        /// The robot's joints.
        wanted: String,
    },
    /// The log lacks a joint that moves.
    #[error("log {log}: joint `{joint}` has no {what}")]
    #[diagnostic(help("record it, or name the joint under `locked` in the robot's TOML"))]
    Missing {
        /// The log.
        log: String,
        /// The joint.
        joint: String,
        /// What is missing.
        what: &'static str,
    },
    /// The robot walks freely, and nothing says how its base was.
    #[error("log {log}: robot `{robot}` has a floating base, and the log does not say how it is oriented")]
    #[diagnostic(help("record /imu with its orientation, or /odom; give --stand where the robot hung on a stand"))]
    NoBase {
        /// The log.
        log: String,
        /// The robot.
        robot: String,
    },
    /// The robot walks freely, and has no feet.
    #[error("robot `{robot}` has a floating base and no feet: what it stands on is not known")]
    #[diagnostic(help("name its feet in the robot's TOML; give --stand where it hung on a stand"))]
    NoFeet {
        /// The robot.
        robot: String,
    },
    /// The log's clock was set while it was recorded, or logs were joined.
    #[error("log {log}: joint `{joint}`: {jump}")]
    #[diagnostic(help("{}", Jump::HELP))]
    Jump {
        /// The log.
        log: String,
        /// The joint.
        joint: String,
        /// Where.
        jump: Jump,
    },
    /// The log overrides something the robot does not have.
    #[error("log {log}: no parameter `{key}` to override")]
    #[diagnostic(help("{}", overrides::keys()))]
    Override {
        /// The log.
        log: String,
        /// The key.
        key: String,
    },
    /// The log overrides a parameter of a joint that the robot does not have.
    #[error("log {log}: no joint `{joint}` whose parameter `{key}` would override")]
    #[diagnostic(help("the robot's joints are {joints}"))]
    OverrideJoint {
        /// The log.
        log: String,
        /// The key.
        key: String,
        /// The joint.
        joint: String,
        /// The robot's joints.
        joints: String,
    },
    /// The log overrides something by a value that it cannot have.
    #[error("log {log}: override `{key}` cannot be {value}")]
    #[diagnostic(help("{right}"))]
    Value {
        /// The log.
        log: String,
        /// The key.
        key: String,
        /// The value.
        value: f64,
        /// What would be right.
        right: String,
    },
}

/// A reading of a joint.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Time in steps from the trial's start.
    pub at: f64,
    /// Degree of freedom.
    pub dof: usize,
    /// Measured position, rad or m.
    pub position: f64,
    /// Which block of time it belongs to, counted from the start of what is used of its log.
    pub block: usize,
}

/// Commands, of which each holds until the next: targets (rad, m) or efforts (N m, N).
#[derive(Clone, Debug)]
pub struct Commands {
    /// Their mean over every step.
    pub mean: Vec<f64>,
    /// When each was given, in steps from the trial's start, and which; the first is that which held at the start.
    pub given: Vec<(f64, f64)>,
}

impl Commands {
    /// Whether another is given within a step.
    pub fn switches_within(&self, step: usize) -> bool {
        let next = self.given.partition_point(|(at, _)| *at <= step as f64);
        self.given.get(next).is_some_and(|(at, _)| *at < (step + 1) as f64)
    }

    /// Their mean over part `part` of `parts` of a step: what switches within acts in proportion.
    pub fn over(&self, step: usize, part: usize, parts: usize) -> f64 {
        if parts == 1 {
            return self.mean[step];
        }
        let length = 1.0 / parts as f64;
        let (mut from, end) = (
            step as f64 + part as f64 * length,
            step as f64 + (part + 1) as f64 * length,
        );
        let next = self.given.partition_point(|(at, _)| *at <= from);
        let mut value = self.given[next.saturating_sub(1)].1;
        let mut sum = 0.0;
        for &(at, new) in self.given[next..].iter().take_while(|(at, _)| *at < end) {
            sum += value * (at - from);
            (from, value) = (at, new);
        }
        (sum + value * (end - from)) / length
    }
}

/// What a joint is told.
#[derive(Clone, Debug)]
pub struct Told {
    /// Its commands.
    pub command: Commands,
    /// The same were they given at other moments that the log allows as well; none where it says when.
    pub otherwise: Option<Commands>,
    /// Whether commands are efforts.
    pub effort: bool,
    /// Whether the motor is on, at every step.
    pub enabled: Vec<bool>,
    /// The command of the steps before the first, the last of them first.
    pub past: Vec<f64>,
}

/// A piece of a log.
#[derive(Clone, Debug, Default)]
pub struct Trial {
    /// The log's name.
    pub name: String,
    /// Which log it is a piece of.
    pub log: usize,
    /// The robot's parameters that are different in this log.
    pub overrides: BTreeMap<String, f64>,
    /// Time of its start in the log, s.
    pub start: f64,
    /// Physics steps.
    pub steps: usize,
    /// One a degree of freedom.
    pub told: Vec<Told>,
    /// In the order of time; readings that are compared.
    pub readings: Vec<Reading>,
    /// Positions and velocities of the degrees of freedom as measured, at every step from 0.15 s before the start
    /// ([`Trial::begin`] steps) until 0.15 s after it: a reading that is late shows the start that much later, and a joint that
    /// is slow to follow is on its way since before.
    pub initial: Vec<Vec<(f64, f64)>>,
    /// The base at the start, where it is not held.
    pub base: Option<MeasuredBase>,
    /// What the noise of the readings about the start makes of the position (in units of it) and of the velocity (a second) of each
    /// degree of freedom there.
    pub spread: Vec<(f64, f64)>,
    /// By how much rollouts start off the measured state, as `starts` has it; empty where the base is held.
    pub shift: Vec<f64>,
    /// What the start can explain, where the base is not held.
    pub starts: Option<Arc<Starts>>,
    /// Measured position at every step, linear between readings.
    pub measured: Vec<Vec<f64>>,
    /// What else was measured of the motion.
    pub motion: Arc<Motion>,
    /// What else was measured, by name, at every step; of the joint it was measured at, or of all.
    pub conditions: Vec<(Option<usize>, String, Vec<f64>)>,
}

impl Trial {
    /// Index of the start in `initial`.
    pub fn begin(&self) -> usize {
        steps(LEAD)
    }

    /// Time of a reading in the log, s.
    pub fn time(&self, reading: &Reading) -> f64 {
        self.start + reading.at * DT
    }

    /// What it holds of a limb of `robot`, whose base is held.
    pub fn of_limb(&self, robot: &Robot, limb: &Limb) -> Self {
        let own = |dof: usize| limb.dofs.iter().position(|&other| other == dof);
        let reading = |r: &Reading| own(r.dof).map(|dof| Reading { dof, ..*r });
        let condition = |(joint, name, values): &(Option<usize>, String, Vec<f64>)| match joint {
            None => Some((None, name.clone(), values.clone())),
            Some(dof) => Some((Some(own(*dof)?), name.clone(), values.clone())),
        };
        Self {
            overrides: of_limb(&self.overrides, robot, limb),
            told: picked(&self.told, limb),
            readings: self.readings.iter().filter_map(reading).collect(),
            initial: picked(&self.initial, limb),
            spread: picked(&self.spread, limb),
            measured: picked(&self.measured, limb),
            conditions: self.conditions.iter().filter_map(condition).collect(),
            // Of the whole robot, which is what errors are reported of.
            motion: Arc::default(),
            ..self.clone()
        }
    }

    /// `robot` as it was in this log.
    ///
    /// # Errors
    /// [`TrialError::Override`] or [`TrialError::OverrideJoint`] for an override that names nothing, [`TrialError::Value`] for one that cannot
    /// be.
    pub fn robot(&self, robot: &Robot) -> Result<Logged, TrialError> {
        let log = self.name.clone();
        Logged::new(robot, &self.overrides).map_err(|(key, value, refused)| match refused {
            own::Refused::Unknown => unknown(log, key, robot),
            own::Refused::Value(right) => TrialError::Value { log, key, value, right },
        })
    }
}

/// That `key` names nothing of `robot` to override.
fn unknown(log: String, key: String, robot: &Robot) -> TrialError {
    let names: Vec<&str> = (0..robot.dofs.len()).map(|d| robot.dof(d).name.as_str()).collect();
    let joint = overrides::parts(&key)
        .0
        .filter(|joint| overrides::exists(&key) && !names.contains(joint));
    match joint.map(str::to_owned) {
        Some(joint) => TrialError::OverrideJoint {
            log,
            key,
            joint,
            joints: names.join(", "),
        },
        None => TrialError::Override { log, key },
    }
}

/// Those of values, one a degree of freedom, that are a limb's.
fn picked<T: Clone>(values: &[T], limb: &Limb) -> Vec<T> {
    limb.dofs.iter().map(|&dof| values[dof].clone()).collect()
}

/// Those of a log's overrides that concern a limb.
fn of_limb(overrides: &BTreeMap<String, f64>, robot: &Robot, limb: &Limb) -> BTreeMap<String, f64> {
    let carries = limb.links.last() == Some(&(robot.links.len() - 1));
    let concerns = |key: &str| match overrides::parts(key).0 {
        Some(name) => limb.robot.joints.iter().any(|joint| joint.name == name),
        // What is carried is on the last link.
        None => key != own::PAYLOAD || carries,
    };
    let own = overrides.iter().filter(|(key, _)| concerns(key));
    own.map(|(key, value)| (key.clone(), *value)).collect()
}

/// Steps in a time, s.
pub fn steps(time: f64) -> usize {
    (time / DT).round() as usize
}
