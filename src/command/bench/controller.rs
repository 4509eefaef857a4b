//! `omniwalk bench controller`: how long a step of the controller takes.

use std::path::PathBuf;
use std::time::Instant;

use miette::{IntoDiagnostic, miette};
use omniwalk_controller::{Bounds, Controller, Curriculum, Identity, Policy};
use omniwalk_env::task::shared::spec;
use omniwalk_ppo::Agent;
use serde_json::{Value, json};

use super::super::load;
use crate::export;
use crate::terminal::{OutputError, say};

/// Steps before those that are measured.
const WARM_UP: usize = 10_000;

#[derive(clap::Args, Debug)]
pub struct Options {
    /// Policy file [default: the default robot, which is in the repository, with the thesis's networks, 512-512, untrained].
    policy: Option<PathBuf>,
    /// Steps that are measured.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1000..=100_000_000))]
    steps: u32,
    /// Also writes the result to FILE.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

pub fn run(options: &Options) -> miette::Result<Value> {
    let policy = match &options.policy {
        Some(path) => load::policy(path)?,
        None => untrained()?,
    };
    let widths: Vec<_> = policy.actor().layers.iter().map(|layer| layer.bias.len()).collect();
    say(format_args!(
        "{} steps of observation, network {} - {widths:?}, decoding, on one core",
        options.steps,
        policy.actor().observation_len()
    ))?;
    let best = Controller::new(&policy).into_diagnostic()?;
    let portable = Controller::portable(&policy).into_diagnostic()?;
    let name = best.instruction_set();
    let mut result = measure(&policy, best, options.steps);
    print("this processor's widest instructions", name, &result)?;
    let base = measure(&policy, portable, options.steps);
    print("portable", "what every processor of this kind has", &base)?;
    result["steps"] = json!(options.steps);
    result["instruction_set"] = json!(name);
    result["portable"] = base;
    Ok(result)
}

fn print(what: &str, about: &str, result: &Value) -> Result<(), OutputError> {
    let figure = |key: &str| result[key].as_f64().unwrap_or(f64::NAN);
    say(format_args!(
        "{what} ({about}): p50 {:.2} us, p99 {:.2} us, p99.9 {:.2} us, max {:.1} us",
        figure("p50_us"),
        figure("p99_us"),
        figure("p999_us"),
        figure("max_us")
    ))
}

/// Plays the readings of the golden steps over and over.
fn measure(policy: &Policy, mut controller: Controller, steps: u32) -> Value {
    let period = controller.period();
    let readings = policy.golden().steps.iter().map(|step| (step.sensors(), step.desired));
    let readings: Vec<_> = readings.collect();
    let mut targets = vec![0.0; policy.spec().action_len()];
    let mut now = 0;
    let mut times = Vec::with_capacity(steps as usize);
    // The first steps warm up caches and clocks.
    for k in 0..steps as usize + WARM_UP {
        let (sensors, desired) = &readings[k % readings.len()];
        now += period;
        let start = Instant::now();
        controller.step(now, now, sensors, *desired, &mut targets);
        let time = start.elapsed().as_nanos();
        if k >= WARM_UP {
            times.push(u32::try_from(time).unwrap_or(u32::MAX));
        }
    }
    times.sort_unstable();
    let at = |per_thousand: usize| f64::from(times[(times.len() - 1) * per_thousand / 1000]) * 1e-3;
    json!({ "p50_us": at(500), "p99_us": at(990), "p999_us": at(999), "max_us": at(1000) })
}

/// The default robot and layout with networks of the thesis's size (7.3.4).
fn untrained() -> miette::Result<Policy> {
    let (settings, _) = load::settings(None, &["ppo.hidden=[512, 512]".to_owned()])?;
    let robot = &settings.robot.path;
    if !robot.exists() {
        return Err(miette!(
            help = "give the policy to measure: `omniwalk bench controller walk.omni`",
            "without a policy the default robot is measured, and there is no {} here",
            robot.display()
        ));
    }
    let layout = spec(&*load::robot(robot)?, &settings.env);
    let (inputs, joints) = (layout.observation_len(), layout.action_len());
    let agent = Agent::new(settings.ppo, inputs, joints, settings.train.seed).into_diagnostic()?;
    let bounds = Bounds {
        lower: vec![f32::NEG_INFINITY; inputs],
        upper: vec![f32::INFINITY; inputs],
    };
    let identity = Identity {
        config_hash: [0; 32],
        seed: settings.train.seed,
        steps: 0,
        program: "omniwalk bench".to_owned(),
        latency: [0.0; 2],
        curriculum: Curriculum {
            lower: layout.command.lower,
            upper: layout.command.upper,
            velocity_factor: 1.0,
            foot_factor: 1.0,
        },
    };
    Policy::new(layout, export::actor(&agent.policy()), bounds, identity).into_diagnostic()
}
