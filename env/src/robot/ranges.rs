//! `[[range]]` tables: what is known of an effect's values only to lie within bounds, as identification writes it.

use toml::Value;

use super::Robot;
use super::effects::Entry;
use super::settings::Settings;
use super::source::{RobotError, Source};
use crate::effect::{self, Effect, Info, Kind, Parameter};
use crate::random::Stream;

/// Bounds of a value of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectRange {
    /// Which effect.
    pub kind: Kind,
    /// Degree of freedom.
    pub target: usize,
    /// Index of the parameter among the effect's.
    pub parameter: usize,
    /// Smallest value, in the parameter's unit.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
}

/// Adds the ranges of the TOML to the robot, whose effects are known.
pub(super) fn add(robot: &mut Robot, settings: &Settings, source: &Source) -> Result<(), RobotError> {
    for entry in &settings.range {
        let entry = Entry { entry, source };
        let kind = kind(&entry)?;
        let info = kind.info();
        let names: Vec<&str> = info.parameters.iter().map(|p| p.name).collect();
        entry.check_keys(info.id, &names)?;
        for target in entry.targets(robot, info)? {
            if values(robot, kind, target).is_none() {
                let message = format!("`{}` has no `{}`", robot.dof(target).name, info.id);
                let help = "give the joint the effect too, with the value it has without randomisation";
                return Err(entry.error(entry.start(), message, help));
            }
            for (parameter, own) in info.parameters.iter().enumerate() {
                if let Some((lower, upper)) = bounds(&entry, info, own)? {
                    robot.ranges.push(EffectRange {
                        kind,
                        target,
                        parameter,
                        lower,
                        upper,
                    });
                }
            }
        }
    }
    Ok(())
}

/// Effects whose values can differ from environment to environment: the actuators have them, not the engine's model of the body.
pub fn can_vary(kind: Kind) -> bool {
    let of_actuator = [Kind::CoulombFriction, Kind::TorqueLimit, Kind::SpeedTorqueCurve];
    kind.runs() && kind != Kind::ResidualTorque || of_actuator.contains(&kind)
}

fn kind(entry: &Entry<'_>) -> Result<Kind, RobotError> {
    let known: Vec<&str> = Kind::ALL
        .iter()
        .filter(|kind| can_vary(**kind))
        .map(|kind| kind.id())
        .collect();
    let help = format!("give one of {}", known.join(", "));
    let value = entry.needed("id", &help)?;
    let id = value.get_ref().as_str().unwrap_or_default();
    Kind::named(id)
        .filter(|&kind| can_vary(kind))
        .ok_or_else(|| entry.error(value.span(), format!("no range for {}", value.get_ref()), help))
}

fn bounds(entry: &Entry<'_>, info: &Info, parameter: &Parameter) -> Result<Option<(f64, f64)>, RobotError> {
    let Some(value) = entry.find(parameter.name) else {
        return Ok(None);
    };
    let (lowest, highest) = (parameter.bounds.lower, parameter.bounds.upper);
    let help = format!("{} = [smallest, largest], from {lowest} to {highest}", parameter.name);
    let number = |value: &Value| match value {
        Value::Float(x) => Some(*x),
        Value::Integer(x) => Some(*x as f64),
        _ => None,
    };
    let list = value.get_ref().as_array().map(Vec::as_slice).unwrap_or_default();
    let numbers: Vec<f64> = list.iter().filter_map(number).collect();
    match numbers[..] {
        [lower, upper] if list.len() == 2 && lowest <= lower && lower <= upper && upper <= highest => {
            Ok(Some((lower, upper)))
        }
        _ => Err(entry.error(value.span(), format!("no range of `{}`'s values", info.id), help)),
    }
}

/// The values of an effect that the robot has.
fn values(robot: &Robot, kind: Kind, target: usize) -> Option<Vec<f64>> {
    let joint = robot.dof(target);
    match kind {
        Kind::CoulombFriction => Some(vec![joint.passive.friction]),
        Kind::TorqueLimit => joint.actuator.map(|a| vec![a.torque_limit]),
        Kind::SpeedTorqueCurve => joint.actuator.map(|a| vec![a.speed_limit]),
        _ => {
            let own = |effect: &&Effect| (effect.kind, effect.target) == (kind, target);
            robot.effects.iter().find(own).map(|effect| effect.values.clone())
        }
    }
}

impl Robot {
    /// The robot with every value that it gives a range for drawn from `stream`.
    pub fn drawn(&self, stream: &mut Stream) -> Self {
        let mut robot = self.clone();
        for range in &self.ranges {
            let value = stream.uniform(range.lower, range.upper);
            if let Some(mut values) = values(&robot, range.kind, range.target) {
                values[range.parameter] = value;
                effect::apply(&mut robot, &Effect::new(range.kind, range.target, &values));
            }
        }
        robot
    }
}
