//! `train --crosscheck-every`: checkpoints walk in MuJoCo in the background while training goes on.
//!
//! One process at a time, at the lowest priority and on one thread, plays the cross-check's third gate in small. Training gives
//! it a checkpoint and takes its figures in; it never waits for it but at its end, and its bits do not depend on it. What fails
//! is reported, and training goes on.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::Value;

use crate::run::checkpoint::Checkpoint;
use crate::run::metrics::MetricsWriter;
use crate::run::transfer::{self, COLUMNS};
use crate::run::{RunFolder, create_folder};
use crate::terminal::tell;

/// What is walked: the commands of the run's evaluation, so often and so long, s. Half a minute of one core for the default.
const SUITE: [&str; 6] = ["--suite", "commands", "--episodes", "10", "--seconds", "10"];

/// How checkpoints are measured.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Control steps between checkpoints.
    pub every: u64,
    /// Engine beside MuJoCo: the one the policy learns in.
    pub engine: &'static str,
    /// Python interpreter with MuJoCo; without one the program's own environment is made and used.
    pub python: Option<PathBuf>,
}

/// The background of a run.
pub struct Background {
    plan: Plan,
    writer: MetricsWriter,
    running: Option<Running>,
    /// The step from which on the next checkpoint is due.
    due: u64,
    /// The step of the checkpoint that was taken last.
    last: Option<u64>,
}

struct Running {
    step: u64,
    child: Child,
}

/// Whether training goes on beside a measurement, which is then at the lowest priority.
#[derive(Clone, Copy, PartialEq)]
enum Training {
    GoesOn,
    Ended,
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A checkpoint's figures.
pub struct Measured {
    /// Its step.
    pub step: u64,
    /// The values of [`COLUMNS`].
    pub values: [f64; COLUMNS.len()],
}

impl Background {
    /// The background of `run`, whose training begins or goes on at `step`; measurements of later steps go.
    ///
    /// # Errors
    /// When the run's folder cannot be written.
    pub fn new(run: &RunFolder, plan: Plan, step: u64) -> miette::Result<Self> {
        let folder = transfer::folder(run);
        create_folder(&folder)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
        let writer = MetricsWriter::resume(&run.transfer(), &COLUMNS, step)?;
        if let Some(damage) = writer.damage() {
            tell(format_args!("warning: {damage}"));
        }
        transfer::tidy(run);
        Ok(Self {
            due: (step / plan.every + 1) * plan.every,
            plan,
            writer,
            running: None,
            last: None,
        })
    }

    /// After an update that ended at `step`: takes in what has been measured, and starts with the checkpoint that `save` gives
    /// if one is due and none is at work.
    pub fn tend(
        &mut self,
        run: &RunFolder,
        step: u64,
        save: impl FnOnce() -> miette::Result<Checkpoint>,
    ) -> Option<Measured> {
        let measured = self.collect(run);
        if step >= self.due && self.running.is_none() {
            self.due = (step / self.plan.every + 1) * self.plan.every;
            self.begin(run, Training::GoesOn, save);
        }
        measured
    }

    /// At the end of training: waits for what is at work and measures the last checkpoint.
    pub fn finish(&mut self, run: &RunFolder, last: &Checkpoint, mut take: impl FnMut(Measured)) {
        self.wait();
        self.collect(run).into_iter().for_each(&mut take);
        if self.last != Some(last.step) {
            self.begin(run, Training::Ended, || Ok(last.clone()));
            self.wait();
            self.collect(run).into_iter().for_each(&mut take);
        }
    }

    fn wait(&mut self) {
        if let Some(running) = &mut self.running {
            // What it says of itself is found when it is collected.
            let _ = running.child.wait();
        }
    }

    fn begin(&mut self, run: &RunFolder, training: Training, save: impl FnOnce() -> miette::Result<Checkpoint>) {
        match self.spawn(run, training, save) {
            Ok(running) => {
                self.last = Some(running.step);
                self.running = Some(running);
            }
            Err(error) => tell(format_args!("warning: the cross-check was not started: {error:#}")),
        }
    }

    fn spawn(
        &self,
        run: &RunFolder,
        training: Training,
        save: impl FnOnce() -> miette::Result<Checkpoint>,
    ) -> miette::Result<Running> {
        let checkpoint = save()?;
        let path = transfer::checkpoint(run, checkpoint.step);
        checkpoint.write(&path)?;
        let log = log(run);
        let output = File::create(&log)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write {}", log.display()))?;
        let errors = output.try_clone().into_diagnostic()?;
        let mut command = self.command(run, training, &path)?;
        let child = command
            .env("RAYON_NUM_THREADS", "1")
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(errors)
            .spawn()
            .into_diagnostic()
            .wrap_err("cannot start it")?;
        Ok(Running {
            step: checkpoint.step,
            child,
        })
    }

    fn command(&self, run: &RunFolder, training: Training, checkpoint: &Path) -> miette::Result<Command> {
        let program = std::env::current_exe().into_diagnostic()?;
        let mut command = if cfg!(unix) && training == Training::GoesOn {
            let mut nice = Command::new("nice");
            nice.args(["-n", "19"]).arg(program);
            nice
        } else {
            Command::new(program)
        };
        let _ = fs::remove_file(report(run));
        command
            .arg("crosscheck")
            .arg(run.path())
            .arg("--checkpoint")
            .arg(checkpoint);
        command
            .args(["--gate", "closed_loop", "--engine", self.plan.engine])
            .args(SUITE);
        command.arg("--out").arg(transfer::folder(run));
        if let Some(python) = &self.plan.python {
            command.arg("--python").arg(python);
        }
        Ok(command)
    }

    /// Takes in what has ended.
    fn collect(&mut self, run: &RunFolder) -> Option<Measured> {
        let running = self.running.as_mut()?;
        let status = match running.child.try_wait() {
            Ok(None) => return None,
            Ok(Some(status)) => status,
            Err(_) => return None,
        };
        let step = running.step;
        self.running = None;
        // A gate that fails is a measurement; an error is none.
        let measured = match status.code() {
            Some(0 | 1) => read(run).and_then(|values| {
                self.writer.append(step, &values)?;
                Ok(Measured { step, values })
            }),
            _ => Err(miette!("it ended with {status}, see {}", log(run).display())),
        };
        transfer::tidy(run);
        measured
            .map_err(|error| {
                tell(format_args!(
                    "warning: the cross-check of step {step} failed: {error:#}"
                ))
            })
            .ok()
    }
}

fn report(run: &RunFolder) -> PathBuf {
    transfer::folder(run).join("crosscheck.json")
}

fn log(run: &RunFolder) -> PathBuf {
    transfer::folder(run).join("log.txt")
}

fn read(run: &RunFolder) -> miette::Result<[f64; COLUMNS.len()]> {
    let path = report(run);
    let text = fs::read_to_string(&path)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", path.display()))?;
    let report: Value = serde_json::from_str(&text).into_diagnostic()?;
    transfer::values(&report).ok_or_else(|| miette!("{} holds no measurement", path.display()))
}
