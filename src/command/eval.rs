//! `omniwalk eval`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_env::Batch;
use omniwalk_env::robot::Robot;
use omniwalk_env::task::shared::spec;
use omniwalk_ppo::Agent;
use serde_json::json;

use super::load;
use crate::eval::rollout::Recorder;
use crate::eval::suite::{Suite, Watch, play};
use crate::eval::table;
use crate::log::LogError;
use crate::run::{RunFolder, write_atomic};
use crate::settings::Settings;
use crate::train::checkpoint;

/// Plays a policy's mode at fixed commands and measures how it walks.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// What is played: `forward`, the commands of the run's `[eval]` section.
    #[arg(long, value_parser = ["forward"], default_value = "forward")]
    suite: String,
    /// Physics engine; policies are judged in rapier.
    #[arg(long, value_parser = ["rapier", "lanes"], default_value = "rapier")]
    engine: String,
    /// Robot folder or URDF [default: the run's].
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Episodes for each command [default: the run's].
    #[arg(long, value_name = "N")]
    episodes: Option<usize>,
    /// Length of an episode [default: the run's].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Seed of the episodes.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    seed: u64,
    /// Without noise, latency and randomisation.
    #[arg(long)]
    nominal: bool,
    /// Changes a single value of the run's configuration.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Also writes the results to FILE.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A policy with what it was trained as.
struct Loaded {
    settings: Settings,
    robot: Arc<Robot>,
    agent: Agent,
    steps: u64,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with the run or the arguments.
pub fn run(args: &Args) -> miette::Result<()> {
    let mut loaded = Loaded::open(args)?;
    let eval = &loaded.settings.eval;
    let suite = Suite {
        commands: eval.commands.clone(),
        episodes: eval.episodes,
        seconds: eval.seconds,
        seed: args.seed,
        nominal: args.nominal,
    };
    let mut rollouts = Rollouts::new(args.run.join("rollouts"), &suite);
    let agent = &mut loaded.agent;
    let policy = |observations: &[f32], actions: &mut [f32]| agent.mode(observations, actions);
    let rows = play(
        loaded.robot.clone(),
        &loaded.settings.env(),
        &suite,
        policy,
        &mut rollouts,
    )?;
    let files = rollouts.finish()?;
    let conditions = if args.nominal { "nominal" } else { "randomised" };
    println!(
        "{} after {} steps, {} conditions, {} episodes of {} s a command, {}",
        args.run.display(),
        loaded.steps,
        conditions,
        suite.episodes,
        suite.seconds,
        args.engine
    );
    print!("{}", table::to_text(&rows));
    files.iter().for_each(|file| println!("rollout: {}", file.display()));
    let result = json!({
        "policy": args.run.display().to_string(),
        "steps": loaded.steps,
        "engine": args.engine,
        "robot": loaded.robot.name,
        "seed": args.seed,
        "conditions": conditions,
        "seconds": suite.seconds,
        "forward": { "rows": table::to_json(&rows) },
    });
    let text = serde_json::to_string_pretty(&result).into_diagnostic()? + "\n";
    write(&args.run.join("eval.json"), &text)?;
    if let Some(file) = &args.json {
        write(file, &text)?;
    }
    Ok(())
}

impl Loaded {
    fn open(args: &Args) -> miette::Result<Self> {
        let run = RunFolder::open(&args.run)?;
        let mut changes = args.set.clone();
        changes.push(format!("engine.kind={}", args.engine));
        changes.extend(args.episodes.map(|n| format!("eval.episodes={n}")));
        changes.extend(args.seconds.map(|s| format!("eval.seconds={s:?}")));
        let (settings, _) = load::settings(Some(&args.run.join("config.toml")), &changes)?;
        within_bounds(&settings)?;
        let robot = load::robot(args.robot.as_deref().unwrap_or(&args.run.join("robot")))?;
        let latest = run
            .checkpoints()
            .latest()?
            .ok_or_else(|| miette!("{} holds no checkpoint yet", args.run.display()))?;
        latest.skipped.iter().for_each(|error| eprintln!("warning: {error}"));
        let layout = spec(&robot, &settings.env());
        let agent = checkpoint::agent(
            &latest.checkpoint,
            &settings,
            layout.observation_len(),
            layout.action_len(),
        )
        .wrap_err_with(|| format!("{} does not fit robot and configuration", latest.path.display()))?;
        Ok(Self {
            settings,
            robot,
            agent,
            steps: latest.checkpoint.step,
        })
    }
}

/// The controller keeps what is asked of it within the bounds it was trained for, so that other commands would not
/// be played as they are written.
fn within_bounds(settings: &Settings) -> miette::Result<()> {
    let (lower, upper) = (settings.command.lower, settings.command.upper);
    let inside = |command: &[f64; 3]| (0..3).all(|k| (lower[k]..=upper[k]).contains(&command[k]));
    match settings.eval.commands.iter().find(|command| !inside(command)) {
        None => Ok(()),
        Some(command) => Err(miette!(
            help = "for example --set 'eval.commands=[[0.0, 0.0, 0.0]]'",
            "`eval.commands` must be within the bounds the policy was trained for, {lower:?} to {upper:?}, \
             and {command:?} is not"
        )),
    }
}

/// The first episode of each command as a log.
struct Rollouts {
    folder: PathBuf,
    suite: Suite,
    recorders: Vec<Recorder>,
}

impl Rollouts {
    fn new(folder: PathBuf, suite: &Suite) -> Self {
        Self {
            folder,
            suite: suite.clone(),
            recorders: Vec::new(),
        }
    }

    fn finish(self) -> Result<Vec<PathBuf>, LogError> {
        self.recorders.into_iter().map(Recorder::finish).collect()
    }
}

impl Watch for Rollouts {
    /// Only now is anything written: robot, configuration and engine fit together.
    fn start(&mut self, batch: &Batch) -> miette::Result<()> {
        std::fs::create_dir_all(&self.folder)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot create {}", self.folder.display()))?;
        let shared = batch.shared();
        for (i, [x, y, turn]) in self.suite.commands.iter().enumerate() {
            let path = self.folder.join(format!("eval_{x:.2}_{y:.2}_{turn:.2}.mcap"));
            let environment = i * self.suite.episodes;
            let mut recorder = Recorder::create(&path, environment, &shared.robot, shared.config.control_dt())?;
            recorder.state(batch)?;
            self.recorders.push(recorder);
        }
        Ok(())
    }

    fn step(&mut self, batch: &Batch, observations: &[f32], actions: &[f32]) -> miette::Result<()> {
        self.recorders
            .iter_mut()
            .try_for_each(|recorder| Ok(recorder.step(batch, observations, actions)?))
    }
}

fn write(path: &Path, text: &str) -> miette::Result<()> {
    write_atomic(path, text.as_bytes())
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}
