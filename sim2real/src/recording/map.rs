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
//! `true` and `false` are 1 and 0 in columns of `enabled` and `extra`, and nothing anywhere else.
//!
//! Parameters that can be overridden: `kp`, `kp_scale`, `kd`, `torque_limit`, `speed_limit`, `armature`, `damping`, `friction`,
//! `supply_voltage`, for one joint `joint.NAME.kp` and so on; `payload.mass` (docs/maps/README.md says what each does).

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

use omniwalk_env::robot::{RobotError, Source};
use serde::Deserialize;
use toml::Spanned;

use super::columns::{Column, JointColumns};
use super::overrides;
use super::units::Dimension;

/// Columns that a map may name, each `{joint}` for every joint: a hundred of each of forty joints.
const MAX_COLUMNS: usize = 4096;

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
    expecting = "an override is a number, { field = \"...\" } or { column = \"...\" }, the latter two perhaps with scale and offset; a key with dots stands in quotes: \"payload.mass\" = 0.2"
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

    /// Whether it says what columns mean, which says nothing of an MCAP file.
    pub(super) fn is_of_columns(&self) -> bool {
        self.time.is_some() || self.voltage.is_some() || !self.joint.is_empty()
    }

    /// Every column that holds numbers, once.
    pub(super) fn columns(&self) -> Vec<String> {
        let own = self
            .time
            .iter()
            .chain(&self.voltage)
            .map(|column| column.get_ref().column.clone());
        let of_joints = self.joint.iter().flat_map(|joint| joint.get_ref().all_names());
        let of_overrides = self.overrides.values().filter_map(|number| match number.get_ref() {
            Number::From(scaled) => scaled.column.clone(),
            Number::Constant(_) => None,
        });
        let mut columns: Vec<String> = own.chain(of_joints).chain(of_overrides).collect();
        columns.sort();
        columns.dedup();
        columns
    }

    /// Every column that may hold true or false.
    pub(super) fn truth_columns(&self) -> BTreeSet<String> {
        let joints = self.joint.iter().map(Spanned::get_ref);
        joints.flat_map(JointColumns::truth_names).collect()
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

impl Number {
    /// Whether it can be the value of the parameter `key`, as far as the map tells.
    fn check(&self, source: &Source, span: Range<usize>, key: &str) -> Result<(), RobotError> {
        if !overrides::exists(key) {
            let message = format!("override `{key}` names no parameter");
            return Err(source.error(span, message, overrides::keys()));
        }
        let right = match self {
            Number::Constant(value) => value.is_finite(),
            Number::From(Scaled {
                field,
                column,
                scale,
                offset,
            }) => (field.is_some() != column.is_some()) && scale.is_finite() && offset.is_finite(),
        };
        if !right {
            let message = format!("override `{key}` is neither a finite number nor from one place");
            return Err(source.error(span, message, "give a number, or exactly one of `field` and `column`"));
        }
        let Number::Constant(value) = *self else { return Ok(()) };
        overrides::right_instead(key, value).map_or(Ok(()), |right| {
            Err(source.error(span, format!("override `{key}` cannot be {value}"), right))
        })
    }
}
