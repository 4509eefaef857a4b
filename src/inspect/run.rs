//! Describes a run folder.

use std::path::Path;

use miette::Report;

use super::{config, evaluation, metrics};
use crate::complaint::plain;
use crate::config::Layers;
use crate::run::RunFolder;
use crate::run::events::event_files;
use crate::run::metrics::Metrics;
use crate::run::sessions::Sessions;
use crate::terminal::tell;

pub(super) fn describe(path: &Path, defaults: &Layers) -> Result<String, Report> {
    let run = RunFolder::open(path)?;
    let configuration = match run.emptied() {
        Some(emptied) => format!("configuration: {emptied}\n"),
        None => config::describe(&run.config(), defaults)?,
    };
    let mut text = format!("run {}\n{configuration}", path.display());
    text += &match Sessions::open(&run.sessions()) {
        Ok(record) => sessions(&record),
        Err(error) => {
            tell(format_args!("warning: {error}"));
            "how it was made: not known, its record is damaged\n".to_owned()
        }
    };
    text += &match run.metrics().exists().then(|| Metrics::read(&run.metrics())) {
        Some(Ok(read)) => metrics(&read),
        Some(Err(error)) => {
            tell(format_args!("warning: {error}"));
            "metrics: not known, their file is damaged\n".to_owned()
        }
        None => "metrics: none yet\n".to_owned(),
    };
    let judged = path.join("eval.json");
    match judged.exists().then(|| evaluation::describe(&judged)) {
        Some(Ok(_)) => text += "evaluation: eval.json\n",
        Some(Err(error)) => tell(format_args!("warning: {}", plain(&error.into()))),
        None => {}
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

/// How the run was made.
pub(super) fn sessions(sessions: &Sessions) -> String {
    let mut text = match sessions.list() {
        [] => return "how it was made: not recorded\n".to_owned(),
        [_] => "how it was made: in one session\n".to_owned(),
        list => format!("how it was made: in {} sessions\n", list.len()),
    };
    for session in sessions.list() {
        text += &format!(
            "  {}\n    {}, steps {} to {} in {:.1} minutes, seed {}\n    {}\n",
            session.command(),
            session.started,
            session.first_step,
            session.last_step,
            session.seconds / 60.0,
            session.seed,
            session.program(),
        );
        if let Some(from) = &session.from {
            let configuration = from.configuration.as_deref().unwrap_or("not known");
            text += &format!(
                "    began with {} of {} at step {}, configuration {configuration}\n",
                from.taken.join(", "),
                from.run.display(),
                from.step,
            );
        }
    }
    text
}
