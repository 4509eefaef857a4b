//! `omniwalk inspect`.

use std::path::PathBuf;

use crate::config::Layers;
use crate::inspect;
use crate::settings::DEFAULT;
use crate::terminal::say;

/// Describes what a robot, a log, a configuration, a run folder or a file in it, an evaluation, or what `identify` or `report` wrote holds.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The file or folder.
    path: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// When the file is of no known kind or damaged.
pub fn run(args: &Args) -> miette::Result<()> {
    let text = inspect::describe(&args.path, &Layers::new(DEFAULT)?)?;
    Ok(say(text.trim_end_matches('\n'))?)
}
