//! Describes the folders in a run's folder.

use std::path::{Path, PathBuf};

use super::log;
use crate::run::checkpoint::Checkpoint;
use crate::run::checkpoints::Checkpoints;

/// Every checkpoint, and whether it is whole.
pub(super) fn checkpoints(folder: &Path) -> String {
    let list = Checkpoints::new(folder).list();
    let mut text = format!("checkpoints: {}\n", list.len());
    for (step, path) in list {
        text += &match Checkpoint::read(&path) {
            Ok(checkpoint) => format!("  step {step}: whole, {} tensors\n", checkpoint.tensors.len()),
            Err(error) => format!("  step {step}: {error}\n"),
        };
    }
    text
}

/// Every rollout with its length.
pub(super) fn rollouts(logs: &[PathBuf]) -> String {
    let mut text = format!("rollouts: {}\n", logs.len());
    for path in logs {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        text += &match log::describe(path) {
            Ok(about) => format!("  {name}: {}\n", about.lines().next().unwrap_or_default()),
            Err(error) => format!("  {name}: {error}\n"),
        };
    }
    text
}
