//! The equation of motion of the engines against MuJoCo's, at random states.
//!
//! With `qvel = G v` for the couplings, an engine's accelerations a must satisfy `G'MG a + G'c = f` with MuJoCo's mass matrix M
//! (armature included) and bias force c. Every component of a residual is held against the sum of the magnitudes of what it is
//! made of. Without any torque the equation checks c; the change that random torques and a random push make checks M.

use miette::miette;
use nalgebra::{Quaternion, UnitQuaternion, Vector3, Vector4};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::{self, Rapier};
use omniwalk_env::engine::{Drive, Engine, EngineError, Friction, Start, World};
use omniwalk_env::random::Stream;
use omniwalk_env::robot::{Base, Passive, Robot};

use super::check::Check;
use super::engine::{Mujoco, Special, Workshop};
use super::momentum;
use super::network::largest;
use super::process::{bytes, numbers};

const STATES: u64 = 200;
/// Relative; what the project promises of rapier and of lanes in double precision, and of lanes in single precision.
pub const DOUBLE: f64 = 1e-6;
const SINGLE: f64 = 1e-4;
/// Tilted, so that no axis is special, m/s^2.
const GRAVITY: [f64; 3] = [0.5, -0.3, -9.7];

/// A state, and forces to move it.
pub struct Case {
    /// The state.
    pub start: Start,
    /// Torques of the degrees of freedom, and a force on the base.
    torques: Vec<f64>,
    push: Vector3<f64>,
}

/// Largest relative residuals over the states.
#[derive(Clone, Copy, Debug, Default)]
struct Residual {
    mass: f64,
    bias: f64,
}

/// Accelerations of the base (linear, angular) and the degrees of freedom under a force.
type Accelerate<'a> = dyn FnMut(&Case, f64) -> miette::Result<Vec<f64>> + 'a;

/// The checks of every engine against MuJoCo.
///
/// # Errors
/// When an engine or MuJoCo does not take the robot.
pub fn checks(robot: &Robot, workshop: &Workshop) -> miette::Result<Vec<Check>> {
    let mut reference = worlds(workshop, robot, Special::default())?;
    let cases: Vec<Case> = (0..STATES).map(|k| case(robot, k)).collect();
    let mut checks = momentum::kinematics(robot, &cases, &mut reference)?;
    let mut lanes = |name: &str, level: Simd, dt: f64, bound: f64| -> miette::Result<()> {
        let make = |dt| Lanes::new(robot, dt, 1, level).map_err(refused);
        let mut engine = make(dt)?;
        checks.extend(if bound > DOUBLE {
            momentum::velocities(name, robot, &cases, &mut reference, &mut engine, bound)?
        } else {
            momentum::moves(name, robot, &cases, &mut reference, &|dt| Ok(Box::new(make(dt)?)))?
        });
        let found = residual(robot, &cases, &mut reference, &mut |case, share| {
            Ok(acceleration(robot, &mut engine, case, share, dt))
        })?;
        checks.extend(both(name, found, bound));
        Ok(())
    };
    // A velocity of some rad/s is known to 1e-15, so its change over 1 ms to 1e-12 of an acceleration of one; in single precision
    // it is known to 3e-7, so its change over 5 ms to 6e-5.
    lanes("lanes f64", Simd::Scalar, 0.001, DOUBLE)?;
    if Simd::F32x8.is_available() {
        lanes("lanes f32", Simd::F32x8, 0.005, SINGLE)?;
    }
    // Rapier solves couplings by a few sweeps a step, so that they are in its motion but not in its accelerations.
    let free = uncoupled(robot);
    let special = Special {
        without: &["couplings"],
        ..Special::default()
    };
    let mut reference = worlds(workshop, &free, special)?;
    let cases: Vec<Case> = (0..STATES).map(|k| case(&free, k)).collect();
    let make = |dt| -> miette::Result<Box<dyn Engine>> { Ok(Box::new(Rapier::new(&free, dt, 1).map_err(refused)?)) };
    let name = "rapier, couplings left out";
    checks.extend(momentum::moves(name, &free, &cases, &mut reference, &make)?);
    let found = residual(&free, &cases, &mut reference, &mut |case, share| {
        extrapolated(&mut |dt| Ok(acceleration(&free, &mut *make(dt)?, case, share, dt)))
    })?;
    checks.extend(both(name, found, DOUBLE));
    Ok(checks)
}

fn both(name: &str, found: Residual, bound: f64) -> [Check; 2] {
    [
        Check::new(format!("{name}: mass matrix, relative"), found.mass, bound),
        Check::new(format!("{name}: bias forces, relative"), found.bias, bound),
    ]
}

fn worlds(workshop: &Workshop, robot: &Robot, special: Special) -> miette::Result<Mujoco> {
    let made = workshop.worlds(robot, 0.001, 1, special);
    made.map_err(|why| miette!("{why}"))
}

fn refused(error: EngineError) -> miette::Report {
    miette!("{error}")
}

/// The robot as rapier steps it: links without mass have some.
pub fn weighed(robot: &Robot) -> Robot {
    let mut robot = robot.clone();
    for link in &mut robot.links {
        link.inertial = rapier::weighed(&link.inertial);
    }
    robot
}

/// The same with every joint free that follows another, and without effects.
fn uncoupled(robot: &Robot) -> Robot {
    let mut free = weighed(robot);
    free.effects.clear();
    free.policy = robot.policy.iter().map(|&d| robot.dofs[d]).collect();
    free.dofs = (0..robot.joints.len()).collect();
    free.joints.iter_mut().for_each(|joint| joint.mimic = None);
    free
}

/// Any orientation, and joints in the middle eight tenths of their range, so that limits do not act.
fn case(robot: &Robot, index: u64) -> Case {
    let mut stream = Stream::new(1, index, 0);
    let floating = robot.base == Base::Floating;
    let mut vector = |bound: f64| Vector3::from_fn(|_, _| stream.uniform(-bound, bound));
    let (position, linear, angular, push) = (vector(1.0) + Vector3::z() * 5.0, vector(1.0), vector(2.0), vector(20.0));
    let quaternion = Quaternion::from(Vector4::from_fn(|_, _| stream.uniform(-1.0, 1.0)));
    let joints = (0..robot.dofs.len()).map(|d| {
        let (lower, upper) = robot.dof(d).limits;
        let (lower, upper) = (lower.max(-1.0), upper.min(1.0));
        lower + stream.uniform(0.1, 0.9) * (upper - lower)
    });
    let mut start = Start::nominal(robot);
    start.joints = joints.collect();
    start.joint_velocities.fill_with(|| stream.uniform(-2.0, 2.0));
    if floating {
        (start.position, start.orientation) = (position, UnitQuaternion::from_quaternion(quaternion));
        (start.linear_velocity, start.angular_velocity) = (linear, angular);
    }
    Case {
        start,
        torques: (0..robot.dofs.len()).map(|_| stream.uniform(-5.0, 5.0)).collect(),
        push: if floating { push } else { Vector3::zeros() },
    }
}

/// The robot's masses and armatures without any friction or damping.
pub fn frictionless(robot: &Robot) -> World {
    let nothing = Friction {
        tangential: 0.0,
        torsional: 0.0,
        rolling: 0.0,
    };
    let joints = robot.joints.iter().map(|joint| Passive {
        armature: joint.passive.armature,
        ..Passive::default()
    });
    World {
        gravity: Vector3::from(GRAVITY),
        joints: joints.collect(),
        ..World::nominal(robot, nothing)
    }
}

/// The change of velocity over one step of `dt` s under `share` of the case's forces, over that time: with explicit forces that is
/// the acceleration at the beginning of the step.
fn acceleration(robot: &Robot, engine: &mut dyn Engine, case: &Case, share: f64, dt: f64) -> Vec<f64> {
    let start = &case.start;
    engine.reset(0, start, &frictionless(robot));
    // From the state as the engine has it, which may be rounded.
    let (base, before) = (engine.base(0), engine.joints().velocity.clone());
    engine.push(0, share * case.push);
    let mut drive = Drive::idle(robot.dofs.len(), 1);
    for (to, torque) in drive.feed_forward.iter_mut().zip(&case.torques) {
        *to = share * torque;
    }
    drive.torque_min.fill(-1e9);
    drive.torque_max.fill(1e9);
    engine.step(&drive);
    let after = engine.base(0);
    let change = (after.linear_velocity - base.linear_velocity)
        .iter()
        .copied()
        .collect::<Vec<_>>();
    let turn = (after.angular_velocity - base.angular_velocity)
        .iter()
        .copied()
        .collect::<Vec<_>>();
    let floating = robot.base == Base::Floating;
    let joints = engine.joints().velocity.iter().zip(&before).map(|(new, old)| new - old);
    let base = change.into_iter().chain(turn).filter(|_| floating);
    base.chain(joints).map(|change| change / dt).collect()
}

/// What `of` finds with a step, without one. Rapier takes velocity products implicitly, so its accelerations are off by a series in
/// the step, as velocities are that are differences of positions: from three steps, each half the one before, the first two terms go.
pub fn extrapolated(of: &mut dyn FnMut(f64) -> miette::Result<Vec<f64>>) -> miette::Result<Vec<f64>> {
    let [whole, half, quarter] = [of(2e-4)?, of(1e-4)?, of(5e-5)?];
    let terms = whole.iter().zip(&half).zip(&quarter);
    Ok(terms
        .map(|((whole, half), quarter)| (8.0 * quarter - 6.0 * half + whole) / 3.0)
        .collect())
}

/// The residuals over `cases` of what `accelerate` finds under a share of each case's forces.
fn residual(
    robot: &Robot,
    cases: &[Case],
    reference: &mut Mujoco,
    accelerate: &mut Accelerate<'_>,
) -> miette::Result<Residual> {
    let mut worst = Residual::default();
    for case in cases {
        let (still, moved) = (accelerate(case, 0.0)?, accelerate(case, 1.0)?);
        let change: Vec<f64> = moved.iter().zip(&still).map(|(a, b)| a - b).collect();
        let n = still.len();
        let rows: Vec<f64> = still.into_iter().chain(change).collect();
        let found = equation(robot, case, reference, &rows)?;
        let [products, magnitudes] = [&found[9..9 + 2 * n], &found[9 + 2 * n..9 + 4 * n]];
        let bias = &found[9 + 4 * n..];
        let base = case.push.iter().copied().chain([0.0; 3]);
        let forces = base
            .filter(|_| robot.base == Base::Floating)
            .chain(case.torques.iter().copied());
        for (i, force) in forces.enumerate() {
            let of_bias = (products[i] + bias[i]).abs() / (magnitudes[i] + bias[i].abs());
            let of_mass = (products[n + i] - force).abs() / (magnitudes[n + i] + force.abs());
            worst.bias = largest(worst.bias, of_bias);
            worst.mass = largest(worst.mass, of_mass);
        }
    }
    Ok(worst)
}

/// What MuJoCo says of a case for rows of accelerations, see `dynamics.of` in Python.
pub fn equation(robot: &Robot, case: &Case, reference: &mut Mujoco, rows: &[f64]) -> miette::Result<Vec<f64>> {
    reference.reset(0, &case.start, &frictionless(robot));
    let asked = reference.ask(b'd', &bytes(rows)).map(|reply| numbers(reply).collect());
    asked.map_err(|why| miette!("MuJoCo: {why}"))
}
