//! `omniwalk identify`: which physical effect the model lacks.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_env::robot;
use omniwalk_sim2real::identify::{self, Outcome, Task, Verdict};
use omniwalk_sim2real::recording::{self, Map, RecordingError};

use super::load;
use crate::report::identification::{self, figure, left_by, said};
use crate::terminal::{OutputError, say, tell};

/// Held-out errors that are so many times those of the logs that were fitted are remarked.
const FAR_OFF: f64 = 3.0;
/// So many re-tuned values are listed; the report has all.
const RETUNED: usize = 14;

/// Finds the physical effect that the robot's model lacks, and writes the robot with it.
///
/// Parameters that the model has are re-tuned first. Then every effect of the library is tried by cross-validation inside the
/// logs, and taken where the error falls significantly. Held-out logs are opened after the last choice, to report.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Logs to fit: MCAP, or CSV and JSON with a column map.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The robot: a folder or a URDF.
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// The logs are of a robot on a stand: its base is held, its feet hang free. The robot that is written walks as before.
    #[arg(long)]
    stand: bool,
    /// Column map.
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Logs to report on; without, some of the others are set aside before anything is fitted.
    #[arg(long, value_name = "LOG", num_args = 1..)]
    heldout: Vec<PathBuf>,
    /// Folder for report.json, report.html and the robot with its effects. Where it was interrupted, the same command goes on.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Also fits every effect at once and reports its errors under `all_effects`, to compare with.
    #[arg(long)]
    compare: bool,
    /// Threads [default: all cores]; their number changes no bit of the result.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(super::THREADS))]
    threads: Option<u16>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with logs, map or robot, and logs that cannot carry an answer.
pub fn run(args: &Args) -> miette::Result<()> {
    if let Some(threads) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
        pool.build_global().into_diagnostic()?;
    }
    apart(&args.logs, &args.heldout)?;
    free(&args.out, &args.robot)?;
    let robot = load::held(&args.robot, args.stand)?;
    let map = args.map.as_deref().map(Map::load).transpose()?;
    let logs = load::recordings(&args.logs, map.as_ref())?;
    let open = || -> Result<_, RecordingError> {
        let logs = args.heldout.iter().map(|path| recording::read(path, map.as_ref()));
        Ok(logs.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
    };
    std::fs::create_dir_all(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", args.out.display()))?;
    let task = Task {
        robot: &robot,
        files: robot::files(&args.robot)?,
        logs,
        heldout: if args.heldout.is_empty() { None } else { Some(&open) },
        compare: args.compare,
        out: &args.out,
    };
    let outcome = identify::run(&task, &|line| tell(format_args!("{line}")))?;
    let json = serde_json::to_string_pretty(&outcome).into_diagnostic()? + "\n";
    // A folder with report.json is whole; one without goes on.
    load::write(&args.out.join("report.html"), &identification::page(&outcome)?)?;
    load::write(&args.out.join("report.json"), &json)?;
    identify::close(&args.out)?;
    if outcome.verdict == Verdict::InsufficientData {
        let own = outcome.reasons.iter().map(String::as_str);
        // What the check refused stands above.
        let refused: Vec<String> = outcome.check.refusals.iter().map(ToString::to_string).collect();
        let own: Vec<&str> = own
            .filter(|reason| !refused.iter().any(|known| known == reason))
            .collect();
        let help = if own.is_empty() {
            "what is refused above says what is missing, and what would be right".to_owned()
        } else {
            own.join("\n")
        };
        return Err(miette!(help = help, "these logs cannot carry an answer"));
    }
    summary(&outcome, &args.out)?;
    match &outcome.heldout_error {
        Some(error) => Err(miette!(
            help = "what was found and the robot with it are written; replay and identify tell more of those logs",
            "{error}"
        )),
        None => Ok(()),
    }
}

/// Whether `out` may be written to: it holds no result, and no robot but one of an identification that was interrupted.
fn free(out: &Path, robot: &Path) -> miette::Result<()> {
    let help = "give another folder with --out, or remove this one";
    if holds_result(&out.join("report.json")) {
        return Err(miette!(
            help = help,
            "{} holds the result of an identification",
            out.display()
        ));
    }
    let written = out.join("robot");
    let Ok(place) = std::fs::canonicalize(&written) else {
        return Ok(());
    };
    if std::fs::canonicalize(robot).is_ok_and(|robot| robot.starts_with(&place)) {
        return Err(miette!(
            help = help,
            "{} would be written over the robot that is read",
            written.display()
        ));
    }
    if !identify::is_unfinished(out) {
        return Err(miette!(
            help = help,
            "{} is there already, and of no identification that goes on",
            written.display()
        ));
    }
    Ok(())
}

/// Whether the report at `path` is a result; that logs could not carry one is none.
fn holds_result(path: &Path) -> bool {
    let Ok(text) = std::fs::read_to_string(path) else {
        return path.exists();
    };
    let report: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    report["verdict"] != serde_json::json!(Verdict::InsufficientData)
}

/// Whether every log is there and none is given twice: what was fitted says nothing of what was not.
fn apart(logs: &[PathBuf], heldout: &[PathBuf]) -> miette::Result<()> {
    let mut known: Vec<PathBuf> = Vec::new();
    for path in logs.iter().chain(heldout) {
        let place = std::fs::canonicalize(path)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot read {}", path.display()))?;
        if known.contains(&place) {
            return Err(miette!(
                help = "give each log once, to fit or under --heldout",
                "{} is given twice",
                path.display()
            ));
        }
        known.push(place);
    }
    Ok(())
}

fn summary(outcome: &Outcome, out: &Path) -> Result<(), OutputError> {
    say(format_args!("verdict: {}", said(outcome.verdict)))?;
    for accepted in &outcome.accepted {
        say(format_args!(
            "  {} of {} (p = {:.1e})",
            accepted.effect, accepted.target, accepted.p_value
        ))?;
        for (name, value) in &accepted.parameters {
            say(format_args!("    {name} = {value}"))?;
        }
    }
    for set in &outcome.indistinguishable {
        say(format_args!(
            "  cannot be told apart with these logs: {}",
            set.join(", ")
        ))?;
    }
    for alternative in outcome.alternatives.iter().flatten() {
        let written = if alternative.in_robot {
            ", in the robot that was written"
        } else {
            ""
        };
        say(format_args!(
            "    {} of {}{written}:",
            alternative.effect, alternative.target
        ))?;
        for (name, value) in &alternative.parameters {
            say(format_args!("      {name} = {value}"))?;
        }
    }
    for separation in &outcome.separation {
        say(format_args!("  {separation}"))?;
    }
    if outcome.verdict == Verdict::Unexplained {
        let share = 100.0 * outcome.unexplained.fraction;
        let over = outcome.unexplained.depends_on.join(", ");
        let over = if over.is_empty() {
            "nothing that was measured"
        } else {
            &over
        };
        let left = left_by(outcome);
        say(format_args!("  {share:.0} % of what {left} is structure, over {over}"))?;
    }
    for table in &outcome.tables {
        say(format_args!("  in the robot that was written, {table}"))?;
    }
    let retuned = || {
        outcome
            .retuned
            .iter()
            .flat_map(|(joint, own)| own.iter().map(move |(key, value)| (joint, key, value)))
    };
    if retuned().count() <= RETUNED {
        for (joint, key, value) in retuned() {
            say(format_args!("  re-tuned: {key} of {joint} = {value}"))?;
        }
    }
    say(format_args!(
        "position error, rms, rad (m):  nominal {}  re-tuned {}  final {}  on held-out logs ({})",
        figure(outcome.nominal.heldout.overall()),
        figure(outcome.refit.heldout.overall()),
        figure(outcome.last.heldout.overall()),
        outcome.heldout,
    ))?;
    let floor = outcome.noise_floor.value.unwrap_or(0.0);
    match outcome
        .gap_closed
        .filter(|_| outcome.verdict != Verdict::NoMissingEffect)
    {
        Some(closed) => say(format_args!(
            "noise floor {}; {:.0} % of the gap to it closed",
            figure(floor),
            100.0 * closed
        ))?,
        None => say(format_args!("noise floor {}", figure(floor)))?,
    }
    let (fitted, heldout) = (outcome.last.fit.overall(), outcome.last.heldout.overall());
    if heldout > FAR_OFF * fitted.max(floor) {
        say(format_args!(
            "the held-out logs are {:.0} times as far off as those that were fitted: they ask what those do not show",
            heldout / fitted.max(floor)
        ))?;
    }
    say(out.join("report.html").display())
}
