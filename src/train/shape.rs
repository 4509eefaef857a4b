//! What shaped a run: every setting and robot file that changes the layout or the learning. A checkpoint carries it,
//! so that a run does not go on under settings that it was not trained with.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use omniwalk_env::config::EngineKind;
use serde_json::{Map, Value};
use thiserror::Error;

use crate::run::checkpoint::Checkpoint;
use crate::settings::Settings;

/// Settings a run may be resumed with whatever they were: they change how long it trains, where its files are and how
/// it is judged. A dot at the end means the whole section.
const FREE: [&str; 5] = [
    "train.steps",
    "train.checkpoint_minutes",
    "train.keep_checkpoints",
    "robot.path",
    "eval.",
];
/// Metadata: the shape.
const SHAPE: &str = "configuration";
/// Metadata: its hash.
const HASH: &str = "configuration_hash";

/// Settings by dotted key, robot files by `robot/NAME` with their checksum.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape(BTreeMap<String, Value>);

/// Why a run cannot go on.
#[derive(Debug, Error, Diagnostic)]
pub enum ShapeError {
    /// A file of the robot cannot be read.
    #[error("cannot read {}: {why}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        why: io::Error,
    },
    /// The run was trained with other settings.
    #[error("the run was trained with other settings than its folder holds now: {}", .0.join("; "))]
    #[diagnostic(help(
        "undo the change to go on with this run, or start another from its weights: omniwalk train CONFIG --from RUN"
    ))]
    Differs(Vec<String>),
}

impl Shape {
    /// What shapes a run with `settings` and the robot files in `robot`.
    ///
    /// # Errors
    /// [`ShapeError::Io`].
    pub fn new(settings: &Settings, robot: &Path) -> Result<Self, ShapeError> {
        let mut values = by_key(settings);
        values.retain(|key, _| {
            !FREE
                .iter()
                .any(|free| key == free || free.ends_with('.') && key.starts_with(free))
        });
        // The level that is used counts, not whether it was chosen or found: its width is in the environments' state.
        match simd(settings) {
            Some(level) => values.insert("engine.simd".into(), level.into()),
            None => values.remove("engine.simd"),
        };
        files(robot, &mut values).map_err(|(path, why)| ShapeError::Io { path, why })?;
        Ok(Self(values))
    }

    /// Eight hexadecimal digits that differ between shapes (CRC-32C).
    pub fn hash(&self) -> String {
        let text = self.0.iter().map(|(key, value)| format!("{key}={value}\n"));
        let crc = text.fold(0, |crc, line| crc32c::crc32c_append(crc, line.as_bytes()));
        format!("{crc:08x}")
    }

    /// Notes the shape in a checkpoint.
    pub fn note(&self, checkpoint: &mut Checkpoint) {
        let values: Map<String, Value> = self.0.clone().into_iter().collect();
        checkpoint.metadata.insert(SHAPE.into(), values.into());
        checkpoint.metadata.insert(HASH.into(), self.hash().into());
    }

    /// The hash of what shaped `checkpoint`, if it says so.
    pub fn hash_of(checkpoint: &Checkpoint) -> Option<String> {
        checkpoint.metadata.get(HASH)?.as_str().map(str::to_owned)
    }

    /// Checks that `checkpoint` was shaped like this. A checkpoint of an older version may say nothing, or not know
    /// a setting that is new: that is no difference; the new ones are given back, so that the user can hear of them.
    ///
    /// # Errors
    /// [`ShapeError::Differs`] with every difference.
    pub fn check(&self, checkpoint: &Checkpoint) -> Result<Vec<String>, ShapeError> {
        let Some(Value::Object(old)) = checkpoint.metadata.get(SHAPE) else {
            return Ok(Vec::new());
        };
        let mut differences: Vec<String> = old
            .iter()
            .filter(|(key, value)| self.0.get(*key) != Some(value))
            .map(|(key, value)| describe(key, value, self.0.get(key)))
            .collect();
        // Files are always known, so one that is new was put there.
        let unknown = self.0.iter().filter(|(key, _)| !old.contains_key(*key));
        let (files, settings): (Vec<_>, Vec<_>) = unknown.partition(|(key, _)| key.starts_with("robot/"));
        differences.extend(files.iter().map(|(file, _)| format!("{file} was added")));
        if differences.is_empty() {
            Ok(settings.iter().map(|(key, value)| format!("{key} = {value}")).collect())
        } else {
            Err(ShapeError::Differs(differences))
        }
    }
}

/// Every setting by its dotted key.
pub fn by_key(settings: &Settings) -> BTreeMap<String, Value> {
    let mut values = BTreeMap::new();
    // Settings are plain data: they always serialise.
    flatten("", serde_json::to_value(settings).unwrap_or_default(), &mut values);
    values
}

/// The SIMD level the engine uses, if there is a choice.
pub fn simd(settings: &Settings) -> Option<&'static str> {
    let lanes = settings.env.engine.kind == EngineKind::Lanes;
    lanes.then(|| settings.env.engine.simd.level().name())
}

fn describe(key: &str, old: &Value, new: Option<&Value>) -> String {
    match new {
        Some(_) if key.starts_with("robot/") => format!("{key} was edited"),
        Some(new) => format!("{key} was {old} and is {new}"),
        None => format!("{key} was {old} and is gone"),
    }
}

fn flatten(path: &str, value: Value, values: &mut BTreeMap<String, Value>) {
    let Value::Object(entries) = value else {
        values.insert(path.to_owned(), value);
        return;
    };
    for (key, value) in entries {
        let below = if path.is_empty() { key } else { format!("{path}.{key}") };
        flatten(&below, value, values);
    }
}

fn files(folder: &Path, values: &mut BTreeMap<String, Value>) -> Result<(), (PathBuf, io::Error)> {
    let entries = fs::read_dir(folder).map_err(|error| (folder.to_owned(), error))?;
    for entry in entries {
        let path = entry.map_err(|error| (folder.to_owned(), error))?.path();
        let known = matches!(path.extension().and_then(|e| e.to_str()), Some("urdf" | "toml"));
        if let (true, Some(name)) = (known, path.file_name()) {
            let bytes = fs::read(&path).map_err(|error| (path.clone(), error))?;
            let checksum = format!("{:08x}", crc32c::crc32c(&bytes));
            values.insert(format!("robot/{}", name.to_string_lossy()), checksum.into());
        }
    }
    Ok(())
}
