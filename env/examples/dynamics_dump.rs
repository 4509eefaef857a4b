//! What our model of a robot is and how it accelerates, as JSON for the comparison with another simulator:
//! `cargo run --release -p omniwalk-env --example dynamics_dump ROBOT ENGINE SEED STATES DT [ground]`.
//!
//! A state is a robot in free flight, or with `ground` one whose lowest contact point is 1 mm deep in the ground, with random
//! pose, velocity, joint torques and push. Kinematics and momentum come
//! from [`Kinematics`], the acceleration from the engine as the change of velocity over one step of DT seconds: with
//! explicit forces that is the acceleration at the beginning of the step, however long the step.

mod support;

use std::error::Error;
use std::path::Path;

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};
use omniwalk_env::engine::{Drive, Engine, Friction, Start, World};
use omniwalk_env::robot::{self, Base, Inertial, Kinematics, Robot};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde::Serialize;
use support::make_engine;

/// Gravity of every state, m/s^2: tilted, so that no axis is special.
const GRAVITY: Vector3<f64> = Vector3::new(0.5, -0.3, -9.7);

/// Points up to this height may touch within a step of a few milliseconds, m.
const NEAR: f64 = 0.05;

#[derive(Serialize)]
struct Dump {
    gravity: Vector3<f64>,
    base_pose: Pose,
    links: Vec<Link>,
    /// Names of the degrees of freedom.
    dofs: Vec<String>,
    /// Lower and upper limit of each, rad or m; null where there is none.
    limits: Vec<(f64, f64)>,
    states: Vec<State>,
}

#[derive(Serialize)]
struct Link {
    name: String,
    #[serde(flatten)]
    inertial: InertialRecord,
}

#[derive(Serialize)]
struct InertialRecord {
    mass: f64,
    com: Vector3<f64>,
    /// Rows; the matrix is symmetric.
    inertia: [[f64; 3]; 3],
}

#[derive(Serialize)]
struct Pose {
    position: Vector3<f64>,
    /// w, x, y, z.
    orientation: [f64; 4],
}

/// A state and what follows from it; world frame, SI units, order of [`Dump::dofs`].
#[derive(Serialize)]
struct State {
    base: Pose,
    base_linear_velocity: Vector3<f64>,
    base_angular_velocity: Vector3<f64>,
    positions: Vec<f64>,
    velocities: Vec<f64>,
    torques: Vec<f64>,
    /// Force on the base's origin.
    push: Vector3<f64>,
    link_poses: Vec<Pose>,
    center_of_mass: Vector3<f64>,
    linear_momentum: Vector3<f64>,
    /// About the centre of mass.
    angular_momentum: Vector3<f64>,
    base_linear_acceleration: Vector3<f64>,
    base_angular_acceleration: Vector3<f64>,
    accelerations: Vec<f64>,
    /// Names of the links with a contact point no higher than [`NEAR`].
    near_ground: Vec<String>,
    /// Link and ground force of each foot.
    foot_forces: Vec<(String, Vector3<f64>)>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (arguments, ground) = match arguments.split_last() {
        Some((last, others)) if last == "ground" => (others, true),
        _ => (&arguments[..], false),
    };
    let [path, engine, seed, states, dt] = arguments else {
        return Err("usage: dynamics_dump ROBOT ENGINE SEED STATES DT [ground]".into());
    };
    let robot = robot::load(Path::new(path))?;
    let dt: f64 = dt.parse()?;
    let mut engine = make_engine(engine, &robot, dt)?;
    let mut random = ChaCha12Rng::seed_from_u64(seed.parse()?);
    let count: usize = states.parse()?;
    let states = (0..count)
        .map(|_| state(&robot, engine.as_mut(), dt, ground, &mut random))
        .collect();
    let dump = Dump {
        gravity: GRAVITY,
        base_pose: pose(&robot.base_pose),
        links: robot
            .links
            .iter()
            .map(|l| Link {
                name: l.name.clone(),
                inertial: record(&l.inertial),
            })
            .collect(),
        dofs: (0..robot.dofs.len()).map(|d| robot.dof(d).name.clone()).collect(),
        limits: (0..robot.dofs.len()).map(|d| robot.limits(d)).collect(),
        states,
    };
    println!("{}", serde_json::to_string(&dump)?);
    Ok(())
}

/// A random state, its kinematics, and the acceleration the engine finds for it.
fn state(robot: &Robot, engine: &mut dyn Engine, dt: f64, ground: bool, random: &mut impl Rng) -> State {
    let mut start = random_start(robot, random);
    if ground {
        let lowest = contact_heights(robot, &start)
            .map(|(_, height)| height)
            .reduce(f64::min);
        start.position.z -= lowest.expect("a robot with contact points") + 1e-3;
    }
    let near = contact_heights(robot, &start).filter(|&(_, height)| height <= NEAR);
    let mut near_ground: Vec<String> = near.map(|(link, _)| robot.links[link].name.clone()).collect();
    near_ground.dedup();
    let torques: Vec<f64> = (0..robot.dofs.len()).map(|_| random.random_range(-5.0..5.0)).collect();
    let push = match robot.base {
        Base::Floating => random_vector(random, 20.0),
        Base::Fixed => Vector3::zeros(),
    };
    engine.reset(0, &start, &world(robot, ground));
    engine.push(0, push);
    let mut drive = Drive::idle(robot.dofs.len(), 1);
    drive.feed_forward.copy_from_slice(&torques);
    drive.torque_min.fill(-1e9);
    drive.torque_max.fill(1e9);
    engine.step(&drive);
    let (after, joints) = (engine.base(0), engine.joints());
    let rate = |new: Vector3<f64>, old: Vector3<f64>| (new - old) / dt;
    let momentum = Momentum::new(robot, &start);
    State {
        base: Pose {
            position: start.position,
            orientation: wxyz(&start.orientation),
        },
        base_linear_velocity: start.linear_velocity,
        base_angular_velocity: start.angular_velocity,
        base_linear_acceleration: rate(after.linear_velocity, start.linear_velocity),
        base_angular_acceleration: rate(after.angular_velocity, start.angular_velocity),
        accelerations: joints
            .velocity
            .iter()
            .zip(&start.joint_velocities)
            .map(|(new, old)| (new - old) / dt)
            .collect(),
        near_ground,
        foot_forces: (0..robot.feet.len())
            .map(|f| (robot.links[robot.feet[f].link].name.clone(), engine.foot_force(0, f)))
            .collect(),
        positions: start.joints,
        velocities: start.joint_velocities,
        torques,
        push,
        link_poses: momentum.poses,
        center_of_mass: momentum.center.coords,
        linear_momentum: momentum.linear,
        angular_momentum: momentum.angular,
    }
}

/// The robot's contact points: link and height above the ground, m.
fn contact_heights<'r>(robot: &'r Robot, start: &Start) -> impl Iterator<Item = (usize, f64)> + use<'r> {
    let mut kinematics = Kinematics::new(robot);
    let base = Isometry3::from_parts(start.position.into(), start.orientation);
    kinematics.set_pose(robot, &base, &start.joints);
    robot.links.iter().enumerate().flat_map(move |(index, link)| {
        let pose = *kinematics.pose(index);
        link.contact_points.iter().map(move |point| (index, (pose * point).z))
    })
}

/// Any orientation, joints in the middle eight tenths of their range: limits do not act.
fn random_start(robot: &Robot, random: &mut impl Rng) -> Start {
    let joint = |d: usize, random: &mut dyn Rng| {
        let (lower, upper) = robot.limits(d);
        let (lower, upper) = (lower.max(-1.0), upper.min(1.0));
        let share = random.random_range(0.1..0.9);
        lower + share * (upper - lower)
    };
    let floating = f64::from(u8::from(robot.base == Base::Floating));
    let quaternion = Quaternion::from(nalgebra::Vector4::from_fn(|_, _| random.random_range(-1.0..1.0)));
    let (position, orientation) = match robot.base {
        Base::Floating => (
            random_vector(random, 1.0) + Vector3::z() * 5.0,
            UnitQuaternion::from_quaternion(quaternion),
        ),
        Base::Fixed => (robot.base_pose.translation.vector, robot.base_pose.rotation),
    };
    Start {
        position,
        orientation,
        linear_velocity: random_vector(random, 1.0) * floating,
        angular_velocity: random_vector(random, 2.0) * floating,
        joints: (0..robot.dofs.len()).map(|d| joint(d, random)).collect(),
        joint_velocities: (0..robot.dofs.len()).map(|_| random.random_range(-2.0..2.0)).collect(),
    }
}

fn random_vector(random: &mut impl Rng, bound: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.random_range(-bound..bound))
}

/// The robot's own masses and armatures, without any friction or damping in the joints; with friction on the `ground`.
fn world(robot: &Robot, ground: bool) -> World {
    let grip = f64::from(u8::from(ground));
    World {
        friction: Friction {
            tangential: 0.8 * grip,
            torsional: 0.1 * grip,
            rolling: 0.05 * grip,
        },
        gravity: GRAVITY,
        links: robot.links.iter().map(|link| link.inertial).collect(),
        joints: robot
            .joints
            .iter()
            .map(|j| robot::Passive {
                damping: 0.0,
                friction: 0.0,
                ..j.passive
            })
            .collect(),
    }
}

/// Link poses, centre of mass and momentum of all links together (without the rotors that armature stands for).
struct Momentum {
    poses: Vec<Pose>,
    center: Point3<f64>,
    linear: Vector3<f64>,
    angular: Vector3<f64>,
}

impl Momentum {
    fn new(robot: &Robot, start: &Start) -> Self {
        let mut kinematics = Kinematics::new(robot);
        let base = Isometry3::from_parts(start.position.into(), start.orientation);
        kinematics.set_pose(robot, &base, &start.joints);
        kinematics.set_velocity(
            robot,
            &start.linear_velocity,
            &start.angular_velocity,
            &start.joint_velocities,
        );
        let center = kinematics.center_of_mass(robot.links.iter().map(|link| &link.inertial));
        let (linear, angular) = kinematics.momentum(robot);
        let poses = (0..robot.links.len())
            .map(|index| pose(kinematics.pose(index)))
            .collect();
        Self {
            poses,
            center,
            linear,
            angular,
        }
    }
}

fn pose(pose: &Isometry3<f64>) -> Pose {
    Pose {
        position: pose.translation.vector,
        orientation: wxyz(&pose.rotation),
    }
}

fn wxyz(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    [rotation.w, rotation.i, rotation.j, rotation.k]
}

fn record(inertial: &Inertial) -> InertialRecord {
    InertialRecord {
        mass: inertial.mass,
        com: inertial.com,
        inertia: inertial.inertia.into(),
    }
}
