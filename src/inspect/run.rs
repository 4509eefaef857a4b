//! Describes a run folder.

use std::path::Path;

use miette::Report;

use super::{config, metrics};
use crate::config::Layers;
use crate::run::RunFolder;
use crate::run::events::event_files;
use crate::run::metrics::Metrics;

pub(super) fn describe(path: &Path, defaults: &Layers) -> Result<String, Report> {
    let run = RunFolder::open(path)?;
    let mut text = format!("run {}\n{}", path.display(), config::describe(&run.config(), defaults)?);
    match run.metrics().exists() {
        true => text += &metrics(&Metrics::read(&run.metrics())?),
        false => text += "metrics: none yet\n",
    }
    let checkpoints = run.checkpoints();
    text += &format!("checkpoints: {}\n", checkpoints.list().len());
    if let Some(latest) = checkpoints.latest()? {
        text += &format!(
            "  newest whole one: step {}, {}\n",
            latest.checkpoint.step,
            latest.path.display()
        );
        for error in latest.skipped {
            text += &format!("  skipped: {error}\n");
        }
    }
    text += &format!("TensorBoard event files: {}\n", event_files(run.path()).len());
    let rollouts = std::fs::read_dir(run.rollouts())
        .map(|entries| entries.flatten().count())
        .unwrap_or(0);
    text += &format!("rollouts: {rollouts}\n");
    Ok(text)
}
