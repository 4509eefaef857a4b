//! The command line of omniwalk.
//!
//! Bad input ends in a report on stderr and exit code 2, and nothing is written. A cross-check that fails ends in exit code 1.

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
#[cfg(unix)]
use omniwalk::command::rehearse;
use omniwalk::command::{
    bench, crosscheck, eval, excite, export, guide, identify, init, inspect, replay, report, train, view,
};
use omniwalk::terminal::OutputError;

/// Teaches a humanoid robot to walk in any direction, on an ordinary CPU.
#[derive(Parser)]
#[command(version, max_term_width = 120)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Init(init::Args),
    Train(train::Args),
    Eval(eval::Args),
    Export(export::Args),
    Identify(identify::Args),
    Inspect(inspect::Args),
    Excite(excite::Args),
    Replay(replay::Args),
    Bench(bench::Args),
    Crosscheck(crosscheck::Args),
    #[cfg(unix)]
    Rehearse(rehearse::Args),
    Report(report::Args),
    View(view::Args),
    Completions(guide::Completions),
    Man(guide::Man),
}

fn main() -> ExitCode {
    let result = match CommandLine::parse().command {
        Command::Init(args) => init::run(&args),
        Command::Train(args) => train::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Identify(args) => identify::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Excite(args) => excite::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Crosscheck(args) => match crosscheck::run(&args) {
            Ok(false) => return ExitCode::FAILURE,
            result => result.map(drop),
        },
        #[cfg(unix)]
        Command::Rehearse(args) => rehearse::run(&args),
        Command::Report(args) => report::run(&args),
        Command::View(args) => view::run(&args),
        Command::Completions(args) => guide::completions(&args, CommandLine::command()),
        Command::Man(args) => guide::man(&args, CommandLine::command()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(report) if matches!(report.downcast_ref(), Some(OutputError::Closed)) => ExitCode::SUCCESS,
        Err(report) => {
            omniwalk::terminal::tell(format_args!("{}", omniwalk::complaint::text(&report)));
            ExitCode::from(2)
        }
    }
}
