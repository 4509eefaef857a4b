//! `omniwalk train`.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_env::robot::Robot;

use super::load;
use crate::run::RunFolder;
use crate::run::checkpoints::Checkpoints;
use crate::run::events::EventWriter;
use crate::run::metrics::MetricsWriter;
use crate::run::sessions::{self, Origin, Session as Record, Sessions};
use crate::run::transfer::COLUMNS;
use crate::settings::Settings;
use crate::terminal::{interrupt, say, tell};
use crate::train::checkpoint;
use crate::train::conclusion::{self, Conclusion};
use crate::train::health;
use crate::train::metrics::{self, Figure};
use crate::train::progress::{Illness, LogFormat, Reporter};
use crate::train::shape::{self, Shape};
use crate::train::trainer::Trainer;
use crate::train::transfer::{Background, Measured, Plan};

/// Trains a policy; writes a run folder.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Configuration laid over the defaults (TOML); without one: NimbRo-OP2X, omnidirectional.
    config: Option<PathBuf>,
    /// Run folder to write [default: runs/NAME-SEED, NAME being the configuration's].
    #[arg(long, value_name = "DIR")]
    run: Option<PathBuf>,
    /// Go on with the run in the folder, to the same bits as if it had not been stopped.
    /// A finished run is extended by a larger `--steps`; settings that shape the learning must be what they were.
    #[arg(long, conflicts_with_all = ["config", "set", "seed", "engine", "from"])]
    resume: bool,
    /// Start from the networks and the normaliser of the newest checkpoint of another run, to fine-tune it.
    ///
    /// Robot, reward, commands, engine, curriculum and learning rate are those of CONFIG, and the curriculum starts at
    /// its beginning; optimiser, counters and environments start anew. Observation, action, policy joints and size
    /// of the networks must be the same. The other run is only read.
    #[arg(long, value_name = "RUN")]
    from: Option<PathBuf>,
    /// Seed of everything random.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Threads; the result does not depend on their number [default: all cores].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(super::THREADS))]
    threads: Option<u16>,
    /// Physics engine.
    #[arg(long, value_parser = ["rapier", "lanes"])]
    engine: Option<String>,
    /// Total number of control steps; training ends with the first update that reaches it.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = super::steps)]
    steps: Option<u64>,
    /// Changes a single value, for example --set reward.velocity_kernel=9.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Let checkpoints walk in MuJoCo while training goes on, one each N control steps, in the background.
    ///
    /// A process of the lowest priority plays the commands of the `[eval]` section (see `omniwalk crosscheck`); how the
    /// checkpoints transfer goes to crosscheck.csv and TensorBoard, and the best of them is kept for `export --best-transfer`.
    /// Where one takes longer than N steps, the next waits for it.
    #[arg(long, value_name = "N", value_parser = between)]
    crosscheck_every: Option<u64>,
    /// Python interpreter with MuJoCo and NumPy for --crosscheck-every [default: one in an environment that is made for it].
    #[arg(long, value_name = "FILE", requires = "crosscheck_every")]
    python: Option<PathBuf>,
    /// Print nothing but errors and the end.
    #[arg(long)]
    quiet: bool,
    /// How progress is printed.
    #[arg(long, value_enum, default_value = "text")]
    log_format: LogFormat,
}

/// Control steps between two cross-checks.
fn between(text: &str) -> Result<u64, String> {
    match super::steps(text)? {
        0 => Err("at least 1 step lies between two".into()),
        steps => Ok(steps),
    }
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
    let stop = interrupt().into_diagnostic()?;
    let session = if args.resume {
        Session::resume(args)?
    } else {
        Some(Session::start(args)?)
    };
    session.map_or(Ok(()), |mut session| session.train(args, &stop))
}

/// A run on disk and in memory.
struct Session {
    folder: PathBuf,
    settings: Settings,
    trainer: Trainer,
    shape: Shape,
    sessions: Sessions,
    begun: Instant,
    checkpoints: Checkpoints,
    metrics: MetricsWriter,
    events: EventWriter,
    // Holds the folder's lock.
    run: RunFolder,
    background: Option<Background>,
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
            robot.notes.iter().for_each(|note| tell(format_args!("note: {note}")));
        }
        check_feet(&settings, &robot)?;
        load::warn_of_long_steps(&robot, &settings.env);
        let source = args.from.as_deref().map(load::source).transpose()?;
        let learner = source
            .as_ref()
            .map(|source| source.agent(&settings, &robot))
            .transpose()?;
        let mut trainer = Trainer::new(&settings, robot)?;
        if let Some(agent) = learner {
            trainer.begin_with(agent);
        }
        let folder = args
            .run
            .clone()
            .unwrap_or_else(|| default_folder(args.config.as_deref(), settings.train.seed));
        // Everything a resume needs is there before the configuration, which makes the folder a run.
        let run = RunFolder::prepare(&folder)?;
        load::copy_robot(&settings.robot.path, &run.robot())?;
        let shape = Shape::new(&settings, &run.robot())?;
        let checkpoints = run.checkpoints();
        checkpoints.save(&checkpoint::save(&trainer, &shape)?, settings.train.keep_checkpoints)?;
        let mut sessions = Sessions::new(&run.sessions());
        sessions.push(session(&settings, 0, source.map(|source| source.origin())))?;
        run.begin(&text)?;
        Ok(Self {
            checkpoints,
            metrics: MetricsWriter::create(&run.metrics(), &metrics::NAMES)?,
            events: EventWriter::create(&folder, None).into_diagnostic()?,
            begun: Instant::now(),
            shape,
            sessions,
            background: background(args, &settings, &run, 0)?,
            settings,
            trainer,
            folder,
            run,
        })
    }

    /// The run where it stopped; nothing where there is nothing left to do.
    fn resume(args: &Args) -> miette::Result<Option<Self>> {
        let folder = args.run.clone().ok_or_else(|| {
            miette!(
                help = "for example: omniwalk train --resume --run runs/default-1",
                "--resume needs --run DIR"
            )
        })?;
        let run = RunFolder::resume(&folder)?;
        let changes: Vec<String> = args.steps.iter().map(|steps| format!("train.steps={steps}")).collect();
        let (settings, text) = load::settings(Some(&run.config()), &changes)?;
        let robot = load::robot(&run.robot())?;
        load::warn_of_long_steps(&robot, &settings.env);
        let latest = load::latest(&run)?;
        let shape = Shape::new(&settings, &run.robot())?;
        let cannot = || format!("cannot go on from {}", latest.path.display());
        for setting in shape.check(&latest.checkpoint).wrap_err_with(cannot)? {
            tell(format_args!(
                "warning: the run was trained by a version that did not know {setting}"
            ));
        }
        let trainer = checkpoint::restore(&latest.checkpoint, &settings, robot).wrap_err_with(cannot)?;
        let step = trainer.progress().steps;
        if step >= settings.train.steps {
            say(format_args!(
                "nothing to do: {} has done {step} of {} steps",
                folder.display(),
                settings.train.steps
            ))?;
            for (what, command) in conclusion::next(&folder, true) {
                say(format_args!("{what}: {command}"))?;
            }
            return Ok(None);
        }
        let (mut sessions, damage) = Sessions::resume(&run.sessions())?;
        if let Some(damage) = damage {
            tell(format_args!("warning: {damage}"));
        }
        let rows = fs::metadata(run.metrics()).map(|metrics| metrics.len());
        if step > 0 && matches!(rows, Err(_) | Ok(0)) {
            let how = if rows.is_ok() { "empty" } else { "gone" };
            tell(format_args!(
                "warning: {} is {how}: it begins anew, the curves before step {step} are lost",
                run.metrics().display()
            ));
        }
        let metrics = MetricsWriter::resume(&run.metrics(), &metrics::NAMES, step)?;
        if let Some(damage) = metrics.damage() {
            tell(format_args!("warning: {damage}"));
        }
        sessions.push(session(&settings, step, None))?;
        if args.steps.is_some() {
            run.begin(&text)?;
        }
        Ok(Some(Self {
            checkpoints: run.checkpoints(),
            metrics,
            events: EventWriter::create(&folder, Some(step)).into_diagnostic()?,
            begun: Instant::now(),
            shape,
            sessions,
            background: background(args, &settings, &run, step)?,
            settings,
            trainer,
            folder,
            run,
        }))
    }

    fn train(&mut self, args: &Args, stop: &AtomicBool) -> miette::Result<()> {
        let total = self.settings.train.steps;
        let mut reporter = Reporter::new(total, args.log_format, args.quiet);
        let started = Instant::now();
        let first_step = self.trainer.progress().steps;
        let pause = Duration::from_secs_f64(60.0 * self.settings.train.checkpoint_minutes);
        let mut written = Instant::now();
        while self.trainer.progress().steps < total && !stop.load(Ordering::Relaxed) {
            let report = self.trainer.update();
            self.run.check()?;
            let figures = metrics::figures(&self.trainer, &report);
            let symptom = health::symptom(&self.trainer, &report, &figures);
            health::check(&self.trainer, &report, symptom.as_deref())?;
            let noted = self.write(&figures);
            let shown = reporter.update(self.trainer.progress().steps, &figures, symptom, &started, first_step);
            // What was learned is kept even if its figures cannot be.
            if noted.is_err() || shown.is_err() || written.elapsed() >= pause {
                self.save()?;
                written = Instant::now();
            }
            noted?;
            shown.inspect_err(|_| self.cut_short())?;
            self.tend()?;
        }
        reporter.finish();
        if stop.load(Ordering::Relaxed) {
            tell(format_args!("stopped; writing a checkpoint"));
        }
        let path = self.save()?;
        if !stop.load(Ordering::Relaxed) {
            self.finish_transfer()?;
        }
        let warning = reporter.illness().map(Illness::to_string);
        let conclusion = Conclusion::new(&self.trainer, total, &self.folder, &path, warning);
        Ok(match args.log_format {
            LogFormat::Json => say(conclusion.json()),
            LogFormat::Text => say(conclusion),
        }?)
    }

    /// Nobody may be looking at standard output any more, but whoever finds the run stopped wants to know why.
    fn cut_short(&self) {
        let next = conclusion::next(&self.folder, false);
        let (_, command) = &next[0];
        tell(format_args!(
            "standard output takes no more: training stops with a checkpoint at step {}; go on: {command}",
            self.trainer.progress().steps
        ));
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
        let checkpoint = checkpoint::save(&self.trainer, &self.shape)?;
        let path = self
            .checkpoints
            .save(&checkpoint, self.settings.train.keep_checkpoints)
            .wrap_err(
                "training stops; the checkpoints before are as they were, go on by --resume once there is room",
            )?;
        self.sessions.progress(checkpoint.step, self.begun.elapsed())?;
        Ok(path)
    }

    /// Looks after the cross-check in the background.
    fn tend(&mut self) -> miette::Result<()> {
        let (step, trainer, shape) = (self.trainer.progress().steps, &self.trainer, &self.shape);
        let background = self.background.as_mut();
        let measured = background.and_then(|it| it.tend(&self.run, step, || checkpoint::save(trainer, shape)));
        measured.map_or(Ok(()), |measured| self.note(&measured))
    }

    /// Measures how the last checkpoint transfers.
    fn finish_transfer(&mut self) -> miette::Result<()> {
        let Some(mut background) = self.background.take() else {
            return Ok(());
        };
        tell(format_args!(
            "cross-checking the last checkpoint; it is saved, Ctrl-C ends at once"
        ));
        let mut measured = Vec::new();
        let last = checkpoint::save(&self.trainer, &self.shape)?;
        background.finish(&self.run, &last, |one| measured.push(one));
        measured.iter().try_for_each(|one| self.note(one))
    }

    fn note(&mut self, measured: &Measured) -> miette::Result<()> {
        self.events
            .scalars(measured.step, COLUMNS.into_iter().zip(measured.values))
            .into_diagnostic()
            .wrap_err("cannot write TensorBoard events")
    }
}

/// The cross-check beside the training of `run`, if it was asked for.
fn background(args: &Args, settings: &Settings, run: &RunFolder, step: u64) -> miette::Result<Option<Background>> {
    let plan = args.crosscheck_every.map(|every| Plan {
        every,
        engine: settings.env.engine.kind.name(),
        python: args.python.clone(),
    });
    plan.map(|plan| Background::new(run, plan, step)).transpose()
}

/// What the record says of this process, which trains on from `step`.
fn session(settings: &Settings, step: u64, from: Option<Origin>) -> Record {
    let arguments = std::env::args_os().skip(1);
    Record {
        arguments: arguments.map(|word| word.to_string_lossy().into_owned()).collect(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: option_env!("OMNIWALK_COMMIT").map(str::to_owned),
        machine: Some(sessions::machine()),
        seed: settings.train.seed,
        threads: rayon::current_num_threads(),
        learner_simd: omniwalk_ppo::instruction_set().to_owned(),
        engine_simd: shape::simd(settings).map(str::to_owned),
        started: sessions::utc(SystemTime::now()),
        first_step: step,
        last_step: step,
        seconds: 0.0,
        from,
    }
}

/// The factor on the velocity term rises once the foot term is large enough: it never is where there is no foot term.
fn check_feet(settings: &Settings, robot: &Robot) -> miette::Result<()> {
    let waits = settings.curriculum.velocity_gate_foot > 0.0 && settings.env.reward.foot_weight > 0.0;
    match robot.feet.len() {
        0 | 2 => Ok(()),
        _ if !waits => Ok(()),
        n => Err(miette!(
            help = "--set curriculum.velocity_gate_foot=0",
            "the reward's foot term, which curriculum.velocity_gate_foot = {} waits for, is for two feet; robot `{}` has {n}",
            settings.curriculum.velocity_gate_foot,
            robot.name
        )),
    }
}

fn default_folder(config: Option<&Path>, seed: u64) -> PathBuf {
    let stem = config.and_then(Path::file_stem);
    // `omniwalk init` writes ROBOT/train.toml.
    let parent = config.and_then(Path::parent).and_then(Path::file_name);
    let name = match stem {
        Some(stem) if stem == "train" => parent.unwrap_or(stem).to_string_lossy(),
        Some(stem) => stem.to_string_lossy(),
        None => "default".into(),
    };
    Path::new("runs").join(format!("{name}-{seed}"))
}
