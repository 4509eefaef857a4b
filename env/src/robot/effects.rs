//! `[[effect]]` tables: which effect, on which joints or links, with which parameters.

use std::ops::Range;

use toml::{Spanned, Value};

use super::Robot;
use super::settings::{EffectEntry, Settings, matches};
use super::source::{RobotError, Source};
use crate::effect::{self, Effect, Info, Kind, Parameter, Place, Site, Table, Variable};

/// Adds the effects of the TOML to the robot.
pub(super) fn add(robot: &mut Robot, settings: &Settings, source: &Source) -> Result<(), RobotError> {
    for entry in &settings.effect {
        let entry = Entry { entry, source };
        let kind = entry.kind()?;
        let (values, table) = if kind == Kind::ResidualTorque {
            (Vec::new(), Some(entry.table()?))
        } else {
            (entry.values(kind.info())?, None)
        };
        for target in entry.targets(robot, kind.info())? {
            let effect = Effect {
                kind,
                target,
                values: values.clone(),
                table: table.clone(),
            };
            effect::apply(robot, &effect);
        }
    }
    Ok(())
}

/// A table with an effect's id, what it is on, and something for its parameters.
pub(super) struct Entry<'a> {
    pub entry: &'a EffectEntry,
    pub source: &'a Source,
}

impl Entry<'_> {
    pub fn error(&self, at: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> RobotError {
        self.source.error(at, message, help)
    }

    pub fn find(&self, key: &str) -> Option<&Spanned<Value>> {
        let own = self.entry.iter().find(|(name, _)| name.get_ref() == key);
        own.map(|(_, value)| value)
    }

    /// Where the table stands: its first key.
    pub fn start(&self) -> Range<usize> {
        let spans = self.entry.keys().map(Spanned::span);
        spans.min_by_key(|span| span.start).unwrap_or(0..0)
    }

    pub fn needed(&self, key: &str, help: &str) -> Result<&Spanned<Value>, RobotError> {
        self.find(key)
            .ok_or_else(|| self.error(self.start(), format!("an effect without `{key}`"), help))
    }

    fn kind(&self) -> Result<Kind, RobotError> {
        let tables = || Kind::ALL.iter().filter(|kind| kind.info().place == Place::Table);
        let known = || tables().map(|kind| kind.id()).collect::<Vec<_>>().join(", ");
        let help = || format!("give one of {}", known());
        let value = self.needed("id", &help())?;
        let id = value.get_ref().as_str().unwrap_or_default();
        match Kind::named(id).map(|kind| (kind, kind.info().place)) {
            Some((kind, Place::Table)) => Ok(kind),
            Some((_, Place::Joint(key))) => {
                let help = format!("write it as {key} = ... in a [[joint]] entry");
                Err(self.error(value.span(), format!("`{id}` is no table of its own"), help))
            }
            None => Err(self.error(value.span(), format!("no effect `{}`", value.get_ref()), help())),
        }
    }

    fn values(&self, info: &Info) -> Result<Vec<f64>, RobotError> {
        let names: Vec<&str> = info.parameters.iter().map(|p| p.name).collect();
        self.check_keys(info.id, &names)?;
        info.parameters.iter().map(|p| self.value(info, p)).collect()
    }

    pub fn check_keys(&self, id: &str, names: &[&str]) -> Result<(), RobotError> {
        let known = |key: &str| key == "id" || key == "match" || names.contains(&key);
        match self.entry.keys().find(|key| !known(key.get_ref())) {
            None => Ok(()),
            Some(key) => Err(self.error(
                key.span(),
                format!("`{id}` has no `{}`", key.get_ref()),
                format!("it has match, {}", names.join(", ")),
            )),
        }
    }

    fn value(&self, info: &Info, parameter: &Parameter) -> Result<f64, RobotError> {
        let unit = parameter.scale.unit(false);
        let help = format!("{}: {}, {unit}", parameter.name, parameter.what);
        let value = match (self.find(parameter.name), parameter.default) {
            (None, Some(default)) => return Ok(default),
            (None, None) => {
                let message = format!("`{}` without `{}`", info.id, parameter.name);
                return Err(self.error(self.start(), message, help));
            }
            (Some(value), _) => value,
        };
        let number = match value.get_ref() {
            Value::Float(x) => *x,
            Value::Integer(x) => *x as f64,
            _ => return Err(self.error(value.span(), "not a number", help)),
        };
        let bounds = parameter.bounds;
        if !(bounds.lower..=bounds.upper).contains(&number) {
            let help = format!("{help}, from {} to {}", bounds.lower, bounds.upper);
            return Err(self.error(value.span(), format!("impossible value {number}"), help));
        }
        Ok(number)
    }

    pub fn targets(&self, robot: &Robot, info: &Info) -> Result<Vec<usize>, RobotError> {
        let (what, names): (_, Vec<&str>) = match info.site {
            Site::Joint => (
                "joint",
                (0..robot.dofs.len()).map(|d| robot.dof(d).name.as_str()).collect(),
            ),
            Site::Link => ("link", robot.links.iter().map(|link| link.name.as_str()).collect()),
        };
        let help = format!("match = [\"...\"], of the {what}s {}", names.join(", "));
        let value = self.needed("match", &help)?;
        let patterns = value.get_ref().as_array().filter(|list| !list.is_empty());
        let patterns = patterns.ok_or_else(|| self.error(value.span(), "not a list of names", help.clone()))?;
        let mut found = Vec::new();
        for pattern in patterns {
            let pattern = pattern.as_str().unwrap_or_default();
            let before = found.len();
            found.extend((0..names.len()).filter(|&i| matches(pattern, names[i])));
            if found.len() == before {
                return Err(self.error(value.span(), format!("no {what} matches `{pattern}`"), help.clone()));
            }
        }
        found.sort_unstable();
        found.dedup();
        Ok(found)
    }

    fn table(&self) -> Result<Table, RobotError> {
        let help = "over = [\"position\"] (position, velocity, target, torque, time; one or two), a grid of each under its name, values, and friction = true where they are dry friction";
        let over = self.needed("over", help)?;
        let wrong = |value: &Spanned<Value>, message: String| self.error(value.span(), message, help);
        let mut names = vec!["over", "values", "friction"];
        let mut axes = Vec::new();
        for name in over.get_ref().as_array().into_iter().flatten() {
            let variable = Variable::ALL.into_iter().find(|v| Some(v.name()) == name.as_str());
            let variable = variable.ok_or_else(|| wrong(over, format!("no variable {name}")))?;
            names.push(variable.name());
            axes.push((variable, self.numbers(self.needed(variable.name(), help)?, help)?));
        }
        self.check_keys(Kind::ResidualTorque.id(), &names)?;
        let values = self.numbers(self.needed("values", help)?, help)?;
        let friction = match self.find("friction") {
            None => false,
            Some(value) => value
                .get_ref()
                .as_bool()
                .ok_or_else(|| wrong(value, "`friction` is true or false".into()))?,
        };
        let table = Table { axes, values, friction };
        match table.fault() {
            None => Ok(table),
            Some(fault) => Err(wrong(over, fault)),
        }
    }

    fn numbers(&self, value: &Spanned<Value>, help: &str) -> Result<Vec<f64>, RobotError> {
        let number = |x: &Value| match x {
            Value::Float(x) => Some(*x),
            Value::Integer(x) => Some(*x as f64),
            _ => None,
        };
        let list = value.get_ref().as_array();
        list.and_then(|list| list.iter().map(number).collect())
            .ok_or_else(|| self.error(value.span(), "not a list of numbers", help))
    }
}
