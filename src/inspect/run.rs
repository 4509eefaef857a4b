//! Describes a run folder.

use std::path::Path;

use miette::Report;

use super::{config, metrics};
use crate::config::Layers;
use crate::run::RunFolder;
use crate::run::events::event_files;
use crate::run::metrics::Metrics;
use crate::run::sessions::Sessions;

pub(super) fn describe(path: &Path, defaults: &Layers) -> Result<String, Report> {
    let run = RunFolder::open(path)?;
    let mut text = format!("run {}\n{}", path.display(), config::describe(&run.config(), defaults)?);
    text += &sessions(&Sessions::open(&run.sessions())?);
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

/// How the run was made.
pub(super) fn sessions(sessions: &Sessions) -> String {
    let mut text = match sessions.list() {
        [] => return "how it was made: not recorded\n".to_owned(),
        [_] => "how it was made: in one session\n".to_owned(),
        list => format!("how it was made: in {} sessions\n", list.len()),
    };
    for session in sessions.list() {
        let arguments: Vec<String> = session.arguments.iter().map(|word| quoted(word)).collect();
        let commit = session.commit.as_ref().map(|commit| format!(", commit {commit}"));
        let engine = session.engine_simd.as_ref().map(|level| format!(", engine {level}"));
        text += &format!(
            "  omniwalk {}\n    {}, steps {} to {} in {:.1} minutes, seed {}\n    omniwalk {}{}, {} threads, learner {}{}\n",
            arguments.join(" "),
            session.started,
            session.first_step,
            session.last_step,
            session.seconds / 60.0,
            session.seed,
            session.version,
            commit.unwrap_or_default(),
            session.threads,
            session.learner_simd,
            engine.unwrap_or_default(),
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

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=:,+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}
