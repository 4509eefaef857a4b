//! `omniwalk rehearse`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

use miette::{IntoDiagnostic, WrapErr, miette};

use super::load;
use crate::deployed::Deployed;
use crate::files::can_write;
use crate::rehearse::brain;
use crate::rehearse::robot::Simulated;
use crate::run::write_atomic;
use crate::terminal::say;

/// Runs a policy's controller in a process of its own against the simulated robot, in real time.
///
/// Readings take as long as in the training of the policy, each its own time; the log is the one a robot would write.
/// Reports deadline misses, latencies and the walk. Stop or kill either process to see what happens.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Policy file.
    policy: PathBuf,
    /// Robot folder or URDF [default: that of the defaults].
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Physics engine.
    #[arg(long, value_parser = ["rapier", "lanes"], default_value = "rapier")]
    engine: String,
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
    /// Is the controller's process, with the sockets in this folder.
    #[arg(long, value_name = "DIR", hide = true)]
    controller: Option<PathBuf>,
}

/// Most controllers that are started in place of one that died.
const MOST_RESTARTS: u32 = 20;

/// Runs the command.
///
/// # Errors
/// When policy and robot do not fit, files cannot be written, or the controller dies again and again.
pub fn run(args: &Args) -> miette::Result<()> {
    if let Some(folder) = &args.controller {
        return brain::run(&load::policy(&args.policy)?, folder);
    }
    let mut changes = args.set.clone();
    changes.push(format!("engine.kind={}", args.engine));
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
    args.json.iter().chain([&log]).try_for_each(|file| can_write(file))?;
    let folder = Folder::create()?;
    let robot = Simulated::new(&deployed, desired, args.seed, &folder.0, &log)?;
    let mut controller = Process::start(&args.policy, &folder.0)?;
    say(format_args!(
        "{} at {desired:?} for {} s",
        args.policy.display(),
        args.seconds
    ))?;
    let mut report = robot.run(f64::from(args.seconds), || controller.tend())?;
    drop(controller);
    say(format_args!("{}log: {}", report.text(), log.display()))?;
    let text = serde_json::to_string_pretty(&report.json()).into_diagnostic()? + "\n";
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

/// The folder of the sockets, which goes when it is dropped.
struct Folder(PathBuf);

impl Folder {
    fn create() -> miette::Result<Self> {
        let path = std::env::temp_dir().join(format!("omniwalk-rehearsal-{}", std::process::id()));
        fs::create_dir(&path)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot create {}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that stays is a nuisance, not a fault.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The controller's process.
struct Process {
    child: Child,
    policy: PathBuf,
    folder: PathBuf,
    restarts: u32,
}

impl Process {
    fn start(policy: &Path, folder: &Path) -> miette::Result<Self> {
        Ok(Self {
            child: spawn(policy, folder)?,
            policy: policy.to_owned(),
            folder: folder.to_owned(),
            restarts: 0,
        })
    }

    /// Starts another if it has died; returns how often that was.
    fn tend(&mut self) -> miette::Result<u32> {
        if let Some(status) = self.child.try_wait().into_diagnostic()? {
            if self.restarts == MOST_RESTARTS {
                return Err(miette!(
                    "the controller has died {} times, last with {status}",
                    MOST_RESTARTS + 1
                ));
            }
            self.restarts += 1;
            self.child = spawn(&self.policy, &self.folder)?;
        }
        Ok(self.restarts)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have died by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn spawn(policy: &Path, folder: &Path) -> miette::Result<Child> {
    let program = std::env::current_exe().into_diagnostic()?;
    let child = Command::new(program)
        .arg("rehearse")
        .arg(policy)
        .arg("--controller")
        .arg(folder)
        .spawn()
        .into_diagnostic()
        .wrap_err("cannot start the controller")?;
    say(format_args!("controller: process {}", child.id()))?;
    Ok(child)
}
