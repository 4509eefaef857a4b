//! What a file or folder holds, in a few lines for a terminal.

mod checkpoint;
mod config;
mod evaluation;
mod events;
mod folder;
mod identification;
mod log;
mod policy;
mod robot;
mod run;

use std::io::Read;
use std::path::{Path, PathBuf};

use miette::{Diagnostic, Report};
use thiserror::Error;

use omniwalk_sim2real::identify::is_unfinished;

use crate::config::Layers;
use crate::files;
use crate::report::html::HEAD;
use crate::run::files_of;
use crate::run::metrics::Metrics;
use crate::run::sessions::Sessions;

/// Every MCAP file starts with these bytes.
const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Name of a robot's settings, beside its URDF.
const ROBOT_SETTINGS: &str = "robot.toml";

/// Every PNG file starts with these bytes.
const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Bytes that tell files apart.
const MAGIC_BYTES: u64 = 8;
/// Largest picture or page that is read, bytes.
const MAX_PAGE_BYTES: u64 = 64 << 20;

/// Numbers from here on are written with an exponent.
const MOST_DIGITS: f64 = 1e15;

/// Why there is nothing to say of a path.
#[derive(Debug, Error, Diagnostic)]
enum InspectError {
    #[error("cannot read {}: {why}", .path.display())]
    Io { path: PathBuf, why: std::io::Error },
    #[error("{}: {why}", .path.display())]
    Damaged { path: PathBuf, why: String },
    #[error("{} holds what an identification came to before it was interrupted, and no result yet", .0.display())]
    #[diagnostic(help("the same `omniwalk identify` goes on from there"))]
    Unfinished(PathBuf),
    #[error("{} is none of the files omniwalk knows", .0.display())]
    #[diagnostic(help(
        "it knows robots (.urdf, or a folder with one), run folders and the folders in them, policies (.omni), checkpoints \
         (.safetensors), logs (.mcap), configurations (.toml), metrics (.csv), TensorBoard events, evaluations (.json), \
         what `omniwalk identify` writes (a folder with report.json) and what `omniwalk report` writes (.png, .html)"
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
        Kind::Checkpoints => folder::checkpoints(path),
        Kind::Rollouts(logs) => folder::rollouts(&logs),
        Kind::Robot => robot::describe(path, defaults)?,
        Kind::RobotSettings(folder) => robot::describe(&folder, defaults)?,
        Kind::Checkpoint => checkpoint::describe(path)?,
        Kind::Policy => policy::describe(path)?,
        Kind::Log => log::describe(path)?,
        Kind::Sessions => run::sessions(&Sessions::open(path)?),
        Kind::Config => config::describe(path, defaults)?,
        Kind::Metrics => metrics(&Metrics::read(path)?),
        Kind::Events => events::describe(path)?,
        Kind::Evaluation => evaluation::describe(path)?,
        Kind::Identification(report) => identification::describe(&report)?,
        Kind::Picture => picture(path)?,
        Kind::Report => report(path)?,
        Kind::Lock => "lock of a run folder: held while a process trains there\n".to_owned(),
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
    Checkpoints,
    /// The rollouts.
    Rollouts(Vec<PathBuf>),
    Robot,
    /// The TOML of the robot in a folder.
    RobotSettings(PathBuf),
    Policy,
    Checkpoint,
    Log,
    Sessions,
    Config,
    Metrics,
    Events,
    Evaluation,
    /// The report.
    Identification(PathBuf),
    Picture,
    Report,
    Lock,
}

fn kind(path: &Path) -> Result<Kind, InspectError> {
    let io = |why| InspectError::Io {
        path: path.to_owned(),
        why,
    };
    let unknown = || InspectError::Unknown(path.to_owned());
    if std::fs::metadata(path).map_err(io)?.is_dir() {
        let unfinished = || InspectError::Unfinished(path.to_owned());
        let or_not = || if is_unfinished(path) { unfinished() } else { unknown() };
        return folder_kind(path).map_err(io)?.ok_or_else(or_not);
    }
    let mut start = Vec::new();
    files::open(path)
        .and_then(|file| file.take(MAGIC_BYTES).read_to_end(&mut start))
        .map_err(io)?;
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        _ if start == MCAP_MAGIC => Ok(Kind::Log),
        _ if start == omniwalk_controller::file::MAGIC => Ok(Kind::Policy),
        _ if start == PNG_MAGIC => Ok(Kind::Picture),
        _ if name == ".lock" => Ok(Kind::Lock),
        _ if name.contains("tfevents") => Ok(Kind::Events),
        Some("urdf") => Ok(Kind::Robot),
        Some("omni") => Ok(Kind::Policy),
        Some("mcap") => Ok(Kind::Log),
        Some("safetensors") => Ok(Kind::Checkpoint),
        Some("toml") if name == "sessions.toml" => Ok(Kind::Sessions),
        Some("toml") if name == ROBOT_SETTINGS => Ok(match beside_a_urdf(path).map_err(io)? {
            Some(folder) => Kind::RobotSettings(folder),
            None => Kind::Config,
        }),
        Some("toml") => Ok(Kind::Config),
        Some("csv") => Ok(Kind::Metrics),
        Some("json") if identification::is_one(path) => Ok(Kind::Identification(path.to_owned())),
        Some("json") => Ok(Kind::Evaluation),
        Some("html") => Ok(Kind::Report),
        _ => Err(unknown()),
    }
}

fn folder_kind(path: &Path) -> std::io::Result<Option<Kind>> {
    if path.join("config.toml").is_file() {
        return Ok(Some(Kind::Run));
    }
    if !files_of(path, "urdf")?.is_empty() {
        return Ok(Some(Kind::Robot));
    }
    let report = path.join("report.json");
    if report.is_file() {
        return Ok(Some(Kind::Identification(report)));
    }
    let named = |name: &str| path.file_name().is_some_and(|own| own == name);
    let logs = files_of(path, "mcap")?;
    Ok(match files_of(path, "safetensors")?.is_empty() {
        false => Some(Kind::Checkpoints),
        true if !logs.is_empty() || named("rollouts") => Some(Kind::Rollouts(logs)),
        true => named("checkpoints").then_some(Kind::Checkpoints),
    })
}

/// The folder of a file if a robot is in it.
fn beside_a_urdf(path: &Path) -> std::io::Result<Option<PathBuf>> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    Ok((!files_of(folder, "urdf")?.is_empty()).then(|| folder.to_owned()))
}

/// The content of a file, which may have `limit` bytes at most.
fn read(path: &Path, limit: u64) -> Result<Vec<u8>, InspectError> {
    files::read(path, limit).map_err(|why| InspectError::Io {
        path: path.to_owned(),
        why,
    })
}

fn report(path: &Path) -> Result<String, InspectError> {
    let page = read(path, MAX_PAGE_BYTES)?;
    if !page.starts_with(HEAD.as_bytes()) {
        return Err(InspectError::Damaged {
            path: path.to_owned(),
            why: "no page of `omniwalk report`, `identify` or `replay`".to_owned(),
        });
    }
    let pictures = page.windows(5).filter(|tag| *tag == b"<img ").count();
    Ok(format!("report: a page for a browser with {pictures} pictures\n"))
}

fn picture(path: &Path) -> Result<String, InspectError> {
    let damaged = |why: String| InspectError::Damaged {
        path: path.to_owned(),
        why,
    };
    let bytes = read(path, MAX_PAGE_BYTES)?;
    let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info();
    let reader = reader.map_err(|error| damaged(error.to_string()))?;
    Ok(format!(
        "picture: {} x {} pixels\n",
        reader.info().width,
        reader.info().height
    ))
}

fn metrics(metrics: &Metrics) -> String {
    let mut text = format!("metrics: {} rows of {} columns\n", metrics.rows, metrics.columns.len());
    if let Some(damage) = metrics.damage() {
        text += &format!("  {damage}\n");
    }
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
        let value = match value {
            value if value.is_nan() => "not measured".to_owned(),
            value if value.abs() >= MOST_DIGITS => format!("{value:.6e}"),
            value => format!("{value:.6}"),
        };
        text += &format!("    {column:<width$}  {value}\n");
    }
    text
}
