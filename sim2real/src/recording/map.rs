//! The column map: what the columns of a log mean that is no MCAP file, and what is special about a log.
//!
//! ```toml
//! format = "json"                        # csv, json or mcap; default: by the file name's ending
//! rows = "entries"                       # JSON: the list of rows; without it columns are lists of their own
//! separator = ";"                        # CSV; default: a comma
//! header = false                         # CSV without a row of names: columns are called 1, 2, ...
//! time = { column = "timestamp", unit = "ms" }
//! segment = "run"                        # rows with one value here are a recording of their own
//! voltage = { column = "input_volts" }   # of the supply
//!
//! [groups]                               # labels: a constant, a field of the file's header, or a column
//! trajectory = { field = "trajectory" }
//! stand = "left"
//!
//! [overrides]                            # parameters of the robot: a number, a field of the header, or a column
//! kp = { field = "kp", scale = 0.01 }
//! "payload.mass" = 0.49
//!
//! [[joint]]
//! names = ["hinge"]                      # `{joint}` in a column stands for each of them
//! command = { column = "goal", unit = "deg" }
//! position = { column = "{joint}.position", scale = 0.0879, offset = -180.0, unit = "deg" }
//! velocity = { column = "speed", unit = "rpm" }
//! effort = { column = "torque", unit = "N m" }
//! enabled = { column = "torque_enable" } # the motor is off where this is 0
//! extra = { load = { column = "load", signed_bits = 16 } }
//! ```
//!
//! A value is `(raw * scale + offset)` in `unit`. Units: `rad`, `deg`, `rev`, `m`, `mm` for positions; these `/s`, and
//! `rpm`, for velocities; `N m`, `mN m`, `kgf cm`, `N`, `mN` for efforts; `V`, `mV` for voltages; `s`, `ms`, `us`, `ns` for time. A
//! command in a unit of effort is an effort command. `signed_bits` reads a count that wrapped: 65535 as -1 for 16.
//!
//! In CSV the header's fields are comment lines `# key: value` above the names; in JSON whatever is no row (by dotted
//! key); in MCAP the metadata (`record.key`). In JSON a column can be a dotted path into a row: `joints.0.position`.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use omniwalk_env::robot::{RobotError, Source};
use serde::Deserialize;
use toml::Spanned;

use super::CommandKind;

/// Columns that a map may name, each `{joint}` for every joint: a hundred of each of forty joints.
const MAX_COLUMNS: usize = 4096;
/// Largest magnitude of a scale or offset.
const MAX_VALUE: f64 = 1e12;

/// A column map.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Map {
    pub(super) format: Option<Format>,
    pub(super) rows: Option<String>,
    #[serde(default = "comma")]
    pub(super) separator: char,
    #[serde(default = "yes")]
    pub(super) header: bool,
    pub(super) time: Option<Spanned<Column>>,
    pub(super) segment: Option<String>,
    pub(super) voltage: Option<Spanned<Column>>,
    #[serde(default)]
    pub(super) groups: BTreeMap<String, Label>,
    #[serde(default)]
    pub(super) overrides: BTreeMap<String, Spanned<Number>>,
    #[serde(default)]
    pub(super) joint: Vec<Spanned<JointColumns>>,
}

fn comma() -> char {
    ','
}

fn yes() -> bool {
    true
}

fn one() -> f64 {
    1.0
}

/// Kinds of files a map can be for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Format {
    Csv,
    Json,
    Mcap,
}

/// A column and how its numbers become SI values.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Column {
    pub column: String,
    pub unit: Option<String>,
    #[serde(default = "one")]
    pub scale: f64,
    #[serde(default)]
    pub offset: f64,
    pub signed_bits: Option<u32>,
}

/// Where a label comes from.
#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "a label is a text, { field = \"...\" } or { column = \"...\" }"
)]
pub(super) enum Label {
    Constant(String),
    From(Origin),
}

/// Where a number comes from.
#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "an override is a number, { field = \"...\" } or { column = \"...\" }, the latter two perhaps with scale and offset"
)]
pub(super) enum Number {
    Constant(f64),
    From(Scaled),
}

/// A field of the file's header, or a column that is the same in all rows.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Origin {
    Field(String),
    Column(String),
}

/// A number from a file, scaled.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Scaled {
    pub field: Option<String>,
    pub column: Option<String>,
    #[serde(default = "one")]
    pub scale: f64,
    #[serde(default)]
    pub offset: f64,
}

/// The columns of some joints.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JointColumns {
    pub names: Vec<String>,
    pub command: Option<Column>,
    pub position: Option<Column>,
    pub velocity: Option<Column>,
    pub effort: Option<Column>,
    pub enabled: Option<Column>,
    #[serde(default)]
    pub extra: BTreeMap<String, Column>,
}

/// What a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dimension {
    Time,
    Position,
    Velocity,
    Effort,
    Voltage,
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;
const REVOLUTION: f64 = std::f64::consts::TAU;

/// Name, what it measures, and its value in SI units.
const UNITS: [(&str, Dimension, f64); 25] = [
    ("s", Dimension::Time, 1.0),
    ("ms", Dimension::Time, 1e-3),
    ("us", Dimension::Time, 1e-6),
    ("ns", Dimension::Time, 1e-9),
    ("rad", Dimension::Position, 1.0),
    ("deg", Dimension::Position, DEGREE),
    ("rev", Dimension::Position, REVOLUTION),
    ("m", Dimension::Position, 1.0),
    ("mm", Dimension::Position, 1e-3),
    ("rad/s", Dimension::Velocity, 1.0),
    ("deg/s", Dimension::Velocity, DEGREE),
    ("rev/s", Dimension::Velocity, REVOLUTION),
    ("rpm", Dimension::Velocity, REVOLUTION / 60.0),
    ("m/s", Dimension::Velocity, 1.0),
    ("mm/s", Dimension::Velocity, 1e-3),
    ("N m", Dimension::Effort, 1.0),
    ("Nm", Dimension::Effort, 1.0),
    ("mN m", Dimension::Effort, 1e-3),
    ("mNm", Dimension::Effort, 1e-3),
    ("kgf cm", Dimension::Effort, 0.098_066_5),
    ("kg cm", Dimension::Effort, 0.098_066_5),
    ("N", Dimension::Effort, 1.0),
    ("mN", Dimension::Effort, 1e-3),
    ("V", Dimension::Voltage, 1.0),
    ("mV", Dimension::Voltage, 1e-3),
];

impl Map {
    /// Reads the map in the TOML file at `path`.
    ///
    /// # Errors
    /// [`RobotError`] for a file that cannot be read, with file, line and column for what is wrong in it.
    pub fn load(path: &Path) -> Result<Self, RobotError> {
        Self::parse(&Source::read(path)?)
    }

    /// Reads a map from a text.
    ///
    /// # Errors
    /// [`RobotError`] with line and column.
    pub fn parse(source: &Source) -> Result<Self, RobotError> {
        let map: Self = toml::from_str(&source.text).map_err(|error| {
            let help = "see the documentation of column maps, and the examples in docs/maps";
            source.error(error.span().unwrap_or(0..0), error.message(), help)
        })?;
        map.check(source)?;
        Ok(map)
    }

    fn check(&self, source: &Source) -> Result<(), RobotError> {
        if !self.separator.is_ascii() {
            return Err(source.error(0..0, "the separator is not ASCII", "use one of , ; | or a tab, \"\\t\""));
        }
        if let Some(time) = &self.time {
            time.get_ref().check(source, time.span(), &[Dimension::Time])?;
        }
        if let Some(voltage) = &self.voltage {
            voltage.get_ref().check(source, voltage.span(), &[Dimension::Voltage])?;
        }
        let of_joints = |joint: &Spanned<JointColumns>| joint.get_ref().count();
        let columns = self
            .joint
            .iter()
            .map(of_joints)
            .fold(self.overrides.len(), usize::saturating_add);
        if columns > MAX_COLUMNS {
            let message = format!("{columns} columns");
            return Err(source.error(0..0, message, format!("name at most {MAX_COLUMNS}")));
        }
        let mut names = Vec::new();
        for joint in &self.joint {
            joint.get_ref().check(source, joint.span(), &mut names)?;
        }
        for (key, number) in &self.overrides {
            number.get_ref().check(source, number.span(), key)?;
        }
        Ok(())
    }

    /// Every column that holds numbers, once.
    pub(super) fn columns(&self) -> Vec<String> {
        let own = self
            .time
            .iter()
            .chain(&self.voltage)
            .map(|column| column.get_ref().column.clone());
        let of_joints = self.joint.iter().map(Spanned::get_ref).flat_map(|joint| {
            let columns = joint.columns().map(|(column, _)| column);
            let columns: Vec<&Column> = columns
                .chain(joint.enabled.iter())
                .chain(joint.extra.values())
                .collect();
            let of_joint = move |name: &String| columns.iter().map(|column| column.of(name)).collect::<Vec<_>>();
            joint.names.iter().flat_map(of_joint).collect::<Vec<_>>()
        });
        let of_overrides = self.overrides.values().filter_map(|number| match number.get_ref() {
            Number::From(scaled) => scaled.column.clone(),
            Number::Constant(_) => None,
        });
        let mut columns: Vec<String> = own.chain(of_joints).chain(of_overrides).collect();
        columns.sort();
        columns.dedup();
        columns
    }

    /// Every column that holds text, once.
    pub(super) fn text_columns(&self) -> Vec<String> {
        let labels = self.groups.values().filter_map(|label| match label {
            Label::From(Origin::Column(column)) => Some(column.clone()),
            _ => None,
        });
        let mut columns: Vec<String> = self.segment.clone().into_iter().chain(labels).collect();
        columns.sort();
        columns.dedup();
        columns
    }
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

    fn check(&self, source: &Source, span: Range<usize>, right: &[Dimension]) -> Result<(), RobotError> {
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
        let fitting = UNITS.iter().filter(|(_, dimension, _)| right.contains(dimension));
        let fitting: Vec<&str> = fitting.map(|(name, ..)| *name).collect();
        let message = format!("`{name}` is no unit for column `{}`", self.column);
        Err(source.error(
            span,
            message,
            format!("use {}, and `scale` for what is missing", fitting.join(", ")),
        ))
    }
}

fn unit(name: &str) -> Option<(Dimension, f64)> {
    let unit = UNITS.iter().find(|(known, ..)| *known == name);
    unit.map(|(_, dimension, factor)| (*dimension, *factor))
}

impl Number {
    fn check(&self, source: &Source, span: Range<usize>, key: &str) -> Result<(), RobotError> {
        let right = match self {
            Number::Constant(value) => value.is_finite(),
            Number::From(Scaled {
                field,
                column,
                scale,
                offset,
            }) => (field.is_some() != column.is_some()) && scale.is_finite() && offset.is_finite(),
        };
        if right {
            return Ok(());
        }
        let message = format!("override `{key}` is neither a finite number nor from one place");
        Err(source.error(span, message, "give a number, or exactly one of `field` and `column`"))
    }
}

impl JointColumns {
    /// The columns that are measured or told, with what they can measure.
    fn columns(&self) -> impl Iterator<Item = (&Column, &'static [Dimension])> {
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

    /// Columns of all its joints, one at least for each.
    fn count(&self) -> usize {
        let each = self.columns().count() + usize::from(self.enabled.is_some()) + self.extra.len();
        self.names.len().saturating_mul(each.max(1))
    }

    fn check(&self, source: &Source, span: Range<usize>, seen: &mut Vec<String>) -> Result<(), RobotError> {
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
            let shared = self.columns().map(|(column, _)| column).find(of_all);
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
        for (column, right) in self.columns() {
            column.check(source, span.clone(), right)?;
        }
        for column in self.enabled.iter().chain(self.extra.values()) {
            let any = [
                Dimension::Position,
                Dimension::Velocity,
                Dimension::Effort,
                Dimension::Voltage,
            ];
            column.check(source, span.clone(), &any)?;
        }
        Ok(())
    }
}
