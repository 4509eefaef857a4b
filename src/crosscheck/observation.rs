//! Every block of the observation along one trajectory: what the environment's sensors and controller make of it in single
//! precision, against MuJoCo's own kinematics of the same states read by the second reader in double precision.

use std::sync::Arc;

use miette::miette;
use omniwalk_env::Batch;
use omniwalk_env::EnvConfig;
use omniwalk_env::engine::BaseState;
use omniwalk_env::robot::Robot;
use serde_json::json;

use super::check::Check;
use super::engine::{Workshop, base_numbers};
use super::network::largest;
use super::process::{bytes, numbers};
use super::subject::Subject;
use crate::eval::forward::nominal;
use crate::eval::player::Player;

/// Control steps of the trajectory, and between changes of the command.
const STEPS: usize = 400;
const COMMAND: usize = 80;

/// Relative rounding of single precision.
const ROUNDING: f64 = 6e-8;
/// An entry is made of at most so many roundings of numbers of its block's size: the heading adds up the steps of the inertial
/// frame's period (80 for two seconds), a forward kinematics multiplies through some ten joints.
const ROUNDINGS: f64 = 200.0;
/// The velocity is a mean over the soles' corners, weighted by how high they are on a scale of 4 mm. A height of 1 m is known
/// to a dozen roundings, and a weight changes by at most 0.6 over the scale: so much of what the corners differ by.
const VELOCITY: f64 = 12.0 * ROUNDING / 0.004 * 0.6;

/// The checks of every block of `subject`'s observation by `robot`, in worlds under `config` without randomisation.
///
/// # Errors
/// When robot, policy and configuration do not fit together.
pub fn checks(
    subject: &Subject,
    robot: &Arc<Robot>,
    config: &EnvConfig,
    workshop: &Workshop,
) -> miette::Result<Vec<Check>> {
    let mut config = config.clone();
    nominal(&mut config);
    let mut batch = Batch::with_engines(robot.clone(), &config, 1, 1, workshop)?;
    let commands = commands(subject);
    batch.set_desired_of(0, commands[0]);
    batch.reset();
    let phase = batch.look(0).0.pipeline().clock_phase();
    let given = config.observation.true_velocity;
    let width = subject.policy.spec().observation_len();
    let (trajectory, ours) = walk(subject, &mut batch, &commands)?;
    let file = subject.policy.to_bytes();
    let head = json!({ "policy": file.len(), "phase": phase, "given": given });
    let rest: Vec<u8> = file.into_iter().chain(trajectory).collect();
    let mut worlds = workshop
        .worlds(robot, config.physics_dt(), 1, Default::default())
        .map_err(|why| miette!("{why}"))?;
    let theirs: Vec<f64> = worlds
        .ask_with_head(b'o', &head, &rest)
        .map(|reply| numbers(reply).collect())
        .map_err(|why| miette!("the second reader: {why}"))?;
    if theirs.len() != ours.len() {
        return Err(miette!("{} observations, and {} from Python", ours.len(), theirs.len()));
    }
    let mut at = 0;
    let mut check = |name: &str, len: usize| {
        let (mut size, mut worst) = (1.0_f64, 0.0);
        for (ours, theirs) in ours.chunks_exact(width).zip(theirs.chunks_exact(width)) {
            for (a, b) in ours[at..at + len].iter().zip(&theirs[at..at + len]) {
                size = size.max(b.abs());
                worst = largest(worst, (f64::from(*a) - b).abs());
            }
        }
        at += len;
        let each = if name.starts_with("velocity") && !given {
            VELOCITY
        } else {
            ROUNDING * ROUNDINGS
        };
        Check::new(format!("observation: {name}"), worst, each * size)
    };
    let blocks = subject.policy.spec().layout();
    Ok(blocks
        .iter()
        .map(|block| check(&block.name, block.len as usize))
        .collect())
}

/// The commands of the run's evaluation within what the policy was trained for: the controller keeps to that.
fn commands(subject: &Subject) -> Vec<[f64; 3]> {
    let trained = &subject.policy.identity().curriculum;
    let within = |k: usize, x: f64| x.clamp(f64::from(trained.lower[k]), f64::from(trained.upper[k]));
    let commands = subject.settings.eval.commands.iter();
    let mut commands: Vec<[f64; 3]> = commands
        .map(|command| [0, 1, 2].map(|k| within(k, command[k])))
        .collect();
    if commands.is_empty() {
        commands.push([0, 1, 2].map(|k| within(k, 0.0)));
    }
    commands
}

/// Walks until the episode ends or the trajectory is long enough: states with command and action as Python takes them, and the
/// observations.
fn walk(subject: &Subject, batch: &mut Batch, commands: &[[f64; 3]]) -> miette::Result<(Vec<u8>, Vec<f32>)> {
    let mut player = Player::Controller(Box::new(subject.controller()?));
    let mut actions = vec![0.0; batch.shared().spec.action_len()];
    let (mut trajectory, mut observations) = (Vec::new(), Vec::new());
    for step in 1..=STEPS {
        let state = state(batch);
        player.mode(batch.observations(), &mut actions);
        observations.extend(batch.observations());
        trajectory.extend(bytes(&state));
        trajectory.extend(actions.iter().flat_map(|&action| f64::from(action).to_le_bytes()));
        batch.set_desired_of(0, commands[step / COMMAND % commands.len()]);
        batch.step(&actions);
        if batch.ends()[0].is_some() {
            break;
        }
    }
    Ok((trajectory, observations))
}

/// Base, joints and what the last observation was asked for.
fn state(batch: &Batch) -> Vec<f64> {
    let (environment, engine, world) = batch.look(0);
    let base: BaseState = engine.base(world);
    let joints = engine.joints();
    let all = base_numbers(&base).into_iter().chain(joints.position.iter().copied());
    // What the controller was asked is in single precision.
    let desired = environment.desired().map(|x| f64::from(x as f32));
    all.chain(joints.velocity.iter().copied()).chain(desired).collect()
}
