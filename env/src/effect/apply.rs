//! Putting an effect into a robot.

use nalgebra::Vector3;

use super::sensor::Sensor;
use super::{Effect, Kind, body};
use crate::robot::{Passive, Robot};

/// Adds `effect` to `robot`: sets the joint's value, changes the link, or notes what the actuators are to run. An effect
/// of the same kind on the same target is replaced where that can be: those of bodies add up.
pub fn apply(robot: &mut Robot, effect: &Effect) {
    let v = &effect.values;
    match effect.kind {
        Kind::Mass => body::scaled(&mut robot.links[effect.target].inertial, v[0]),
        Kind::CentreOfMass => body::shifted(&mut robot.links[effect.target].inertial, Vector3::new(v[0], v[1], v[2])),
        Kind::Payload => {
            let place = Vector3::new(v[1], v[2], v[3]);
            body::loaded(&mut robot.links[effect.target].inertial, v[0], place);
        }
        kind if !kind.runs() => {
            let joint = robot.dofs[effect.target];
            let joint = &mut robot.joints[joint];
            match (kind, &mut joint.actuator) {
                (Kind::CoulombFriction, _) => joint.passive.friction = v[0],
                (Kind::ViscousFriction, _) => joint.passive.damping = v[0],
                (Kind::Armature, _) => joint.passive.armature = v[0],
                (Kind::TorqueLimit, Some(actuator)) => actuator.torque_limit = v[0],
                (Kind::SpeedTorqueCurve, Some(actuator)) => actuator.speed_limit = v[0],
                _ => {}
            }
            return;
        }
        _ => robot
            .effects
            .retain(|other| (other.kind, other.target) != (effect.kind, effect.target)),
    }
    robot.effects.push(effect.clone());
}

/// Rate of the physics from which on rotors on springs and in gaps move as they do at any higher one, Hz (docs/crosscheck.md has the
/// measurement).
pub const ROTORS_HZ: u32 = 1000;

/// Names of the joints whose motor is a body of its own, behind backlash or elasticity.
pub fn sprung(robot: &Robot) -> Vec<&str> {
    let mut names: Vec<&str> = rotors(robot).map(|d| robot.dof(d).name.as_str()).collect();
    names.dedup();
    names
}

/// Degrees of freedom whose rotor is a body of its own.
fn rotors(robot: &Robot) -> impl Iterator<Item = usize> {
    let transmissions = robot
        .effects
        .iter()
        .filter(|effect| matches!(effect.kind, Kind::Backlash | Kind::Elasticity) && effect.values[0] > 0.0);
    transmissions.map(|effect| effect.target)
}

/// What engines are to know of the joints' passive dynamics: a rotor that backlash or elasticity make a body of its own
/// is no part of the joint.
pub fn engine_passive(robot: &Robot) -> Vec<Passive> {
    let mut passive: Vec<Passive> = robot.joints.iter().map(|joint| joint.passive).collect();
    for d in rotors(robot) {
        passive[robot.dofs[d]].armature = 0.0;
    }
    passive
}

/// What tells from a reading of the encoder of degree of freedom `d` the position (rad or m) at which it says that.
pub fn decoder(robot: &Robot, d: usize) -> impl Fn(f64) -> f64 + use<> {
    let mut sensor = Sensor::default();
    for effect in robot.effects.iter().filter(|effect| effect.target == d) {
        match effect.kind {
            Kind::SensorOffset => sensor.offset = effect.values[0],
            Kind::SensorScale => sensor.scale = effect.values[0],
            _ => {}
        }
    }
    move |reading| sensor.position(reading)
}
