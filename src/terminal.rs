//! Lines for standard output, whose reader may go and whose disk may be full.

use std::fmt::Display;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use miette::Diagnostic;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use thiserror::Error;

/// Why a line was not written.
#[derive(Debug, Error, Diagnostic)]
pub enum OutputError {
    /// Whoever read has stopped reading, as `head` does: the program ends, and nothing needs to be said.
    #[error("standard output was closed")]
    Closed,
    /// Anything else, such as a full disk.
    #[error("cannot write to standard output: {0}")]
    Failed(io::Error),
}

/// Writes `line` and the end of the line.
///
/// # Errors
/// When standard output takes no more.
pub fn say(line: impl Display) -> Result<(), OutputError> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")
        .and_then(|()| out.flush())
        .map_err(|error| match error.kind() {
            io::ErrorKind::BrokenPipe => OutputError::Closed,
            _ => OutputError::Failed(error),
        })
}

/// Tells whoever runs the program: `line` on standard error, which may have gone, as `tee` does at a Ctrl-C, or be full. What the
/// program is doing goes on all the same (`eprintln!` would panic).
pub fn tell(line: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// A flag that Ctrl-C sets, SIGTERM as a machine that shuts down sends it, and SIGHUP as a terminal that is closed does, unless
/// `nohup` says that it means nothing. A second one ends the process.
///
/// # Errors
/// When the system takes no handlers.
pub fn interrupt() -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let hangup = (!is_ignored(SIGHUP)).then_some(SIGHUP);
    for signal in [SIGINT, SIGTERM].into_iter().chain(hangup) {
        // Looked at before the flag is set: the first time it is not.
        flag::register_conditional_shutdown(signal, 128 + signal, stop.clone())?;
        flag::register(signal, stop.clone())?;
    }
    Ok(stop)
}

/// Whether whoever started the process had `signal` ignored; where the system has no `/proc` to say so it counts as ignored.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_none_or(|mask| mask >> (signal - 1) & 1 == 1)
}

/// A word as a shell takes it.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=:,+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}
