//! The command line of omniwalk.
//!
//! Bad input ends in a report on stderr and exit code 2, and nothing is written.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use miette::Report;
use omniwalk::config::Layers;
use omniwalk::inspect;

/// Teaches a humanoid robot to walk in any direction, on an ordinary CPU.
#[derive(Parser)]
#[command(version, max_term_width = 120)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Describes what a run folder, policy, checkpoint, log, configuration, metrics or events file holds.
    Inspect {
        /// The file or folder.
        path: PathBuf,
    },
}

fn main() -> ExitCode {
    match run(CommandLine::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(report) => {
            eprintln!("{report:?}");
            ExitCode::from(2)
        }
    }
}

fn run(command: Command) -> Result<(), Report> {
    match command {
        Command::Inspect { path } => {
            let text = inspect::describe(&path, &Layers::new("")?)?;
            // Whoever reads may stop reading, as `head` does.
            let _ = std::io::stdout().write_all(text.as_bytes());
            Ok(())
        }
    }
}
