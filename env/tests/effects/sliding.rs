//! Effects on a joint that slides: metres and newtons where one that turns has radians and newton metres.

use omniwalk_env::effect::{self, Effect, Kind, Site};
use omniwalk_env::robot::Robot;

use crate::rig::*;

const MASS: f64 = 0.5;
const WEIGHT: f64 = MASS * 9.81;
const ARMATURE: f64 = 0.2;
const KP: f64 = 400.0;
const KD: f64 = 10.0;

/// A carriage on an upright rail.
fn carriage() -> Robot {
    let urdf = r#"<robot name="rail"><link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="carriage"><inertial><mass value="0.5"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="20" velocity="2"/></joint></robot>"#;
    let toml = format!(
        "base = \"fixed\"\n[[joint]]\nmatch = [\"rail\"]\nkp = {KP:?}\nkd = {KD:?}\ntorque_limit = 20.0\nspeed_limit = 2.0\narmature = {ARMATURE:?}\n"
    );
    load_text(urdf, &toml).expect("a robot")
}

fn swing(t: f64) -> f64 {
    0.08 * (3.0 * t).sin() + 0.03 * (11.0 * t).sin()
}

#[test]
fn every_effect_changes_a_sliding_joint_alike_in_both_engines() {
    let cases: &[(Kind, &[f64])] = &[
        (Kind::CommandDelay, &[0.0205]),
        (Kind::CommandRateLimit, &[0.1]),
        (Kind::CommandDeadBand, &[0.005]),
        (Kind::CommandGain, &[0.9]),
        (Kind::CommandQuantisation, &[0.01]),
        (Kind::SupplyVoltage, &[9.0, 12.0]),
        (Kind::StribeckFriction, &[2.0, 0.03, 0.0]),
        (Kind::StribeckFriction, &[2.0, 0.03, 1e-4]),
        (Kind::LoadDependentFriction, &[0.3, 0.01, 0.2, 0.05]),
        (Kind::DirectionalFriction, &[0.5, 0.2]),
        (Kind::Backlash, &[0.005, 0.0, 0.7]),
        (Kind::Backlash, &[0.005, 1.0, 0.05]),
        (Kind::Elasticity, &[5e-4, 0.0, 0.05]),
        (Kind::Elasticity, &[5e-4, 1.0, 0.05]),
        (Kind::PositionRipple, &[1.0, 0.5, 30.0]),
        (Kind::SensorOffset, &[0.005]),
        (Kind::SensorScale, &[1.1]),
        (Kind::SensorDelay, &[0.0205]),
        (Kind::ExternalForce, &[2.0]),
        (Kind::Mass, &[1.2]),
        (Kind::Payload, &[0.1, 0.0, 0.0, -0.1]),
        (Kind::CoulombFriction, &[1.0]),
        (Kind::ViscousFriction, &[3.0]),
        (Kind::Armature, &[0.5]),
        (Kind::TorqueLimit, &[6.0]),
        (Kind::SpeedTorqueCurve, &[0.3]),
    ];
    every_effect(&carriage(), cases, swing, 0.2);
}

/// Where a carriage is read to rest under a constant target: the servo's force is its weight and what else pulls.
#[test]
fn a_carriage_rests_where_its_forces_in_newtons_say_in_both_engines() {
    let (target, seconds) = (0.05, 6.0);
    let cases: &[(Kind, &[f64], f64)] = &[
        (Kind::CommandGain, &[0.9], 0.9 * target - WEIGHT / KP),
        (Kind::CommandDeadBand, &[0.005], target - 0.005 - WEIGHT / KP),
        (Kind::SupplyVoltage, &[9.0, 12.0], target - WEIGHT / (0.75 * KP)),
        (Kind::ExternalForce, &[2.0], target - (WEIGHT - 2.0) / KP),
        (Kind::Mass, &[1.2], target - 1.2 * WEIGHT / KP),
        (
            Kind::Payload,
            &[0.1, 0.0, 0.0, -0.1],
            target - (WEIGHT + 0.1 * 9.81) / KP,
        ),
        // The servo brings what it reads to where the weight bends it, wherever the carriage is.
        (Kind::SensorOffset, &[0.005], target - WEIGHT / KP),
        (Kind::SensorScale, &[1.1], target - WEIGHT / KP),
        (Kind::Elasticity, &[5e-4, 1.0, 0.05], target - WEIGHT / KP),
        (Kind::Backlash, &[0.005, 1.0, 0.7], target - WEIGHT / KP),
    ];
    for (kind, values, expected) in cases {
        let mut robot = carriage();
        let site = usize::from(kind.info().site == Site::Link);
        effect::apply(&mut robot, &Effect::new(*kind, site, values));
        let mass = robot.links[1].inertial.mass + ARMATURE;
        // A swing dies away with kd / 2 m; it began with less than twice the target. Numbers of this size are rounded.
        let left = 2.0 * target * (-KD / (2.0 * mass) * seconds).exp() + 64.0 * f64::EPSILON;
        for (name, readings) in [
            ("lanes", lanes(&robot, seconds, |_| target)),
            ("rapier", rapier(&robot, seconds, |_| target)),
        ] {
            let q = readings[readings.len() - 1];
            let off = (q - expected).abs();
            assert!(
                off < left,
                "{} in {name}: {q} m, not {expected} m; {left} m left",
                kind.id()
            );
        }
    }
}

#[test]
fn the_place_of_a_sliding_mass_changes_no_bit() {
    let mut robot = carriage();
    let nominal = lanes(&robot, 2.0, swing);
    effect::apply(&mut robot, &Effect::new(Kind::CentreOfMass, 1, &[0.01, 0.0, 0.02]));
    assert_eq!(lanes(&robot, 2.0, swing), nominal);
}

/// Half a newton more forward than backward where there is no other dry friction: half a newton forward, and none backward, which would
/// push.
#[test]
fn friction_of_one_direction_never_drives_a_carriage() {
    let mut robot = carriage();
    effect::apply(&mut robot, &Effect::new(Kind::DirectionalFriction, 0, &[0.5, 0.0]));
    let (speed, seconds) = (0.01, 6.0);
    let mass = robot.links[1].inertial.mass + ARMATURE;
    for (direction, resisted) in [(1.0, 0.5), (-1.0, 0.0)] {
        let velocity = direction * speed;
        for readings in [
            lanes(&robot, seconds, |t| velocity * t),
            rapier(&robot, seconds, |t| velocity * t),
        ] {
            let q = readings[readings.len() - 1];
            // Of the last step's target.
            let expected = velocity * (seconds - DT) - (WEIGHT + resisted + KD * velocity) / KP;
            // A swing dies away as it does at rest.
            let left = 2.0 * WEIGHT / KP * (-KD / (2.0 * mass) * seconds).exp() + 64.0 * f64::EPSILON;
            assert!(
                (q - expected).abs() < left,
                "{direction}: {q} m, not {expected} m; {left} m left"
            );
        }
    }
}
