//! Logs as identification sees them: what each joint was told and what it did, each quantity on its own clock.
//!
//! Samples are what was measured: nothing is interpolated or filtered. Rows that repeat an earlier reading because
//! nothing new had arrived are left out and counted, and so are single readings that no joint took.

mod clock;
mod columns;
mod csv;
mod dropout;
mod error;
mod json;
mod labels;
mod map;
mod mcap;
mod outliers;
pub(crate) mod overrides;
mod pace;
mod pause;
mod repeats;
mod rows;
mod sender;
mod table;
mod units;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

pub use error::RecordingError;
pub use map::Map;
pub(crate) use pace::{Pace, median};
pub use pause::Jump;
pub(crate) use pause::LONGEST_PAUSE;

use map::Format;

/// Values on their own clock.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples<T> {
    /// When, s from the log's start, strictly increasing.
    pub time: Vec<f64>,
    /// What; as many as times.
    pub value: Vec<T>,
}

/// Samples of one quantity.
pub type Series = Samples<f64>;

impl<T> Default for Samples<T> {
    fn default() -> Self {
        Self {
            time: Vec::new(),
            value: Vec::new(),
        }
    }
}

impl<T> Samples<T> {
    /// How many.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The last value at or before `time` (s); `None` before the first.
    pub fn held_at(&self, time: f64) -> Option<&T> {
        let after = self.time.partition_point(|&t| t <= time);
        self.value.get(after.checked_sub(1)?)
    }

    /// Time from the first to the last sample, s; 0 without any.
    pub fn span(&self) -> f64 {
        match (self.time.first(), self.time.last()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        }
    }

    fn push(&mut self, time: f64, value: T) {
        self.time.push(time);
        self.value.push(value);
    }
}

/// What a joint's command says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CommandKind {
    /// Where to go: rad, or m for a sliding joint.
    #[default]
    Position,
    /// How hard to push: N m, or N for a sliding joint.
    Effort,
}

/// What one joint was told and did; a series is empty where the log has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointRecord {
    /// The joint's name in the log.
    pub name: String,
    /// What the command says.
    pub command_kind: CommandKind,
    /// Commands; each holds until the next.
    pub command: Series,
    /// The same at other moments, as likely, where a table only shows between which of its rows they were given; else empty.
    pub otherwise: Series,
    /// Measured position, rad (m).
    pub position: Series,
    /// Measured velocity, rad/s (m/s).
    pub velocity: Series,
    /// Measured effort, N m (N).
    pub effort: Series,
    /// 1 where the motor is on, 0 where it is off; each holds until the next, and the motor is on before the first.
    pub enabled: Series,
    /// Whatever else was measured at this joint, by name, in the log's units: `temperature`, `load`, `voltage`.
    pub extra: BTreeMap<String, Series>,
    /// Readings that were left out because they repeat the one before while the joint was moving.
    pub repeated: usize,
    /// Readings of the position that were left out because no joint took them: far off both neighbours, and back.
    pub outliers: usize,
    /// Rows or messages that have this joint, and no number as its position.
    pub missing: usize,
}

impl JointRecord {
    /// Whether the motor is on at `time`, s.
    pub fn is_on(&self, time: f64) -> bool {
        self.enabled.held_at(time).is_none_or(|on| *on > 0.0)
    }
}

/// Readings of an inertial measurement unit, in its own frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImuRecord {
    /// Orientation in the world; empty where the unit gives none.
    pub orientation: Samples<UnitQuaternion<f64>>,
    /// Angular velocity, rad/s.
    pub angular_velocity: Samples<Vector3<f64>>,
    /// Specific force, m/s^2.
    pub linear_acceleration: Samples<Vector3<f64>>,
}

/// Motion of the base, where it is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OdometryRecord {
    /// Pose in the world, m.
    pub pose: Samples<Isometry3<f64>>,
    /// Linear velocity in the base's own frame, m/s.
    pub linear_velocity: Samples<Vector3<f64>>,
    /// Angular velocity in the base's own frame, rad/s.
    pub angular_velocity: Samples<Vector3<f64>>,
}

/// Which clock the times of a topic came from.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicClock {
    /// The topic.
    pub topic: String,
    /// Median of log time minus header stamp, s; `None` where messages carry no stamp and log time was used.
    pub log_minus_stamp: Option<f64>,
}

/// One log, or one segment of a log that holds several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// The file's name without ending; behind a colon the segment, if the file holds several.
    pub name: String,
    /// Labels to group logs by, such as `trajectory` or `gain`.
    pub groups: BTreeMap<String, String>,
    /// Parameters of the robot that are different in this log, by dotted key: `kp`, `payload.mass`,
    /// `supply_voltage`, `joint.NAME.kp`.
    pub overrides: BTreeMap<String, f64>,
    /// The joints, in the log's order.
    pub joints: Vec<JointRecord>,
    /// The inertial measurement unit.
    pub imu: Option<ImuRecord>,
    /// Motion of the base.
    pub odometry: Option<OdometryRecord>,
    /// Desired velocity (m/s, m/s, rad/s); each holds until the next.
    pub velocity_command: Samples<[f64; 3]>,
    /// Supply voltage, V.
    pub voltage: Series,
    /// The clocks of an MCAP file's topics.
    pub clocks: Vec<TopicClock>,
    /// What reading had to assume or leave out.
    pub notes: Vec<String>,
}

/// Reads the recordings in the log at `path`: MCAP as it is, CSV and JSON through a column map, which can also
/// label an MCAP file and override the robot's parameters for it.
///
/// # Errors
/// [`RecordingError`] for a file that cannot be read or holds what it should not, with the place.
pub fn read(path: &Path, map: Option<&Map>) -> Result<Vec<Recording>, RecordingError> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut recordings = match (format(path, map)?, map) {
        (Format::Mcap, map) => vec![mcap::read(path, name, map)?],
        (Format::Csv, Some(map)) => rows::recordings(path, &name, map, &csv::read(path, map)?)?,
        (Format::Json, Some(map)) => rows::recordings(path, &name, map, &json::read(path, map)?)?,
        (_, None) => {
            let help = "give a column map with --map that says what its columns mean; there are examples in docs/maps";
            return Err(content(path, "the file", "it is no MCAP file".into(), help));
        }
    };
    for joint in recordings.iter_mut().flat_map(|recording| &mut recording.joints) {
        joint.outliers = outliers::take_out(&mut joint.position);
    }
    Ok(recordings)
}

/// What kind of file is at `path`.
fn format(path: &Path, map: Option<&Map>) -> Result<Format, RecordingError> {
    let mut magic = [0; 5];
    let file = std::fs::File::open(path);
    let read = file.and_then(|mut file| file.read(&mut magic));
    read.map_err(|error| content(path, "the file", error.to_string(), "give a file that can be read"))?;
    if magic == *b"\x89MCAP" {
        return Ok(Format::Mcap);
    }
    let ending = path
        .extension()
        .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let by_ending = match ending.as_deref() {
        Some("json") => Some(Format::Json),
        Some("csv" | "tsv" | "txt" | "dat") => Some(Format::Csv),
        Some("mcap") => Some(Format::Mcap),
        _ => None,
    };
    map.and_then(|map| map.format).or(by_ending).ok_or_else(|| {
        let help = "set `format` to csv or json in the column map";
        content(path, "the file", "its name does not tell what is in it".into(), help)
    })
}

/// An error at a place in a file.
fn content(path: &Path, place: &str, why: String, help: &str) -> RecordingError {
    RecordingError::Content {
        path: path.to_owned(),
        place: place.to_owned(),
        why,
        help: help.to_owned(),
    }
}

impl Recording {
    /// The joint of this name.
    pub fn joint(&self, name: &str) -> Option<&JointRecord> {
        self.joints.iter().find(|joint| joint.name == name)
    }

    /// Whether both hold the same readings: one is a copy of the other.
    pub fn is_copy_of(&self, other: &Self) -> bool {
        let own = self.joints.iter().map(|joint| &joint.position);
        own.eq(other.joints.iter().map(|joint| &joint.position))
    }

    /// Time of the last sample of any joint, s from the log's start.
    pub fn duration(&self) -> f64 {
        let last = |series: &Series| series.time.last().copied().unwrap_or(0.0);
        let of_joint = |joint: &JointRecord| {
            last(&joint.command)
                .max(last(&joint.position))
                .max(last(&joint.velocity))
        };
        self.joints.iter().map(of_joint).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests;
