//! `omniwalk crosscheck`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::available_parallelism;

use clap::Parser as _;
use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_env::config::GroundKind;
use omniwalk_env::engine::Configured;
use omniwalk_env::robot::Robot;
use serde_json::{Map, Value, json};

use super::load;
use crate::complaint;
use crate::crosscheck::check::{self, Check};
use crate::crosscheck::closed_loop::{self, PARTS, Part};
use crate::crosscheck::engine::Workshop;
use crate::crosscheck::python::Python;
use crate::crosscheck::subject::Subject;
use crate::crosscheck::{dynamics, motions, network, observation, page};
use crate::eval::suites::{Plan, Suite};
use crate::files::can_write;
use crate::run::{create_folder, write_atomic};
use crate::terminal::{say, tell};

/// Holds a policy and the engines against MuJoCo.
///
/// Three gates: `network`, a second reading of the policy file in double precision against the controller; `physics`, the
/// equation of motion, motions and the observation against MuJoCo's; `closed_loop`, the policy walks in MuJoCo as in the
/// engine. Writes crosscheck.json and crosscheck.html into the run folder; of a policy file NAME.omni into the folder
/// NAME.crosscheck. The exit code is 1 if a gate fails.
///
/// Needs Python 3.11 or newer. MuJoCo goes into an environment that this command makes for itself, in the user's cache or at
/// --venv; it touches no other.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run folder or policy file.
    run: PathBuf,
    /// The gates, separated by commas [default: all].
    #[arg(long, value_delimiter = ',', value_parser = GATES)]
    gate: Vec<String>,
    /// The project's engines that the policy walks in beside MuJoCo, separated by commas.
    #[arg(long, value_delimiter = ',', value_parser = ["rapier", "lanes"], default_value = "rapier,lanes")]
    engine: Vec<String>,
    /// What is walked, separated by commas [default: all that the policy was trained for].
    ///
    /// commands: the commands of the run's `[eval]` section; falls, tracking and push: as in `omniwalk eval`.
    #[arg(long, value_delimiter = ',', value_parser = ["commands", "falls", "tracking", "push"])]
    suite: Vec<String>,
    /// Sequences for each command.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=1000))]
    episodes: u16,
    /// Length of a sequence, s [default: the suite's own].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Seed of what the third gate draws; the states of the others are always the same.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    seed: u64,
    /// Of a run: this checkpoint instead of the newest.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Robot folder or URDF [default: the run's; for a policy file that of the defaults].
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Changes a single value of the run's configuration.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder of the Python environment that is made and used [default: in the user's cache].
    #[arg(long, value_name = "DIR", conflicts_with = "python")]
    venv: Option<PathBuf>,
    /// Python interpreter with MuJoCo and NumPy, used as it is.
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
    /// Folder for crosscheck.json and crosscheck.html.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Also writes the results to FILE.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

const GATES: [&str; 3] = ["network", "physics", "closed_loop"];

/// Runs the command with `arguments`, as another program's own command; its exit code: 0, 1 if a gate fails, 2 for what is
/// wrong, which it has said.
pub fn main(arguments: &[String]) -> u8 {
    #[derive(clap::Parser)]
    #[command(name = "crosscheck", max_term_width = 120)]
    struct CommandLine {
        #[command(flatten)]
        args: Args,
    }
    let name = std::iter::once("crosscheck".to_owned());
    let parsed = match CommandLine::try_parse_from(name.chain(arguments.iter().cloned())) {
        Ok(parsed) => parsed,
        Err(error) => {
            // Whoever closed the pipe does not want to hear of it.
            let _ = error.print();
            return error.exit_code() as u8;
        }
    };
    match run(&parsed.args) {
        Ok(passed) => u8::from(!passed),
        Err(report) => {
            tell(format_args!("{}", complaint::text(&report)));
            2
        }
    }
}

/// Runs the command; whether every gate passes.
///
/// # Errors
/// Whatever is wrong with the policy or the arguments, or missing of Python and MuJoCo.
pub fn run(args: &Args) -> miette::Result<bool> {
    if args.checkpoint.is_some() && args.run.is_file() {
        return Err(miette!(
            "--checkpoint is for run folders, and {} is a policy file",
            args.run.display()
        ));
    }
    if args
        .seconds
        .is_some_and(|seconds| !(seconds > 0.0 && seconds <= 86400.0))
    {
        return Err(miette!("--seconds takes a time above 0 and up to 86400 s"));
    }
    let subject = Subject::open(&args.run, args.checkpoint.as_deref(), args.robot.as_deref(), &args.set)?;
    load::warn_of_long_steps(&subject.robot, &subject.settings.env);
    let parts = parts(args, &subject)?;
    if subject.settings.env.ground.kind != GroundKind::Plane {
        return Err(miette!(
            help = "--set ground.kind=plane",
            "the cross-check walks on a level plane, which is the ground that MuJoCo's model has"
        ));
    }
    let outputs: Vec<&Path> = args.json.iter().map(PathBuf::as_path).collect();
    let inputs = [&args.run].into_iter().chain(&args.robot);
    outputs.iter().try_for_each(|file| can_write(file))?;
    load::writable(&outputs, &inputs.map(PathBuf::as_path).collect::<Vec<_>>())?;
    let python = Python::open(args.python.as_deref(), args.venv.as_deref())?;
    let out = out_folder(args)?;
    let mut result = json!({
        "policy": args.run.display().to_string(),
        "steps": subject.policy.identity().steps,
        "robot": subject.robot.name,
        "robot_path": subject.robot_path.display().to_string(),
        "set": args.set,
        "engine": args.engine.join(", "),
        "seed": args.seed,
        "physics_hz": subject.settings.env.engine.physics_hz,
        "mujoco": python.mujoco,
        "version": env!("CARGO_PKG_VERSION"),
    });
    let processes = available_parallelism().map_or(1, usize::from);
    let workshop = Workshop::new(python, subject.robot.clone(), &subject.robot_path, processes);
    let mut gates = Map::new();
    let asked = |gate: &str| args.gate.is_empty() || args.gate.iter().any(|name| name == gate);
    if asked("network") {
        let checks = network::checks(&subject, &workshop)?;
        show(check::text("network", &checks));
        gates.insert("network".into(), network_gate(&checks));
    }
    if asked("physics") {
        let robot = Arc::new(subject.robot.rigid());
        let mut checks = dynamics::checks(&robot, &workshop)?;
        checks.extend(motions::checks(&robot, &workshop)?);
        checks.extend(observation::checks(
            &subject,
            &robot,
            &subject.conditions(&args.set)?,
            &workshop,
        )?);
        show(check::text("physics and observation", &checks));
        let mut gate = check::gate(&checks);
        gate["left_out"] = json!(effects_of_actuators(&subject.robot));
        gates.insert("physics".into(), gate);
    }
    if asked("closed_loop") {
        closed_loop(args, &subject, &workshop, &parts, &mut gates)?;
    }
    let passed = gates.values().all(|gate| gate["pass"] == true);
    result["pass"] = json!(passed);
    result["gates"] = Value::Object(gates);
    save(args, &out, &result)?;
    let gates: Vec<&str> = GATES.into_iter().filter(|gate| asked(gate)).collect();
    let verdict = if passed { "PASS" } else { "FAIL" };
    say(format_args!("{verdict}: {}", gates.join(", ")))?;
    Ok(passed)
}

fn network_gate(checks: &[Check]) -> Value {
    let mut gate = check::gate(checks);
    gate["max_abs_error"] = json!(checks.iter().map(|check| check.found).fold(0.0, network::largest));
    gate
}

/// What is walked.
fn parts(args: &Args, subject: &Subject) -> miette::Result<Vec<Part>> {
    let asked = |part: &Part| args.suite.is_empty() || args.suite.iter().any(|name| name == part.name());
    let (known, unknown): (Vec<Part>, Vec<Part>) = PARTS
        .into_iter()
        .filter(asked)
        .partition(|part| subject.knows(part.commands(subject)));
    let refused = unknown.first().filter(|_| !args.suite.is_empty() || known.is_empty());
    if refused.is_none() && !unknown.is_empty() {
        let names: Vec<&str> = unknown.iter().map(|part| part.name()).collect();
        tell(format_args!(
            "left out, as the policy was not trained for what they ask for: {}",
            names.join(", ")
        ));
    }
    if !known.is_empty() && known.iter().all(|part| *part == Part::Suite(Suite::Push)) {
        return Err(miette!(
            help = "--suite commands,push",
            "pushes alone say nothing of survival and velocities, by which the gate passes or fails"
        ));
    }
    refused.map_or(Ok(known), |part| {
        Err(miette!(
            help = "leave that suite out; for other commands: --suite commands --set 'eval.commands=[[0.0, 0.0, 0.0]]'",
            "what `{}` asks for must be within the bounds the policy was trained for, {:?} to {:?}",
            part.name(),
            subject.range[0],
            subject.range[1]
        ))
    })
}

/// Plays the third gate in MuJoCo and in every engine: `closed_loop` of the first, `closed_loop_NAME` of another.
fn closed_loop(
    args: &Args,
    subject: &Subject,
    workshop: &Workshop,
    parts: &[Part],
    gates: &mut Map<String, Value>,
) -> miette::Result<()> {
    let plan = Plan {
        episodes: args.episodes.into(),
        seconds: args.seconds,
    };
    let conditions = |engine: &str| {
        let mut changes = args.set.clone();
        changes.push(format!("engine.kind={engine}"));
        subject.conditions(&changes)
    };
    let mut mujoco = None;
    for engine in &args.engine {
        let mut conditions = conditions(engine)?;
        let ours = closed_loop::play(subject, &conditions, &Configured, parts, &plan, args.seed)?;
        closed_loop::measured(&ours)?;
        let theirs = match mujoco.take() {
            Some(theirs) => theirs,
            None => {
                conditions.task.end_on_overlap = false;
                closed_loop::play(subject, &conditions, workshop, parts, &plan, args.seed)?
            }
        };
        workshop.check()?;
        let mut verdict = closed_loop::verdict(engine, ours, theirs.clone());
        mujoco = Some(theirs);
        verdict["episodes"] = json!(args.episodes);
        verdict["seconds"] = json!(args.seconds);
        show(closed_loop::text(&verdict));
        let name = if gates.contains_key("closed_loop") {
            format!("closed_loop_{engine}")
        } else {
            "closed_loop".into()
        };
        gates.insert(name, verdict);
    }
    Ok(())
}

/// What gate 2 leaves out, by name: actuators and encoders are the same code in every engine, MuJoCo's worlds included.
fn effects_of_actuators(robot: &Robot) -> Vec<String> {
    let effects = robot.effects.iter().filter(|effect| effect.kind.runs());
    effects
        .map(|effect| format!("{} ({})", effect.kind.id(), robot.dof(effect.target).name))
        .collect()
}

/// Shows figures; a reader that has gone does not cost what took an hour.
fn show(text: String) {
    let _ = say(text);
}

/// Where the results go, before anything is measured.
fn out_folder(args: &Args) -> miette::Result<PathBuf> {
    let folder = match &args.out {
        Some(folder) => folder.clone(),
        None if args.run.is_file() => args.run.with_extension("crosscheck"),
        None => args.run.clone(),
    };
    create_folder(&folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    can_write(&folder.join("crosscheck.json"))?;
    Ok(folder)
}

fn save(args: &Args, folder: &Path, result: &Value) -> miette::Result<()> {
    let text = serde_json::to_string_pretty(result).into_diagnostic()? + "\n";
    write(&folder.join("crosscheck.json"), text.as_bytes())?;
    let page = folder.join("crosscheck.html");
    write(&page, page::page(result).as_bytes())?;
    args.json.as_ref().map_or(Ok(()), |file| write(file, text.as_bytes()))?;
    show(format!("page: {}", page.display()));
    Ok(())
}

fn write(path: &Path, bytes: &[u8]) -> miette::Result<()> {
    write_atomic(path, bytes)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}
