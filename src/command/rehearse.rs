//! `omniwalk rehearse`.

use std::io::stdin;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, WrapErr, miette};

use super::load;
use crate::deployed::Deployed;
use crate::files::can_write;
use crate::rehearse::robot::Simulated;
use crate::rehearse::{Line, brain};
use crate::run::write_atomic;
use crate::terminal::{interrupt, say};

/// Runs a policy's controller in a process of its own against the simulated robot, in real time.
///
/// Readings are as old when the policy acts on them as in an episode of its training; the log is the one a robot would write.
/// Reports deadline misses, latencies and the walk. Ctrl-C ends it early with the report. Stop or kill either
/// process to see what happens: a controller that died is started again after a second, a robot that died leaves its log for
/// `mcap recover`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Policy file.
    policy: PathBuf,
    /// Robot folder or URDF [default: that of the defaults].
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Physics engine [default: rapier].
    #[arg(long, value_parser = ["rapier", "lanes"])]
    engine: Option<String>,
    /// Length, s.
    #[arg(long, value_name = "S", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=3600))]
    seconds: u32,
    /// Desired velocity in m/s, m/s, rad/s [default: forward at half the fastest that was trained, or the slowest].
    #[arg(long, value_name = "X,Y,TURN", value_delimiter = ',', allow_hyphen_values = true)]
    command: Option<Vec<f32>>,
    /// Seed of friction, masses, noise and latencies.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    seed: u64,
    /// Changes a single value of the configuration.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// The log to write [default: NAME.rehearsal.mcap beside NAME.omni].
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Also writes the result to FILE.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Is the controller's process, with the line to the robot as its standard input.
    #[arg(long, hide = true)]
    controller: bool,
}

/// Most controllers that are started in place of one that died.
const MOST_RESTARTS: u32 = 20;

/// How long a controller that died stays away, as one that is started by a supervisor.
const AWAY: Duration = Duration::from_secs(1);

/// Runs the command.
///
/// # Errors
/// When policy and robot do not fit, files cannot be written, or the controller dies again and again.
pub fn run(args: &Args) -> miette::Result<()> {
    if args.controller {
        let line = stdin().as_fd().try_clone_to_owned().and_then(Line::new);
        let line = line
            .into_diagnostic()
            .wrap_err("standard input is no line to a robot")?;
        return brain::run(&load::policy(&args.policy)?, line);
    }
    let changes = load::played(args.engine.as_deref(), &args.set);
    let deployed = Deployed::open(&args.policy, args.robot.as_deref(), &changes)?;
    let desired = match args.command.as_deref() {
        Some(&[x, y, turn]) if [x, y, turn].iter().all(|v| v.is_finite()) => [x, y, turn],
        Some(_) => return Err(miette!("--command takes three finite numbers, such as 0.3,0,0")),
        None => {
            let trained = &deployed.policy.identity().curriculum;
            let wish = [0.5 * trained.upper[0], 0.0, 0.0];
            [0, 1, 2].map(|k| wish[k].clamp(trained.lower[k], trained.upper[k]))
        }
    };
    within_bounds(&deployed, desired)?;
    let log = args
        .log
        .clone()
        .unwrap_or_else(|| args.policy.with_extension("rehearsal.mcap"));
    let outputs: Vec<&Path> = args.json.iter().chain([&log]).map(PathBuf::as_path).collect();
    outputs.iter().try_for_each(|file| can_write(file))?;
    load::writable(&outputs, &[&args.policy])?;
    let (mut controller, line) = Process::start(&args.policy)?;
    let robot = Simulated::new(&deployed, desired, args.seed, line, &log)?;
    say(format_args!(
        "{} at {desired:?} for {} s",
        args.policy.display(),
        args.seconds
    ))?;
    let stop = interrupt().into_diagnostic()?;
    let mut report = robot.run(f64::from(args.seconds), &stop, || controller.tend())?;
    drop(controller);
    say(format_args!("{}log: {}", report.text(), log.display()))?;
    let mut result = report.json();
    result["engine"] = deployed.settings.env.engine.kind.name().into();
    let text = serde_json::to_string_pretty(&result).into_diagnostic()? + "\n";
    args.json.as_ref().map_or(Ok(()), |file| {
        write_atomic(file, text.as_bytes())
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write {}", file.display()))
    })
}

/// The controller keeps what is asked of it within the bounds it was trained for: another velocity would not be what is
/// rehearsed.
fn within_bounds(deployed: &Deployed, desired: [f32; 3]) -> miette::Result<()> {
    let trained = &deployed.policy.identity().curriculum;
    if (0..3).all(|k| (trained.lower[k]..=trained.upper[k]).contains(&desired[k])) {
        return Ok(());
    }
    Err(miette!(
        help = "for example --command 0,0,0",
        "--command must be within the bounds the policy was trained for, {:?} to {:?}, and {desired:?} is not",
        trained.lower,
        trained.upper
    ))
}

/// The controller's process.
struct Process {
    child: Child,
    policy: PathBuf,
    restarts: u32,
    /// When it was found dead.
    died: Option<Instant>,
}

impl Process {
    fn start(policy: &Path) -> miette::Result<(Self, Line)> {
        let (child, line) = spawn(policy)?;
        let process = Self {
            child,
            policy: policy.to_owned(),
            restarts: 0,
            died: None,
        };
        Ok((process, line))
    }

    /// Starts another a while after it has died; returns the line to it.
    fn tend(&mut self) -> miette::Result<Option<Line>> {
        let Some(status) = self.child.try_wait().into_diagnostic()? else {
            return Ok(None);
        };
        if self.restarts == MOST_RESTARTS {
            return Err(miette!(
                "the controller has died {} times, last with {status}",
                MOST_RESTARTS + 1
            ));
        }
        if self.died.get_or_insert_with(Instant::now).elapsed() < AWAY {
            return Ok(None);
        }
        self.died = None;
        self.restarts += 1;
        let (child, line) = spawn(&self.policy)?;
        self.child = child;
        Ok(Some(line))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have died by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn spawn(policy: &Path) -> miette::Result<(Child, Line)> {
    let program = std::env::current_exe().into_diagnostic()?;
    let (line, other) = Line::pair()
        .into_diagnostic()
        .wrap_err("cannot make a line to the controller")?;
    let child = Command::new(program)
        .arg("rehearse")
        .arg(policy)
        .arg("--controller")
        .stdin(other)
        .spawn()
        .into_diagnostic()
        .wrap_err("cannot start the controller")?;
    say(format_args!("controller: process {}", child.id()))?;
    Ok((child, line))
}
