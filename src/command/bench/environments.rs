//! `omniwalk bench env`: environments alone, with the split of their time.
//!
//! Rates come from rounds in which only control steps are split into phases; in rounds between them physics steps are
//! split too. Processor time counts what this process got, whatever else ran on the machine.

use std::time::{Duration, Instant};

use omniwalk_env::Batch;
use omniwalk_env::batch::{Collect, Outcomes};
use omniwalk_env::engine::Phase;
use serde_json::{Value, json};

use super::{load, median};
use crate::settings::Settings;
use crate::terminal::say;
use crate::train::shape;

/// Control steps in one go, as training collects them.
const STEPS: usize = 128;

/// Environments under random actions.
struct Bench {
    batch: Batch,
    draws: Vec<Draws>,
}

/// Random actions of a group: every one a hash of its count, so that they do not wait for each other.
struct Draws {
    actions: Vec<f32>,
    counter: u32,
}

struct Random;

impl Collect for Random {
    type Part = Draws;

    fn act<'p>(&self, draws: &'p mut Draws, _: usize, _: &[f32]) -> &'p [f32] {
        for (action, count) in draws.actions.iter_mut().zip(draws.counter..) {
            let mixed = (count ^ (count >> 16)).wrapping_mul(0x7feb_352d);
            let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x846c_a68b);
            *action = (mixed >> 8) as f32 / (1 << 24) as f32;
        }
        draws.counter = draws.counter.wrapping_add(draws.actions.len() as u32);
        &draws.actions
    }

    fn take(&self, _: &mut Draws, _: usize, _: &Outcomes<'_>) {}
}

/// What a second of it took.
struct Round {
    steps: f64,
    /// Wall time, s.
    seconds: f64,
    /// Processor time of all threads, s.
    processor: f64,
    /// Time of all threads by phase of the control step, and of the physics step if that was split.
    phases: Vec<Phase>,
    engine_phases: Vec<Phase>,
}

/// Measures for about `seconds`.
pub fn bench(settings: &Settings, seconds: u32, threads: usize) -> miette::Result<Value> {
    let robot = load::robot(&settings.robot.path)?;
    let batch = Batch::new(robot, &settings.env, settings.train.environments, settings.train.seed)?;
    let joints = batch.shared().spec.action_len();
    let draws = batch.groups().map(|environments| Draws {
        actions: vec![0.5; environments.len() * joints],
        // Far enough apart that groups do not repeat each other.
        counter: (environments.start as u32).wrapping_mul(0x9e37_79b9),
    });
    let draws = draws.collect();
    let mut bench = Bench { batch, draws };
    let peak = omniwalk_ppo::peak_gflops(threads);
    bench.round(false);
    let (mut rounds, mut split, mut operations) = (vec![], vec![], vec![]);
    for _ in 0..seconds.div_ceil(2) {
        rounds.push(bench.round(false));
        split.push(bench.round(true));
        operations.extend(bench.batch.operations());
    }
    let worlds = bench.batch.environments();
    let result = json!({
        "engine": settings.env.engine.kind.name(),
        "simd": shape::simd(settings),
        "environments": worlds,
        "physics_hz": settings.env.engine.physics_hz,
        "policy_steps_per_second": middle(&rounds, |r| r.steps / r.seconds),
        "policy_steps_per_processor_second": middle(&rounds, |r| r.steps / r.processor),
        "engine_policy_steps_per_processor_second": middle(&rounds, |r| r.steps / (r.processor * r.engine_share())),
        "idle_share": middle(&rounds, |r| 1.0 - r.processor / (r.seconds * threads as f64)),
        "phases": control_phases(&rounds),
        "engine_phases": physics_phases(&split, &operations, worlds, settings.env.substeps()),
        "peak_gflops_per_thread": peak / threads as f64,
    });
    print(&result)?;
    Ok(result)
}

impl Bench {
    /// A second of steps; `engine` splits physics steps too.
    fn round(&mut self, engine: bool) -> Round {
        self.batch.time_phases(true, engine);
        let (start, before) = (Instant::now(), processor_seconds());
        let mut steps = 0;
        while start.elapsed() < Duration::from_secs(1) {
            self.batch.roll(STEPS, &Random, &mut self.draws);
            self.batch.take_episodes().for_each(drop);
            steps += STEPS * self.batch.environments();
        }
        Round {
            steps: steps as f64,
            seconds: start.elapsed().as_secs_f64(),
            processor: processor_seconds() - before,
            phases: self.batch.phases(),
            engine_phases: self.batch.engine_phases(),
        }
    }
}

impl Round {
    /// Part of the time that physics takes: the engine, and the law of the actuators, which other simulators count with it.
    fn engine_share(&self) -> f64 {
        let seconds = |phase: &Phase| phase.seconds;
        let physics = self
            .phases
            .iter()
            .filter(|phase| ["engine", "drives"].contains(&phase.name));
        physics.map(seconds).sum::<f64>() / self.phases.iter().map(seconds).sum::<f64>()
    }
}

/// Median over the rounds.
fn middle(rounds: &[Round], figure: impl Fn(&Round) -> f64) -> f64 {
    median(&mut rounds.iter().map(figure).collect::<Vec<_>>())
}

/// Microseconds a policy step by phase.
fn control_phases(rounds: &[Round]) -> Vec<Value> {
    let phase = |i: usize| {
        let us = middle(rounds, |r| 1e6 * r.phases[i].seconds / r.steps);
        json!({ "name": rounds[0].phases[i].name, "us": us })
    };
    (0..rounds[0].phases.len()).map(phase).collect()
}

/// Microseconds a robot's physics step by phase and, where they are counted, floating-point operations.
fn physics_phases(rounds: &[Round], operations: &[Vec<u64>], worlds: usize, substeps: u32) -> Vec<Value> {
    let phase = |i: usize| {
        let us = middle(rounds, |r| {
            1e6 * r.engine_phases[i].seconds / (r.steps * f64::from(substeps))
        });
        let counted = operations.iter().map(|own| own[i] as f64).sum::<f64>() / (operations.len() * worlds) as f64;
        let counted = (!operations.is_empty()).then_some(counted);
        json!({
            "name": rounds[0].engine_phases[i].name,
            "us": us,
            "operations": counted,
            "gflops_per_thread": counted.map(|operations| 1e-3 * operations / us),
        })
    };
    (0..rounds[0].engine_phases.len()).map(phase).collect()
}

fn print(result: &Value) -> miette::Result<()> {
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    say(format_args!(
        "{:.0} policy steps/s ({} environments, {} at {} Hz)\n{:.0} a second of processor time, {:.0} in the engine alone; processors idle {:.1} %",
        number(&result["policy_steps_per_second"]),
        result["environments"],
        result["engine"].as_str().unwrap_or_default(),
        result["physics_hz"],
        number(&result["policy_steps_per_processor_second"]),
        number(&result["engine_policy_steps_per_processor_second"]),
        100.0 * number(&result["idle_share"]),
    ))?;
    let list = |key: &str| result[key].as_array().cloned().unwrap_or_default();
    say("us a policy step:")?;
    for phase in list("phases") {
        say(format_args!(
            "  {:18} {:6.3}",
            phase["name"].as_str().unwrap_or_default(),
            number(&phase["us"])
        ))?;
    }
    let phases = list("engine_phases");
    if phases.is_empty() {
        return Ok(());
    }
    let peak = number(&result["peak_gflops_per_thread"]);
    say(format_args!(
        "us a physics step, operations (counted in single precision), GFLOP/s a thread, of the peak of {peak:.0}:"
    ))?;
    let line = |name: &str, us: f64, operations: Option<f64>| {
        let counted = operations.map_or("     -      -     -".into(), |operations| {
            let gflops = 1e-3 * operations / us;
            format!("{operations:6.0} {gflops:6.1} {:3.0} %", 100.0 * gflops / peak)
        });
        say(format_args!("  {name:18} {us:6.3} {counted}"))
    };
    let sum = |key: &str| phases.iter().map(|phase| phase[key].as_f64()).sum::<Option<f64>>();
    for phase in &phases {
        let name = phase["name"].as_str().unwrap_or_default();
        line(name, number(&phase["us"]), phase["operations"].as_f64())?;
    }
    line("whole", sum("us").unwrap_or(f64::NAN), sum("operations"))?;
    Ok(())
}

/// Processor time of this process so far, s.
#[cfg(unix)]
fn processor_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Where nobody tells the processor time, time itself: true on a machine without other work, with one thread.
#[cfg(not(unix))]
fn processor_seconds() -> f64 {
    use std::sync::OnceLock;
    static BEGIN: OnceLock<Instant> = OnceLock::new();
    BEGIN.get_or_init(Instant::now).elapsed().as_secs_f64()
}
