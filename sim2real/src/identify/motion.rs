//! What logs measure of the motion beside joint positions, and how far a simulation is from it: joint velocities, and the trunk's orientation
//! and angular velocity where it moves freely. Nothing is fitted to these; they are reported.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};
use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::Robot;
use rayon::prelude::*;

use super::measure::Sums;
use super::rollout::Rollout;
use super::trial::{DT, Trial};
use crate::recording::{JointRecord, Recording, Samples};

/// Measurements at their times, in steps from a trial's start.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// Velocity of a degree of freedom, rad/s or m/s.
    velocity: Vec<(f64, (usize, f64))>,
    /// Orientation of the trunk.
    orientation: Vec<(f64, UnitQuaternion<f64>)>,
    /// Angular velocity of the trunk in its own frame, rad/s.
    turning: Vec<(f64, Vector3<f64>)>,
}

impl Motion {
    /// What `recording` has from `from` to `to` (s), in steps from `start`, of a robot whose degrees of freedom have the records `joints`;
    /// the trunk's if it is `free`.
    pub fn new(recording: &Recording, joints: &[&JointRecord], start: f64, (from, to): (f64, f64), free: bool) -> Self {
        let mut velocity: Vec<(f64, (usize, f64))> = Vec::new();
        for (d, joint) in joints.iter().enumerate() {
            let own = within(&joint.velocity, start, (from, to));
            velocity.extend(own.map(|(at, value)| (at, (d, value))));
        }
        velocity.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.0.cmp(&b.1.0)));
        let imu = recording.imu.as_ref().filter(|_| free);
        Self {
            velocity,
            orientation: imu.map_or_else(Vec::new, |imu| within(&imu.orientation, start, (from, to)).collect()),
            turning: imu.map_or_else(Vec::new, |imu| {
                within(&imu.angular_velocity, start, (from, to)).collect()
            }),
        }
    }

    fn is_empty(&self) -> bool {
        self.velocity.is_empty() && self.orientation.is_empty() && self.turning.is_empty()
    }
}

/// The samples from `from` to `to`, in steps from `start`.
fn within<T: Copy>(samples: &Samples<T>, start: f64, (from, to): (f64, f64)) -> impl Iterator<Item = (f64, T)> {
    let first = samples.time.partition_point(|&t| t < from);
    let end = samples.time.partition_point(|&t| t <= to).max(first);
    let times = samples.time[first..end].iter().map(move |t| (t - start) / DT);
    times.zip(samples.value[first..end].iter().copied())
}

/// Errors of `robots`, each as it was in its trial, by quantity; only those that were measured.
///
/// # Errors
/// When an engine does not take a robot.
pub fn errors(
    robot: &Robot,
    robots: &[(Robot, &Trial)],
    finer: usize,
) -> Result<BTreeMap<String, BTreeMap<String, f64>>, EngineError> {
    let followed: Result<Vec<Found>, EngineError> = robots
        .par_iter()
        .filter(|(_, trial)| !trial.motion.is_empty())
        .map(|(own, trial)| follow(own, trial, finer))
        .collect();
    let mut whole = Found::new(robot.dofs.len());
    for found in followed? {
        whole.velocity.and(&found.velocity);
        whole.orientation.and(&found.orientation);
        whole.turning.and(&found.turning);
    }
    let parts = [
        ("joint_velocity", whole.velocity.overall(robot)),
        ("orientation", whole.orientation.of(0)),
        ("angular_velocity", whole.turning.of(0)),
    ];
    let named = parts.into_iter().filter_map(|(name, errors)| {
        let (rmse, mae) = errors?;
        Some((
            name.to_owned(),
            BTreeMap::from([("rmse".to_owned(), rmse), ("mae".to_owned(), mae)]),
        ))
    });
    Ok(named.collect())
}

/// Errors of a trial.
struct Found {
    velocity: Sums,
    orientation: Sums,
    turning: Sums,
}

impl Found {
    fn new(dofs: usize) -> Self {
        Self {
            velocity: Sums::new(dofs),
            orientation: Sums::new(1),
            turning: Sums::new(1),
        }
    }
}

/// Follows `trial` with `robot`; what a simulation that broke says is not finite.
fn follow(robot: &Robot, trial: &Trial, finer: usize) -> Result<Found, EngineError> {
    let dofs = robot.dofs.len();
    let mut rollout = Rollout::new(trial, std::slice::from_ref(robot), DT / finer as f64)?;
    let mut found = Found::new(dofs);
    let Motion {
        velocity,
        orientation,
        turning,
    } = &*trial.motion;
    let (mut before, mut now, mut next) = (vec![0.0; dofs], vec![0.0; dofs], [0; 3]);
    rollout.read(&mut now);
    for step in 0..trial.steps {
        std::mem::swap(&mut before, &mut now);
        let from = rollout.parts().0.base(0);
        rollout.step(step, finer);
        rollout.read(&mut now);
        let base = rollout.parts().0.base(0);
        let end = (step + 1) as f64;
        // What an encoder tells of the velocity: as late and as scaled as its positions are.
        for &(_, (d, measured)) in taken(velocity, &mut next[0], end) {
            found.velocity.add(d, (now[d] - before[d]) / DT - measured);
        }
        for &(at, measured) in taken(orientation, &mut next[1], end) {
            let there = from.orientation.slerp(&base.orientation, share(at, step));
            found.orientation.add(0, there.angle_to(&measured));
        }
        for &(at, measured) in taken(turning, &mut next[2], end) {
            let there = from.angular_velocity.lerp(&base.angular_velocity, share(at, step));
            let own = base.orientation.inverse_transform_vector(&there);
            found.turning.add(0, (own - measured).norm());
        }
    }
    Ok(found)
}

/// How far into a step a time is.
fn share(at: f64, step: usize) -> f64 {
    (at - step as f64).clamp(0.0, 1.0)
}

/// The samples from number `next` on until the step `end`.
fn taken<'a, T>(samples: &'a [(f64, T)], next: &mut usize, end: f64) -> &'a [(f64, T)] {
    let first = *next;
    *next += samples[first..].partition_point(|(at, _)| *at <= end);
    &samples[first..*next]
}
