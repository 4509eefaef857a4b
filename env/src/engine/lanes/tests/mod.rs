mod contact;
mod dynamics;
mod ground;
mod joint;
mod lanes;
mod reference;
mod robots;

use super::{Lanes, Simd};
use crate::engine::{Drive, Engine, Friction, GRAVITY, Start, World};
use crate::robot::Robot;
use nalgebra::Vector3;

fn world(robot: &Robot) -> World {
    let friction = Friction {
        tangential: 0.6,
        torsional: 0.0,
        rolling: 0.0,
    };
    World::nominal(robot, friction)
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
