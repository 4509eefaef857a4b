//! What a file or folder holds, in a few lines for a terminal.

mod checkpoint;
mod config;
mod events;
mod log;
mod policy;
mod robot;
mod run;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use miette::{Diagnostic, Report};
use thiserror::Error;

use crate::config::Layers;
use crate::run::metrics::Metrics;
use crate::run::sessions::Sessions;

/// Every MCAP file starts with these bytes.
const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Why there is nothing to say of a path.
#[derive(Debug, Error, Diagnostic)]
enum InspectError {
    #[error("cannot read {}: {source}", .path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{}: {why}", .path.display())]
    Policy { path: PathBuf, why: String },
    #[error("{} is none of the files omniwalk knows", .0.display())]
    #[diagnostic(help(
        "it knows robots (.urdf, or a folder with one), run folders, policies (.omni), checkpoints (.safetensors), logs (.mcap), configurations (.toml), \
         metrics (.csv) and TensorBoard events"
    ))]
    Unknown(PathBuf),
}

/// Describes the file or folder at `path`; `defaults` are what a configuration is compared with.
///
/// # Errors
/// A report for what cannot be read, is damaged, or is of an unknown kind.
pub fn describe(path: &Path, defaults: &Layers) -> Result<String, Report> {
    let text = match kind(path)? {
        Kind::Run => run::describe(path, defaults)?,
        Kind::Robot => robot::describe(path, defaults)?,
        Kind::Checkpoint => checkpoint::describe(path)?,
        Kind::Policy => policy::describe(path)?,
        Kind::Log => log::describe(path)?,
        Kind::Sessions => run::sessions(&Sessions::open(path)?),
        Kind::Config => config::describe(path, defaults)?,
        Kind::Metrics => metrics(&Metrics::read(path)?),
        Kind::Events => events::describe(path)?,
    };
    Ok(text
        .chars()
        .map(|c| {
            if c.is_control() && c != '\n' {
                char::REPLACEMENT_CHARACTER
            } else {
                c
            }
        })
        .collect())
}

enum Kind {
    Run,
    Robot,
    Policy,
    Checkpoint,
    Log,
    Sessions,
    Config,
    Metrics,
    Events,
}

fn kind(path: &Path) -> Result<Kind, InspectError> {
    let io = |source| InspectError::Io {
        path: path.to_owned(),
        source,
    };
    let unknown = || InspectError::Unknown(path.to_owned());
    if std::fs::metadata(path).map_err(io)?.is_dir() {
        return match path.join("config.toml").is_file() {
            true => Ok(Kind::Run),
            false if holds_urdf(path).map_err(io)? => Ok(Kind::Robot),
            false => Err(unknown()),
        };
    }
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MCAP_MAGIC.len() as u64).read_to_end(&mut start))
        .map_err(io)?;
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        _ if start == MCAP_MAGIC => Ok(Kind::Log),
        _ if start == omniwalk_controller::file::MAGIC => Ok(Kind::Policy),
        _ if name.contains("tfevents") => Ok(Kind::Events),
        Some("urdf") => Ok(Kind::Robot),
        Some("omni") => Ok(Kind::Policy),
        Some("mcap") => Ok(Kind::Log),
        Some("safetensors") => Ok(Kind::Checkpoint),
        Some("toml") if name == "sessions.toml" => Ok(Kind::Sessions),
        Some("toml") => Ok(Kind::Config),
        Some("csv") => Ok(Kind::Metrics),
        _ => Err(unknown()),
    }
}

fn holds_urdf(folder: &Path) -> std::io::Result<bool> {
    let mut entries = std::fs::read_dir(folder)?.flatten();
    Ok(entries.any(|entry| entry.path().extension().is_some_and(|extension| extension == "urdf")))
}

fn metrics(metrics: &Metrics) -> String {
    let mut text = format!("metrics: {} rows of {} columns\n", metrics.rows, metrics.columns.len());
    let Some((step, values)) = &metrics.last else {
        return text;
    };
    text += &format!("  last row: step {step}\n");
    let width = metrics
        .columns
        .iter()
        .map(|column| column.chars().count())
        .max()
        .unwrap_or(0);
    for (column, value) in metrics.columns.iter().zip(values) {
        let value = if value.is_nan() {
            "not measured".to_owned()
        } else {
            format!("{value:.6}")
        };
        text += &format!("    {column:<width$}  {value}\n");
    }
    text
}
