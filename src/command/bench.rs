//! `omniwalk bench`: throughput, measured on this machine.

mod controller;
mod environments;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, WrapErr};
use serde_json::{Value, json};

use super::load;
use crate::files::can_write;
use crate::run::write_atomic;
use crate::settings::Settings;
use crate::terminal::say;
use crate::train::trainer::{Split, Trainer};

/// Measures throughput.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand, Debug)]
enum What {
    /// Environments alone, engine and task apart: random actions at every control step, episodes start again when they end.
    Env(Options),
    /// Training with its split into physics, inference and update.
    Train(Options),
    /// One pass of learning against the processor's peak.
    Ppo(Options),
    /// A step of the controller as a robot runs it.
    Controller(controller::Options),
}

#[derive(clap::Args, Debug)]
struct Options {
    /// Configuration laid over the defaults.
    config: Option<PathBuf>,
    /// Physics engine.
    #[arg(long, value_parser = ["rapier", "lanes"])]
    engine: Option<String>,
    /// Threads [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(super::THREADS))]
    threads: Option<u16>,
    /// Seconds to measure, in rounds of a second of which the median counts.
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    seconds: u32,
    /// Samples of a minibatch (ppo).
    #[arg(long, value_name = "N", default_value_t = 4800, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    batch: u32,
    /// Changes a single value of the configuration.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Also writes the result to FILE.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with configuration or robot.
pub fn run(args: &Args) -> miette::Result<()> {
    let json = match &args.what {
        What::Controller(options) => &options.json,
        What::Env(options) | What::Train(options) | What::Ppo(options) => &options.json,
    };
    json.as_deref().map_or(Ok(()), can_write)?;
    let result = match &args.what {
        What::Controller(options) => controller::run(options)?,
        What::Env(options) | What::Train(options) | What::Ppo(options) => throughput(args, options)?,
    };
    if let Some(file) = json {
        let text = serde_json::to_string_pretty(&result).into_diagnostic()? + "\n";
        write_atomic(file, text.as_bytes())
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write {}", file.display()))?;
    }
    Ok(())
}

fn throughput(args: &Args, options: &Options) -> miette::Result<Value> {
    let threads = options.threads.map_or_else(available, usize::from);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .into_diagnostic()?;
    let mut changes = options.set.clone();
    changes.extend(options.engine.as_ref().map(|engine| format!("engine.kind={engine}")));
    let (settings, _) = load::settings(options.config.as_deref(), &changes)?;
    let mut result = match args.what {
        What::Train(_) => train(&settings, options.seconds)?,
        What::Ppo(_) => ppo(&settings, options, threads)?,
        // On a thread of the pool: from outside it, every step would wake one and wait.
        _ => rayon::scope(|_| environments::bench(&settings, options.seconds, threads))?,
    };
    result["threads"] = json!(threads);
    Ok(result)
}

fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

fn train(settings: &Settings, seconds: u32) -> miette::Result<Value> {
    let robot = load::robot(&settings.robot.path)?;
    let mut trainer = Trainer::new(settings, robot)?;
    trainer.update();
    let (mut rates, mut total, mut samples) = (Vec::new(), Split::default(), 0);
    let start = Instant::now();
    while rates.len() < 3 || start.elapsed() < Duration::from_secs(seconds.into()) {
        let clock = Instant::now();
        let report = trainer.update();
        rates.push(report.samples as f64 / clock.elapsed().as_secs_f64());
        samples += report.samples;
        total.physics += report.split.physics;
        total.inference += report.split.inference;
        total.update += report.split.update;
    }
    let rate = median(&mut rates);
    let per_million = |seconds: f64| seconds * 1e6 / samples as f64;
    let passes = settings.ppo.epochs * if settings.train.mirror { 2 } else { 1 };
    say(format_args!(
        "{rate:.0} policy steps/s ({}; {} environments, networks {:?}, {passes} sample passes a step)\n\
         seconds per million steps: physics {:.1}, inference {:.1}, update {:.1}",
        settings.env.engine.kind.name(),
        settings.train.environments,
        settings.ppo.hidden,
        per_million(total.physics),
        per_million(total.inference),
        per_million(total.update),
    ))?;
    Ok(json!({
        "engine": settings.env.engine.kind.name(),
        "environments": settings.train.environments,
        "physics_hz": settings.env.engine.physics_hz,
        "policy_steps_per_second": rate,
        "passes_per_step": passes,
        "physics": per_million(total.physics),
        "inference": per_million(total.inference),
        "update": per_million(total.update),
    }))
}

fn ppo(settings: &Settings, options: &Options, threads: usize) -> miette::Result<Value> {
    let robot = load::robot(&settings.robot.path)?;
    let spec = omniwalk_env::task::shared::spec(&robot, &settings.env);
    let result = omniwalk_ppo::bench(
        settings.ppo.clone(),
        spec.observation_len(),
        spec.action_len(),
        options.batch as usize,
        threads,
    )
    .map_err(|error| miette::miette!("ppo.{error}"))?;
    say(format_args!(
        "{:.0} samples/s, {:.1} GFLOP/s of {:.1} GFLOP/s peak: {:.0} % (networks {:?}, minibatch {}, {threads} threads)",
        result.samples_per_second,
        result.gflops,
        result.peak_gflops,
        100.0 * result.gflops / result.peak_gflops,
        settings.ppo.hidden,
        options.batch,
    ))?;
    Ok(json!({
        "samples_per_second": result.samples_per_second,
        "gflops": result.gflops,
        "peak_gflops": result.peak_gflops,
        "batch": options.batch,
    }))
}

/// Sorts `values` and returns the one in the middle.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
