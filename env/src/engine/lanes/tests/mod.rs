mod contact;
mod dynamics;
mod ground;
mod joint;
mod lanes;
mod long;
mod lying;
#[path = "../../../../tests/support/order.rs"]
mod order;
mod reference;
mod robots;
mod standing;
mod sweeps;
mod tipping;

use std::path::Path;

use super::{Lanes, Simd};
use crate::engine::{Drive, Engine, Friction, GRAVITY, Start, World};
use crate::robot::Robot;
use nalgebra::Vector3;

fn friction(tangential: f64, torsional: f64, rolling: f64) -> Friction {
    Friction {
        tangential,
        torsional,
        rolling,
    }
}

fn world(robot: &Robot) -> World {
    World::nominal(robot, friction(0.6, 0.0, 0.0))
}

/// The project's humanoid.
fn nimbro() -> Robot {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/nimbro_op2x");
    crate::robot::load(Path::new(path)).expect("the robot loads")
}

/// Every actuator at its nominal target in one world.
fn hold(robot: &Robot) -> Drive {
    let mut drive = Drive::idle(robot.dofs.len(), 1);
    for d in 0..robot.dofs.len() {
        let joint = robot.dof(d);
        let Some(actuator) = joint.actuator else { continue };
        drive.target[d] = joint.nominal;
        drive.stiffness[d] = actuator.kp;
        drive.damping[d] = actuator.kd;
        drive.torque_min[d] = -actuator.torque_limit;
        drive.torque_max[d] = actuator.torque_limit;
    }
    drive
}

/// One world at `level`, started.
fn single(robot: &Robot, dt: f64, level: Simd, start: &Start, world: &World) -> Lanes {
    let mut engine = Lanes::new(robot, dt, 1, level).expect("level is available");
    engine.reset(0, start, world);
    engine
}

fn levels() -> impl Iterator<Item = Simd> {
    Simd::ALL.into_iter().filter(|level| level.is_available())
}

/// Relative rounding error of a number in the level's lanes.
fn epsilon(level: Simd) -> f64 {
    if level.name().starts_with("f32") {
        f64::from(f32::EPSILON)
    } else {
        f64::EPSILON
    }
}

/// What a step rounds of a number in the level's lanes, relative: a few times on its way through.
fn rounding(level: Simd) -> f64 {
    8.0 * epsilon(level)
}
