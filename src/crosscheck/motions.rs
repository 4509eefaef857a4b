//! Motions without a policy, in the engines and in MuJoCo.
//!
//! Every program has an error in proportion to its step. Twice the motion of half a step less that of a whole one leaves an
//! error of second order, of which three quarters go when both steps are halved again: what the last halving changes is
//! three times what is left. So two programs that mean the same robot must agree, extrapolated to no step, within the sum of
//! those changes, whatever integrators they have. The contacts of `lanes` are springs and dampers by design; here they harden
//! as the step shortens, as MuJoCo's and rapier's do.

use miette::miette;
use nalgebra::{UnitQuaternion, Vector3};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, EngineError, Friction, Start, World};
use omniwalk_env::random::Stream;
use omniwalk_env::robot::{Base, Robot, STAND};

use super::check::Check;
use super::dynamics::weighed;
use super::engine::{Special, Workshop};
use super::network::largest;

/// Steps, each half the one before, s.
const STEPS: [f64; 3] = [0.001, 0.0005, 0.00025];
/// Between samples, s.
const INTERVAL: f64 = 0.01;
/// Height of the start of the free flight, m.
const FLIGHT: f64 = 8.0;
/// Height of the drop, m.
const DROP: f64 = 0.02;
/// Of the chirps and of the offset that the joints are held against, rad or m.
const AMPLITUDE: f64 = 0.15;

/// In the engines of the project nothing touches but robot and ground.
const LEGS: &[&str] = &["legs"];
const PLAIN: Special = Special {
    stand: None,
    without: LEGS,
};

/// A motion of as many worlds as it takes.
struct Motion {
    name: &'static str,
    robot: Robot,
    special: Special,
    starts: Vec<Start>,
    seconds: f64,
    /// Target of a degree of freedom in a world at a time; without one motors are off.
    target: Option<Target>,
}

/// Of the robot: the target of degree of freedom `d` in world `w` at time `t`.
type Target = fn(robot: &Robot, d: usize, w: usize, t: f64) -> f64;

/// Samples by time: positions of the degrees of freedom of every world, and of the bases that float.
type Samples = Vec<Vec<f64>>;

/// The checks of every motion in both engines against MuJoCo.
///
/// # Errors
/// When an engine or MuJoCo does not take the robot.
pub fn checks(robot: &Robot, workshop: &Workshop) -> miette::Result<Vec<Check>> {
    let mut checks = Vec::new();
    // All of them move the robot that rapier can: it gives links without mass some, which matters to small robots.
    for motion in motions(&weighed(robot)) {
        let of = |make: &mut dyn FnMut(f64) -> miette::Result<Box<dyn Engine>>| -> miette::Result<(Samples, f64)> {
            let runs = STEPS.map(|dt| make(dt).map(|mut engine| run(&motion, &mut *engine, dt)));
            let [coarse, middle, fine] = runs;
            Ok(extrapolated(&coarse?, &middle?, &fine?))
        };
        let (robot, worlds) = (&motion.robot, motion.starts.len());
        let theirs = of(&mut |dt| {
            let made = workshop.worlds(robot, dt, worlds, motion.special);
            Ok(Box::new(made.map_err(|why| miette!("{why}"))?))
        })?;
        workshop.check()?;
        let refused = |error: EngineError| miette!("{error}");
        let lanes = of(&mut |dt| {
            let mut lanes = Lanes::new(robot, dt, worlds, Simd::Scalar).map_err(refused)?;
            lanes.harden(STEPS[0] / dt);
            Ok(Box::new(lanes))
        })?;
        let rapier = of(&mut |dt| Ok(Box::new(Rapier::new(robot, dt, worlds).map_err(refused)?)))?;
        for (name, ours) in [("lanes", lanes), ("rapier", rapier)] {
            let (found, bound) = (distance(&ours.0, &theirs.0), ours.1 + theirs.1);
            let name = format!("{name}: {}, rad or m", motion.name);
            checks.push(Check::new(name, found, bound));
        }
    }
    Ok(checks)
}

/// The motions of a robot; one that is bolted down has fewer.
fn motions(robot: &Robot) -> Vec<Motion> {
    let floating = robot.base == Base::Floating;
    let (stand, special) = if floating {
        on_a_stand(robot)
    } else {
        (robot.clone(), Special::default())
    };
    let powered = |robot: &Robot| {
        (0..robot.dofs.len())
            .filter(|&d| robot.dof(d).actuator.is_some())
            .count()
    };
    let mut pulled = Start::nominal(&stand);
    for (d, position) in pulled.joints.iter_mut().enumerate() {
        let (lower, upper) = stand.dof(d).limits;
        // Into whichever side has room.
        *position = if *position + AMPLITUDE < upper {
            *position + AMPLITUDE
        } else {
            (*position - AMPLITUDE).max(lower)
        };
    }
    let mut motions = vec![
        Motion {
            name: "released off its pose on a stand",
            starts: vec![pulled],
            seconds: 0.5,
            target: Some(|robot, d, _, _| robot.dof(d).nominal),
            robot: stand.clone(),
            special,
        },
        Motion {
            name: "each joint follows a chirp on a stand",
            starts: vec![Start::nominal(&stand); powered(&stand).max(1)],
            seconds: 0.5,
            target: Some(chirp),
            robot: stand,
            special,
        },
    ];
    if floating {
        motions.insert(0, flight(robot));
        let mut above = Start::nominal(robot);
        above.position.z += DROP;
        motions.push(Motion {
            name: "dropped from 2 cm",
            robot: robot.clone(),
            special: PLAIN,
            starts: vec![above],
            seconds: 0.5,
            target: Some(|robot, d, _, _| robot.dof(d).nominal),
        });
    }
    motions
}

/// Tumbling without motors for a second; joints have no limits, at which programs differ.
fn flight(robot: &Robot) -> Motion {
    let mut stream = Stream::new(3, 0, 0);
    let mut free = robot.clone();
    free.joints
        .iter_mut()
        .for_each(|joint| joint.limits = (f64::NEG_INFINITY, f64::INFINITY));
    let mut start = Start::nominal(robot);
    start.position.z += FLIGHT;
    start.orientation = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.5);
    let mut vector = |bound: f64| Vector3::from_fn(|_, _| stream.uniform(-bound, bound));
    (start.linear_velocity, start.angular_velocity) = (vector(1.0), vector(1.0));
    start.joint_velocities.fill_with(|| stream.uniform(-1.0, 1.0));
    Motion {
        name: "free flight of a second",
        robot: free,
        special: Special {
            without: &["limits", "legs"],
            ..Special::default()
        },
        starts: vec![start],
        seconds: 1.0,
        target: None,
    }
}

/// The robot bolted to a stand.
fn on_a_stand(robot: &Robot) -> (Robot, Special) {
    let stand = robot.on_a_stand();
    let special = Special {
        stand: Some([0.0, 0.0, STAND]),
        without: LEGS,
    };
    (stand, special)
}

/// World w moves its motor number w from 0.5 to 3.5 Hz; the others hold.
fn chirp(robot: &Robot, d: usize, w: usize, t: f64) -> f64 {
    let number = (0..d).filter(|&d| robot.dof(d).actuator.is_some()).count();
    let joint = robot.dof(d);
    if number != w {
        return joint.nominal;
    }
    let (lower, upper) = joint.limits;
    let side = if joint.nominal + AMPLITUDE < upper || joint.nominal - AMPLITUDE < lower {
        1.0
    } else {
        -1.0
    };
    joint.nominal + side * AMPLITUDE * ((3.0 + 18.0 * t) * t).sin()
}

/// Plays a motion with steps of `dt` s.
fn run(motion: &Motion, engine: &mut dyn Engine, dt: f64) -> Samples {
    let (robot, worlds) = (&motion.robot, motion.starts.len());
    let friction = Friction {
        tangential: 0.6,
        torsional: 0.2,
        rolling: 0.1,
    };
    for (world, start) in motion.starts.iter().enumerate() {
        engine.reset(world, start, &World::nominal(robot, friction));
    }
    let mut drive = Drive::idle(robot.dofs.len(), worlds);
    let every = (INTERVAL / dt).round() as usize;
    let mut samples = Vec::new();
    for step in 0..(motion.seconds / dt).round() as usize {
        if let Some(target) = motion.target {
            command(&mut drive, robot, worlds, |d, w| target(robot, d, w, step as f64 * dt));
        }
        engine.step(&drive);
        if (step + 1).is_multiple_of(every) {
            let mut sample = engine.joints().position.clone();
            if robot.base == Base::Floating {
                sample.extend((0..worlds).flat_map(|w| engine.base(w).position.iter().copied().collect::<Vec<_>>()));
            }
            samples.push(sample);
        }
    }
    samples
}

fn command(drive: &mut Drive, robot: &Robot, worlds: usize, target: impl Fn(usize, usize) -> f64) {
    for d in 0..robot.dofs.len() {
        let joint = robot.dof(d);
        let Some(motor) = joint.actuator else { continue };
        for w in 0..worlds {
            let k = d * worlds + w;
            drive.target[k] = target(d, w);
            (drive.stiffness[k], drive.damping[k]) = (motor.stiffness(), motor.kd);
            (drive.torque_min[k], drive.torque_max[k]) = (-motor.torque_limit, motor.torque_limit);
            drive.friction[k] = joint.passive.friction;
        }
    }
}

/// The motion without a step, and what the last halving changed of it.
fn extrapolated(coarse: &Samples, middle: &Samples, fine: &Samples) -> (Samples, f64) {
    let twice = |whole: &Samples, half: &Samples| -> Samples {
        let rows = whole.iter().zip(half);
        rows.map(|(whole, half)| whole.iter().zip(half).map(|(w, h)| 2.0 * h - w).collect())
            .collect()
    };
    let (first, second) = (twice(coarse, middle), twice(middle, fine));
    let change = distance(&first, &second);
    (second, change)
}

/// The largest difference.
fn distance(a: &Samples, b: &Samples) -> f64 {
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a.iter().zip(b));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, largest)
}
