//! Columns of a log: how their numbers become SI values, and which of them are a joint's.

use std::collections::BTreeMap;
use std::ops::Range;

use omniwalk_env::robot::{RobotError, Source};
use serde::Deserialize;
use toml::Spanned;

use super::CommandKind;
use super::units::{Dimension, fitting, unit};

/// Longest name of a joint's column, bytes.
const MAX_NAME: usize = 1000;
/// Largest magnitude of a scale or offset.
const MAX_VALUE: f64 = 1e12;

fn one() -> f64 {
    1.0
}

/// A column and how its numbers become SI values.
#[derive(Clone, Debug, Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a table of a column, such as { column = \"q\", unit = \"rad\" }"
)]
pub(super) struct Column {
    pub column: String,
    pub unit: Option<String>,
    #[serde(default = "one")]
    pub scale: f64,
    #[serde(default)]
    pub offset: f64,
    pub signed_bits: Option<u32>,
}

/// The columns of some joints.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JointColumns {
    pub names: Vec<String>,
    pub command: Option<Spanned<Column>>,
    pub position: Option<Spanned<Column>>,
    pub velocity: Option<Spanned<Column>>,
    pub effort: Option<Spanned<Column>>,
    pub enabled: Option<Spanned<Column>>,
    #[serde(default)]
    pub extra: BTreeMap<String, Spanned<Column>>,
}

impl Column {
    /// The column's name for a joint.
    pub fn of(&self, joint: &str) -> String {
        self.column.replace("{joint}", joint)
    }

    /// The SI value of a raw number.
    pub fn value(&self, raw: f64) -> f64 {
        let wrapped = match self.signed_bits {
            Some(bits) if raw >= 2_f64.powi(bits as i32 - 1) => raw - 2_f64.powi(bits as i32),
            _ => raw,
        };
        let unit = self.unit.as_deref().and_then(unit);
        (wrapped * self.scale + self.offset) * unit.map_or(1.0, |(_, factor)| factor)
    }

    /// What a command in this column says.
    pub fn command_kind(&self) -> CommandKind {
        match self.unit.as_deref().and_then(unit) {
            Some((Dimension::Effort, _)) => CommandKind::Effort,
            _ => CommandKind::Position,
        }
    }

    /// Whether it can be read, and is in a unit of one of `right`.
    pub fn check(&self, source: &Source, span: Range<usize>, right: &[Dimension]) -> Result<(), RobotError> {
        for (value, key) in [(self.scale, "scale"), (self.offset, "offset")] {
            if value.is_nan() || value.abs() > MAX_VALUE || (key == "scale" && value == 0.0) {
                let message = format!("{key} {value} of column `{}`", self.column);
                return Err(source.error(span, message, "use a finite number; a scale is not zero"));
            }
        }
        if self.signed_bits.is_some_and(|bits| !(2..=52).contains(&bits)) {
            return Err(source.error(span, "signed_bits is the width of a count", "use 2 to 52, such as 16"));
        }
        let Some(name) = &self.unit else { return Ok(()) };
        if unit(name).is_some_and(|(dimension, _)| right.contains(&dimension)) {
            return Ok(());
        }
        let message = format!("`{name}` is no unit for column `{}`", self.column);
        let help = format!("use {}, and `scale` for what is missing", fitting(right));
        Err(source.error(span, message, help))
    }
}

impl JointColumns {
    /// The columns that are measured or told, with what they can measure.
    fn columns(&self) -> impl Iterator<Item = (&Spanned<Column>, &'static [Dimension])> {
        const COMMAND: &[Dimension] = &[Dimension::Position, Dimension::Effort];
        let of = |column, right| Option::map(column, move |column| (column, right));
        [
            of(self.command.as_ref(), COMMAND),
            of(self.position.as_ref(), &[Dimension::Position][..]),
            of(self.velocity.as_ref(), &[Dimension::Velocity][..]),
            of(self.effort.as_ref(), &[Dimension::Effort][..]),
        ]
        .into_iter()
        .flatten()
    }

    /// Whether the motor is on, and what else there is of a joint: these may be true or false.
    fn others(&self) -> impl Iterator<Item = &Spanned<Column>> {
        self.enabled.iter().chain(self.extra.values())
    }

    /// Columns of all its joints, one at least for each.
    pub fn count(&self) -> usize {
        let each = self.columns().count() + self.others().count();
        self.names.len().saturating_mul(each.max(1))
    }

    /// The names of all its columns.
    pub fn all_names(&self) -> Vec<String> {
        let columns: Vec<_> = self.columns().map(|(column, _)| column).chain(self.others()).collect();
        self.names_of(&columns)
    }

    /// The names of those that may hold true or false.
    pub fn truth_names(&self) -> Vec<String> {
        self.names_of(&self.others().collect::<Vec<_>>())
    }

    fn names_of(&self, columns: &[&Spanned<Column>]) -> Vec<String> {
        let of_joint = |name: &String| {
            columns
                .iter()
                .map(|column| column.get_ref().of(name))
                .collect::<Vec<_>>()
        };
        self.names.iter().flat_map(of_joint).collect()
    }

    /// Whether the columns can be read; `seen` are the joints of the entries before.
    pub fn check(&self, source: &Source, span: Range<usize>, seen: &mut Vec<String>) -> Result<(), RobotError> {
        for name in &self.names {
            if seen.contains(name) {
                let message = format!("joint `{name}` is named twice");
                return Err(source.error(span, message, "give each joint one entry"));
            }
            seen.push(name.clone());
        }
        let fault = if self.names.is_empty() {
            Some("a joint entry without names".to_owned())
        } else {
            let of_all = |column: &&Column| !column.column.contains("{joint}");
            let shared = self.columns().map(|(column, _)| column.get_ref()).find(of_all);
            shared.filter(|_| self.names.len() > 1).map(|column| {
                format!(
                    "column `{}` would be that of {} joints",
                    column.column,
                    self.names.len()
                )
            })
        };
        if let Some(message) = fault {
            let help = "name joints, and put `{joint}` where their names are in column names";
            return Err(source.error(span, message, help));
        }
        let longest = self.names.iter().map(String::len).max().unwrap_or(0);
        for column in self.columns().map(|(column, _)| column).chain(self.others()) {
            let name = &column.get_ref().column;
            let bytes = name.len() + name.matches("{joint}").count() * longest;
            if bytes > MAX_NAME {
                let message = format!("a column's name would have {bytes} bytes");
                return Err(source.error(column.span(), message, format!("use at most {MAX_NAME}")));
            }
        }
        for (column, right) in self.columns() {
            column.get_ref().check(source, column.span(), right)?;
        }
        for column in self.others() {
            let any = [
                Dimension::Position,
                Dimension::Velocity,
                Dimension::Effort,
                Dimension::Voltage,
            ];
            column.get_ref().check(source, column.span(), &any)?;
        }
        Ok(())
    }
}
