//! Motions that nobody recorded yet, as logs in which models can be compared: what they would show of an effect, and whether they would
//! tell one from another.

use std::collections::BTreeMap;

use omniwalk_env::robot::Robot;

use super::cut::{self, Lengths};
use super::fit::Data;
use super::own::PAYLOAD;
use super::trial::TrialError;
use crate::excite::{COMMAND_RATE, Motion};
use crate::recording::{JointRecord, Recording, Series};

/// Encoder readings a second.
const READINGS: f64 = 200.0;
/// Share of a motion before the motor is switched off.
const ON: f64 = 2.0 / 3.0;
/// Another gain, as a share of the nominal one.
const GAIN: f64 = 0.5;
/// A weight as a share of the link's mass that it is put on.
const WEIGHT: f64 = 0.5;

/// How a motion is recorded, beside what is commanded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// With the robot as it is.
    Plain,
    /// With the motors off for the last third.
    MotorOff,
    /// At half of the position gain.
    OtherGain,
    /// With a known weight on the last link.
    Loaded,
}

impl Condition {
    /// All of them, the easiest first.
    pub const ALL: [Self; 4] = [Self::Plain, Self::MotorOff, Self::OtherGain, Self::Loaded];

    /// What is done, after the name of the motion.
    pub fn how(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::MotorOff => " with the motors off for its last third",
            Self::OtherGain => " at half of the position gain",
            Self::Loaded => " with a known weight on the last link, half as heavy as that",
        }
    }
}

/// What is commanded in `motion` of `robot`, whose base is held, recorded under `condition`, as a log of readings that nobody made: only
/// differences between models mean something in it, each multiplied with the weight of its degree of freedom.
///
/// # Errors
/// [`TrialError`] when the robot has nothing to command.
pub fn rehearsed(robot: &Robot, motion: &Motion, condition: Condition, weights: Vec<f64>) -> Result<Data, TrialError> {
    let lengths = Lengths {
        block: f64::INFINITY,
        piece: f64::INFINITY,
    };
    let recording = recording(robot, motion, condition);
    let trials = cut::cut(robot, &recording, 0, (0.0, f64::INFINITY), lengths)?;
    Ok(Data {
        weights,
        ..Data::new(robot, trials)?
    })
}

/// How many readings of `data` have a weight.
pub fn weighed(data: &Data) -> f64 {
    let readings = data.trials.iter().flat_map(|trial| &trial.readings);
    readings.filter(|reading| data.weights[reading.dof] > 0.0).count() as f64
}

/// The log that `motion` under `condition` would make of joints that follow as they are told.
fn recording(robot: &Robot, motion: &Motion, condition: Condition) -> Recording {
    let seconds = (motion.targets.len() - 1) as f64 / COMMAND_RATE;
    let joint = |d: usize| {
        let place = robot.policy.iter().position(|&own| own == d);
        let target = |step: usize| place.map_or(robot.dof(d).nominal, |own| motion.targets[step][own]);
        let command = sampled(seconds, COMMAND_RATE, target);
        let position = sampled(seconds, READINGS, |k| {
            target((k as f64 * COMMAND_RATE / READINGS) as usize)
        });
        JointRecord {
            name: robot.dof(d).name.clone(),
            command,
            position,
            enabled: match condition {
                Condition::MotorOff => Series {
                    time: vec![ON * seconds],
                    value: vec![0.0],
                },
                _ => Series::default(),
            },
            ..JointRecord::default()
        }
    };
    Recording {
        name: motion.name.clone(),
        joints: (0..robot.dofs.len()).map(joint).collect(),
        overrides: overrides(robot, condition),
        ..Recording::default()
    }
}

fn overrides(robot: &Robot, condition: Condition) -> BTreeMap<String, f64> {
    let gain = |d: usize| {
        let joint = robot.dof(d);
        Some((format!("joint.{}.kp", joint.name), GAIN * joint.actuator?.kp))
    };
    match condition {
        Condition::Plain | Condition::MotorOff => BTreeMap::new(),
        Condition::OtherGain => (0..robot.dofs.len()).filter_map(gain).collect(),
        Condition::Loaded => {
            let mass = robot.links.last().map_or(0.0, |link| link.inertial.mass);
            BTreeMap::from([(PAYLOAD.to_owned(), WEIGHT * mass)])
        }
    }
}

/// `value` of every sample of so many `seconds` at `rate`.
fn sampled(seconds: f64, rate: f64, value: impl Fn(usize) -> f64) -> Series {
    let count = (seconds * rate).round() as usize;
    Series {
        time: (0..=count).map(|k| k as f64 / rate).collect(),
        value: (0..=count).map(value).collect(),
    }
}
