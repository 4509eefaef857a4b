//! Centre of mass and momentum against MuJoCo's, at random states: by this project's kinematics, which environments and estimators
//! go by, and by where an engine has its links and how it moves them.

use nalgebra::{Isometry3, IsometryMatrix3, Point3, Vector3};
use omniwalk_env::engine::lanes::Lanes;
use omniwalk_env::engine::{Drive, Engine};
use omniwalk_env::robot::{Kinematics, Link, Robot};

use super::check::Check;
use super::dynamics::{Case, DOUBLE, equation, extrapolated, frictionless};
use super::engine::Mujoco;
use super::network::largest;

const NAMES: [&str; 3] = ["centre of mass", "linear momentum", "angular momentum"];

/// Makes an engine with a step, s.
type Make<'a> = dyn Fn(f64) -> miette::Result<Box<dyn Engine>> + 'a;

/// By the kinematics.
///
/// # Errors
/// When MuJoCo does not answer.
pub fn kinematics(robot: &Robot, cases: &[Case], reference: &mut Mujoco) -> miette::Result<Vec<Check>> {
    let mut kinematics = Kinematics::new(robot);
    let mut worst = vec![0.0; NAMES.len()];
    for case in cases {
        let start = &case.start;
        kinematics.set_pose(
            robot,
            &Isometry3::from_parts(start.position.into(), start.orientation),
            &start.joints,
        );
        let (linear, angular) = (&start.linear_velocity, &start.angular_velocity);
        kinematics.set_velocity(robot, linear, angular, &start.joint_velocities);
        let (linear, angular) = kinematics.momentum(robot);
        let center = kinematics
            .center_of_mass(robot.links.iter().map(|link| &link.inertial))
            .coords;
        compare(
            &mut worst,
            &[center, linear, angular],
            &equation(robot, case, reference, &[])?,
        );
    }
    Ok(named("kinematics", &worst, DOUBLE))
}

/// By the links of the engine that `make` makes: where they are after a reset, and how they move from there.
///
/// # Errors
/// When the engine cannot be made or MuJoCo does not answer.
pub fn moves(
    name: &str,
    robot: &Robot,
    cases: &[Case],
    reference: &mut Mujoco,
    make: &Make<'_>,
) -> miette::Result<Vec<Check>> {
    let mut still = make(1e-3)?;
    let found = worst(robot, cases, reference, &mut |case| {
        let begin = poses(robot, &mut *still, case);
        let twists = extrapolated(&mut |dt| Ok(twists(robot, &mut *make(dt)?, case, dt)))?;
        Ok((begin, twists))
    })?;
    Ok(named(name, &found, DOUBLE))
}

/// By the velocities that `lanes` steps its links with: single precision knows positions too coarsely for their differences.
///
/// # Errors
/// When MuJoCo does not answer.
pub fn velocities(
    name: &str,
    robot: &Robot,
    cases: &[Case],
    reference: &mut Mujoco,
    lanes: &mut Lanes,
    bound: f64,
) -> miette::Result<Vec<Check>> {
    let found = worst(robot, cases, reference, &mut |case| {
        let begin = poses(robot, lanes, case);
        let moves = robot.links.iter().zip(&begin).zip(lanes.link_velocities(0));
        let twists = moves.flat_map(|((link, pose), [origin, turn])| {
            let arm = pose.rotation * link.inertial.com;
            let velocity = origin + turn.cross(&arm);
            [velocity.x, velocity.y, velocity.z, turn.x, turn.y, turn.z]
        });
        let twists = twists.collect();
        Ok((begin, twists))
    })?;
    Ok(named(name, &found, bound))
}

/// Poses of an engine's links, and velocity of each centre of mass and turning, six numbers a link.
type Motion = (Vec<IsometryMatrix3<f64>>, Vec<f64>);

/// Largest differences of centre of mass and momentum by what `motion` finds for each case.
fn worst(
    robot: &Robot,
    cases: &[Case],
    reference: &mut Mujoco,
    motion: &mut dyn FnMut(&Case) -> miette::Result<Motion>,
) -> miette::Result<Vec<f64>> {
    let mut worst = vec![0.0; NAMES.len()];
    for case in cases {
        let (begin, twists) = motion(case)?;
        let middle = center_of_mass(robot, &begin);
        let [linear, angular] = momentum(robot, &begin, &middle, &twists);
        compare(
            &mut worst,
            &[middle, linear, angular],
            &equation(robot, case, reference, &[])?,
        );
    }
    Ok(worst)
}

fn compare(worst: &mut [f64], ours: &[Vector3<f64>], found: &[f64]) {
    for ((worst, ours), theirs) in worst.iter_mut().zip(ours).zip(found.chunks(3)) {
        let theirs = Vector3::from_column_slice(theirs);
        *worst = largest(*worst, (ours - theirs).norm() / theirs.norm());
    }
}

fn named(name: &str, worst: &[f64], bound: f64) -> Vec<Check> {
    let checks = NAMES.iter().zip(worst);
    checks
        .map(|(what, &worst)| Check::new(format!("{name}: {what}, relative"), worst, bound))
        .collect()
}

/// Where the engine has the links at the beginning of a case.
fn poses(robot: &Robot, engine: &mut dyn Engine, case: &Case) -> Vec<IsometryMatrix3<f64>> {
    engine.reset(0, &case.start, &frictionless(robot));
    links(robot, engine)
}

fn links(robot: &Robot, engine: &mut dyn Engine) -> Vec<IsometryMatrix3<f64>> {
    let all: Vec<usize> = (0..robot.links.len()).collect();
    let mut poses = vec![IsometryMatrix3::identity(); all.len()];
    engine.link_poses(&all, &mut poses);
    poses
}

/// Where a link's centre of mass is.
fn center(link: &Link, pose: &IsometryMatrix3<f64>) -> Vector3<f64> {
    (pose * Point3::from(link.inertial.com)).coords
}

fn center_of_mass(robot: &Robot, poses: &[IsometryMatrix3<f64>]) -> Vector3<f64> {
    let moments = robot.links.iter().zip(poses);
    let moments = moments.map(|(link, pose)| link.inertial.mass * center(link, pose));
    moments.sum::<Vector3<f64>>() / robot.mass()
}

/// Mean velocity of every link's centre of mass and its turning, world frame, over a step of `dt` s without torques.
fn twists(robot: &Robot, engine: &mut dyn Engine, case: &Case, dt: f64) -> Vec<f64> {
    let before = poses(robot, engine, case);
    let mut drive = Drive::idle(robot.dofs.len(), 1);
    drive.torque_min.fill(-1e9);
    drive.torque_max.fill(1e9);
    engine.step(&drive);
    let after = links(robot, engine);
    let moves = robot.links.iter().zip(before.iter().zip(&after));
    let twists = moves.flat_map(|(link, (before, after))| {
        let velocity = (center(link, after) - center(link, before)) / dt;
        // The sine of an angle so small instead of the angle, which costs a term that goes with the step.
        let turn = (after.rotation * before.rotation.inverse()).into_inner();
        let turn = (turn - turn.transpose()) / (2.0 * dt);
        [velocity.x, velocity.y, velocity.z, turn.m32, turn.m13, turn.m21]
    });
    twists.collect()
}

/// Linear momentum of all links, and angular momentum about their centre of mass.
fn momentum(robot: &Robot, poses: &[IsometryMatrix3<f64>], middle: &Vector3<f64>, twists: &[f64]) -> [Vector3<f64>; 2] {
    let mut sum = [Vector3::zeros(); 2];
    for ((link, pose), twist) in robot.links.iter().zip(poses).zip(twists.chunks(6)) {
        let (velocity, turn) = (
            Vector3::from_column_slice(&twist[..3]),
            Vector3::from_column_slice(&twist[3..]),
        );
        let own = link.inertial.mass * velocity;
        let spin = pose.rotation * (link.inertial.inertia * pose.rotation.inverse_transform_vector(&turn));
        sum[0] += own;
        sum[1] += (center(link, pose) - middle).cross(&own) + spin;
    }
    sum
}
