//! An arm that hangs from a fixed base, its motion under effects in either engine, and what every effect has to do.

use omniwalk_env::actuators::Actuators;
use omniwalk_env::effect::{self, Effect, Kind, Site};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Engine, Friction, Start, World};
use omniwalk_env::robot::{self, Robot};

use crate::motion::{Motion, distance, extrapolated};

pub const DT: f64 = 1e-3;
/// Of the rig: 0.5 kg at 0.1 m.
pub const GRAVITY_TORQUE: f64 = 0.5 * 9.81 * 0.1;
/// Of the arm about the hinge, without the rotor, kg m^2.
pub const INERTIA: f64 = 0.5 * 0.1 * 0.1 + 1e-5;

const URDF: &str = r#"<robot name="rig"><link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
const TOML: &str = "base = \"fixed\"\n[[joint]]\nmatch = [\"hinge\"]\nkp = 4.0\nkd = 0.1\ntorque_limit = 2.0\nspeed_limit = 20.0\narmature = 0.002\n";

/// The rig with more in its `robot.toml`.
pub fn load(toml: &str) -> Result<Robot, robot::RobotError> {
    load_text(URDF, &format!("{TOML}{toml}"))
}

/// The robot of a URDF and a `robot.toml`.
pub fn load_text(urdf: &str, toml: &str) -> Result<Robot, robot::RobotError> {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("rig.urdf"), urdf).expect("written");
    std::fs::write(folder.path().join("robot.toml"), toml).expect("written");
    robot::load(folder.path())
}

/// The rig with effects on its one joint.
pub fn rig(effects: &[(Kind, &[f64])]) -> Robot {
    let mut robot = load("").expect("a robot");
    for (kind, values) in effects {
        effect::apply(&mut robot, &Effect::new(*kind, 0, values));
    }
    robot
}

/// Readings of `seconds` in steps of `dt` under `target(t)` from rest at zero.
pub fn run(robot: &Robot, engine: &mut dyn Engine, dt: f64, seconds: f64, target: impl Fn(f64) -> f64) -> Vec<f64> {
    let reading = |actuators: &Actuators, engine: &dyn Engine| actuators.read(0, 0, &engine.joints().position);
    run_seeing(robot, engine, dt, seconds, target, reading)
}

/// Where the arm is in lanes at [`DT`], whatever its encoder says.
pub fn arm(robot: &Robot, seconds: f64, target: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut engine = Lanes::new(robot, DT, 1, Simd::Scalar).expect("an engine");
    let place = |_: &Actuators, engine: &dyn Engine| engine.joints().position[0];
    run_seeing(robot, &mut engine, DT, seconds, target, place)
}

/// As [`run`], what is `seen` of each step.
fn run_seeing(
    robot: &Robot,
    engine: &mut dyn Engine,
    dt: f64,
    seconds: f64,
    target: impl Fn(f64) -> f64,
    seen: impl Fn(&Actuators, &dyn Engine) -> f64,
) -> Vec<f64> {
    let mut actuators = Actuators::new(robot, dt, 1);
    let ground = Friction {
        tangential: 1.0,
        torsional: 0.0,
        rolling: 0.0,
    };
    let world = World::nominal(robot, ground);
    engine.reset(0, &Start::nominal(robot), &world);
    actuators.start(0, 0, (0.0, 0.0), 0.0);
    let steps = (seconds / dt).round() as usize;
    let step = |k: usize| {
        actuators.set_target(0, 0, target(k as f64 * dt));
        engine.step(actuators.drive(engine.joints()));
        actuators.sense(engine.joints());
        seen(&actuators, engine)
    };
    (0..steps).map(step).collect()
}

/// Readings in lanes at [`DT`].
pub fn lanes(robot: &Robot, seconds: f64, target: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut engine = Lanes::new(robot, DT, 1, Simd::Scalar).expect("an engine");
    run(robot, &mut engine, DT, seconds, target)
}

/// Readings in rapier at [`DT`].
pub fn rapier(robot: &Robot, seconds: f64, target: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut engine = Rapier::new(robot, DT, 1).expect("an engine");
    run(robot, &mut engine, DT, seconds, target)
}

pub fn swing(t: f64) -> f64 {
    0.8 * (3.0 * t).sin() + 0.3 * (11.0 * t).sin()
}

/// Every millisecond of a motion in steps of a millisecond and of its half and its quarter.
struct Halved {
    coarse: Motion,
    middle: Motion,
    fine: Motion,
}

impl Halved {
    fn new(robot: &Robot, seconds: f64, target: fn(f64) -> f64, engine: fn(&Robot, f64) -> Box<dyn Engine>) -> Self {
        let [coarse, middle, fine] = [1, 2, 4].map(|parts| {
            let dt = DT / parts as f64;
            let readings = run(robot, &mut *engine(robot, dt), dt, seconds, target);
            readings.into_iter().skip(parts - 1).step_by(parts).collect()
        });
        Self { coarse, middle, fine }
    }

    /// What the motion is without a step, and how well that is known: an error of second order is a third of what halving both
    /// steps changes.
    fn extrapolated(&self) -> (Motion, f64) {
        let first = extrapolated(&self.coarse, &self.middle);
        let second = extrapolated(&self.middle, &self.fine);
        let known = distance(&first, &second);
        (second, known)
    }

    /// How far the finest motion may be from the one without a step: an error of first order is what the last halving has changed,
    /// one of second order is within what is not known of the extrapolation.
    fn error(&self) -> f64 {
        distance(&self.middle, &self.fine) + self.extrapolated().1
    }
}

/// Asserts that each of `cases` on the robot's one joint, or its moving link, changes its motion under `target` by more than
/// is known of it, stays within `bound`, and moves alike in both engines.
pub fn every_effect(robot: &Robot, cases: &[(Kind, &[f64])], target: fn(f64) -> f64, bound: f64) {
    let seconds = 2.0;
    let in_lanes =
        |robot: &Robot, dt| -> Box<dyn Engine> { Box::new(Lanes::new(robot, dt, 1, Simd::Scalar).expect("an engine")) };
    let in_rapier = |robot: &Robot, dt| -> Box<dyn Engine> { Box::new(Rapier::new(robot, dt, 1).expect("an engine")) };
    let (nominal, nominal_known) = Halved::new(robot, seconds, target, in_lanes).extrapolated();
    for (kind, values) in cases {
        let mut robot = robot.clone();
        let site = usize::from(kind.info().site == Site::Link);
        effect::apply(&mut robot, &Effect::new(*kind, site, values));
        let own = Halved::new(&robot, seconds, target, in_lanes);
        let (moved, known) = own.extrapolated();
        let (change, unknown) = (distance(&moved, &nominal), known + nominal_known);
        assert!(
            change > unknown,
            "{} does nothing: {change}, {unknown} unknown",
            kind.id()
        );
        assert!(own.fine.iter().all(|q| q.abs() < bound), "{} runs away", kind.id());
        let beside = Halved::new(&robot, seconds, target, in_rapier);
        let (apart, error) = (distance(&own.fine, &beside.fine), own.error() + beside.error());
        assert!(apart < error, "{}: {apart} apart, {error} by the step", kind.id());
    }
}
