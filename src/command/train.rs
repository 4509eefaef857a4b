//! `omniwalk train`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, WrapErr, miette};

use super::load;
use crate::run::RunFolder;
use crate::run::checkpoints::Checkpoints;
use crate::run::events::EventWriter;
use crate::run::metrics::MetricsWriter;
use crate::settings::Settings;
use crate::train::checkpoint;
use crate::train::metrics::{self, Figure};
use crate::train::progress::{Display, LogFormat};
use crate::train::trainer::Trainer;

/// Trains a policy; writes a run folder.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Configuration laid over the defaults (TOML); without one: NimbRo-OP2X, omnidirectional.
    config: Option<PathBuf>,
    /// Run folder to write [default: runs/NAME-SEED, NAME being the configuration's].
    #[arg(long, value_name = "DIR")]
    run: Option<PathBuf>,
    /// Go on with the run in the folder, to the same bits as if it had not been stopped.
    #[arg(long, conflicts_with_all = ["config", "set", "seed", "engine"])]
    resume: bool,
    /// Seed of everything random.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Threads; the result does not depend on their number [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Physics engine.
    #[arg(long, value_parser = ["rapier", "lanes"])]
    engine: Option<String>,
    /// Total number of control steps; training ends with the first update that reaches it.
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Changes a single value, for example --set reward.velocity_kernel=9.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print nothing but errors and the end.
    #[arg(long)]
    quiet: bool,
    /// How progress is printed.
    #[arg(long, value_enum, default_value = "text")]
    log_format: LogFormat,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with configuration, robot or run folder; nothing is then written.
pub fn run(args: &Args) -> miette::Result<()> {
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .build_global()
            .into_diagnostic()?;
    }
    let stop = interrupt()?;
    let mut session = if args.resume {
        Session::resume(args)?
    } else {
        Session::start(args)?
    };
    session.train(args, &stop)
}

/// A run on disk and in memory.
struct Session {
    folder: PathBuf,
    settings: Settings,
    trainer: Trainer,
    checkpoints: Checkpoints,
    metrics: MetricsWriter,
    events: EventWriter,
    // Holds the folder's lock.
    _run: RunFolder,
}

impl Session {
    fn start(args: &Args) -> miette::Result<Self> {
        let mut changes = args.set.clone();
        changes.extend(args.seed.map(|seed| format!("train.seed={seed}")));
        changes.extend(args.engine.as_ref().map(|engine| format!("engine.kind={engine}")));
        changes.extend(args.steps.map(|steps| format!("train.steps={steps}")));
        let (settings, text) = load::settings(args.config.as_deref(), &changes)?;
        let robot = load::robot(&settings.robot.path)?;
        if !args.quiet {
            robot.notes.iter().for_each(|note| eprintln!("note: {note}"));
        }
        let trainer = Trainer::new(&settings, robot)?;
        let folder = args
            .run
            .clone()
            .unwrap_or_else(|| default_folder(args.config.as_deref(), settings.train.seed));
        let run = RunFolder::create(&folder, &text)?;
        load::copy_robot(&settings.robot.path, &folder.join("robot"))?;
        Ok(Self {
            checkpoints: run.checkpoints(),
            metrics: MetricsWriter::create(&folder.join("metrics.csv"), &metrics::NAMES)?,
            events: EventWriter::create(&folder, None).into_diagnostic()?,
            settings,
            trainer,
            folder,
            _run: run,
        })
    }

    fn resume(args: &Args) -> miette::Result<Self> {
        let folder = args.run.clone().ok_or_else(|| {
            miette!(
                help = "for example: omniwalk train --resume --run runs/default-1",
                "--resume needs --run DIR"
            )
        })?;
        let run = RunFolder::resume(&folder)?;
        let changes: Vec<String> = args.steps.iter().map(|steps| format!("train.steps={steps}")).collect();
        let (settings, _) = load::settings(Some(&folder.join("config.toml")), &changes)?;
        let robot = load::robot(&folder.join("robot"))?;
        let latest = run.checkpoints().latest()?.ok_or_else(|| {
            miette!(
                help = "start it again in another folder",
                "{} holds no checkpoint yet",
                folder.display()
            )
        })?;
        latest.skipped.iter().for_each(|error| eprintln!("warning: {error}"));
        let trainer = checkpoint::restore(&latest.checkpoint, &settings, robot)
            .wrap_err_with(|| format!("cannot go on from {}", latest.path.display()))?;
        let step = trainer.progress().steps;
        Ok(Self {
            checkpoints: run.checkpoints(),
            metrics: MetricsWriter::resume(&folder.join("metrics.csv"), &metrics::NAMES, step)?,
            events: EventWriter::create(&folder, Some(step)).into_diagnostic()?,
            settings,
            trainer,
            folder,
            _run: run,
        })
    }

    fn train(&mut self, args: &Args, stop: &AtomicBool) -> miette::Result<()> {
        let total = self.settings.train.steps;
        let mut display = Display::new(total, args.log_format, args.quiet);
        let started = Instant::now();
        let first_step = self.trainer.progress().steps;
        let pause = Duration::from_secs_f64(60.0 * self.settings.train.checkpoint_minutes);
        let mut written = Instant::now();
        while self.trainer.progress().steps < total && !stop.load(Ordering::Relaxed) {
            let report = self.trainer.update();
            let figures = metrics::figures(&self.trainer, &report);
            self.write(&figures)?;
            display.update(self.trainer.progress().steps, &figures, &started, first_step);
            if written.elapsed() >= pause {
                self.save()?;
                written = Instant::now();
            }
        }
        display.finish();
        let path = self.save()?;
        self.conclude(&path);
        Ok(())
    }

    fn write(&mut self, figures: &[Figure]) -> miette::Result<()> {
        let step = self.trainer.progress().steps;
        let values: Vec<f64> = figures.iter().map(|(_, value)| *value).collect();
        self.metrics.append(step, &values)?;
        let scalars = figures.iter().copied().filter(|(_, value)| value.is_finite());
        self.events
            .scalars(step, scalars)
            .into_diagnostic()
            .wrap_err("cannot write TensorBoard events")
    }

    fn save(&mut self) -> miette::Result<PathBuf> {
        let checkpoint = checkpoint::save(&self.trainer)?;
        Ok(self
            .checkpoints
            .save(&checkpoint, self.settings.train.keep_checkpoints)?)
    }

    fn conclude(&self, path: &Path) {
        let progress = self.trainer.progress();
        let folder = self.folder.display();
        println!(
            "{} of {} steps in {:.1} minutes; checkpoint {}",
            progress.steps,
            self.settings.train.steps,
            progress.seconds / 60.0,
            path.display()
        );
        if progress.steps < self.settings.train.steps {
            println!("go on:  omniwalk train --resume --run {folder}");
        }
        println!("judge:  omniwalk eval {folder}");
    }
}

fn default_folder(config: Option<&Path>, seed: u64) -> PathBuf {
    let name = config
        .and_then(Path::file_stem)
        .map_or_else(|| "default".into(), |stem| stem.to_string_lossy());
    Path::new("runs").join(format!("{name}-{seed}"))
}

/// A flag that Ctrl-C sets: the running update is finished and a checkpoint written. A second one ends the process.
fn interrupt() -> miette::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        eprintln!("finishing this update and writing a checkpoint; Ctrl-C again ends at once");
    })
    .into_diagnostic()?;
    Ok(stop)
}
