//! How a robot with a fixed base moves, as JSON for the comparison with another simulator:
//! `cargo run --release -p omniwalk-env --example motion_dump ROBOT ENGINE DT SECONDS`.
//!
//! It starts at rest, every joint without an actuator half a radian off its nominal position. Actuators follow chirps about
//! theirs: joint d at time t is sent `nominal + 0.15 (sin(3 t + 6 t^2 + d) - sin(d))`, constant over a step.

mod support;

use std::error::Error;
use std::path::Path;

use omniwalk_env::engine::{Drive, Friction, Start, World};
use omniwalk_env::robot::{self, Robot};
use serde::Serialize;
use support::make_engine;

/// Amplitude of the chirps and offset of free joints, rad.
const AMPLITUDE: f64 = 0.15;
const OFFSET: f64 = 0.5;
/// Between samples, s.
const INTERVAL: f64 = 0.01;

#[derive(Serialize)]
struct Dump {
    /// Names of the degrees of freedom.
    dofs: Vec<String>,
    start: Vec<f64>,
    /// Positions of the degrees of freedom every 10 ms.
    positions: Vec<Vec<f64>>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, engine, dt, seconds] = &arguments[..] else {
        return Err("usage: motion_dump ROBOT ENGINE DT SECONDS".into());
    };
    let robot = robot::load(Path::new(path))?;
    let (dt, seconds): (f64, f64) = (dt.parse()?, seconds.parse()?);
    let mut engine = make_engine(engine, &robot, dt)?;
    let mut start = Start::nominal(&robot);
    for (d, position) in start.joints.iter_mut().enumerate() {
        if robot.dof(d).actuator.is_none() {
            *position += OFFSET;
        }
    }
    let friction = Friction {
        tangential: 0.6,
        torsional: 0.0,
        rolling: 0.0,
    };
    engine.reset(0, &start, &World::nominal(&robot, friction));
    let every = (INTERVAL / dt).round() as usize;
    let mut positions = vec![];
    for step in 0..(seconds / dt).round() as usize {
        engine.step(&chirp(&robot, step as f64 * dt));
        if (step + 1) % every == 0 {
            positions.push(engine.joints().position.clone());
        }
    }
    let dump = Dump {
        dofs: (0..robot.dofs.len()).map(|d| robot.dof(d).name.clone()).collect(),
        start: start.joints,
        positions,
    };
    println!("{}", serde_json::to_string(&dump)?);
    Ok(())
}

fn chirp(robot: &Robot, time: f64) -> Drive {
    let mut drive = Drive::idle(robot.dofs.len(), 1);
    for d in 0..robot.dofs.len() {
        let joint = robot.dof(d);
        let Some(actuator) = joint.actuator else { continue };
        let phase = (3.0 + 6.0 * time) * time + d as f64;
        drive.target[d] = joint.nominal + AMPLITUDE * (phase.sin() - (d as f64).sin());
        drive.stiffness[d] = actuator.kp;
        drive.damping[d] = actuator.kd;
        drive.torque_min[d] = -actuator.torque_limit;
        drive.torque_max[d] = actuator.torque_limit;
    }
    drive
}
