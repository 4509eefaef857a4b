//! Centre of mass and momentum against MuJoCo's, at random states: by this project's kinematics, which environments and estimators
//! go by, and by where an engine has its links and how it moves them.

use nalgebra::{Isometry3, IsometryMatrix3, Point3, Vector3};
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

/// By the links of the engine that `make` makes: the centre of mass after a reset, and where `bound` asks for double precision the
/// momentum of the links as they move from there. Single precision knows positions too coarsely for their differences; there the base's rows of
/// the equation of motion stand for the momentum.
///
/// # Errors
/// When the engine cannot be made or MuJoCo does not answer.
pub fn checks(
    name: &str,
    robot: &Robot,
    cases: &[Case],
    reference: &mut Mujoco,
    make: &Make<'_>,
    bound: f64,
) -> miette::Result<Vec<Check>> {
    let mut worst = vec![0.0; if bound > DOUBLE { 1 } else { NAMES.len() }];
    let mut still = make(1e-3)?;
    for case in cases {
        let begin = poses(robot, &mut *still, case);
        let middle = center_of_mass(robot, &begin);
        let mut ours = vec![middle];
        if worst.len() > 1 {
            let twists = extrapolated(&mut |dt| Ok(twists(robot, &mut *make(dt)?, case, dt)))?;
            ours.extend(momentum(robot, &begin, &middle, &twists));
        }
        compare(&mut worst, &ours, &equation(robot, case, reference, &[])?);
    }
    Ok(named(name, &worst, bound))
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
