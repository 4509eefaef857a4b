//! When the feet of a robot that walks land, by its readings.
//!
//! About an impact no model of contact is to be believed, and what comes after depends on it: a robot that walks is followed from one
//! landing to the next.

use nalgebra::{Isometry3, Vector3};
use omniwalk_env::robot::{Foot, Kinematics, Robot};

use super::base::MeasuredBase;
use super::trial::linear;
use crate::recording::{JointRecord, Recording};

/// How often it is looked where the feet are, s.
const EVERY: f64 = 5e-3;
/// A foot is in the air once all of it is this much higher than the lowest corner, m: beyond what encoders and attitude are off by.
const UP: f64 = 0.012;
/// It is about to land when some of it is no higher than this, m.
const DOWN: f64 = 6e-3;

/// The times between `from` and `to` (s) at which a foot of `robot` that was in the air is about to land. Of every degree of freedom
/// `joints` has the record.
pub fn landings(robot: &Robot, recording: &Recording, joints: &[&JointRecord], (from, to): (f64, f64)) -> Vec<f64> {
    let times: Vec<f64> = (0..)
        .map(|k| from + f64::from(k) * EVERY)
        .take_while(|&t| t < to)
        .collect();
    let positions: Vec<Vec<f64>> = joints.iter().map(|joint| linear(&joint.position, &times)).collect();
    let mut kinematics = Kinematics::new(robot);
    let mut up = vec![false; robot.feet.len()];
    let mut landings = Vec::new();
    for (k, &time) in times.iter().enumerate() {
        let Some(base) = MeasuredBase::at(recording, time) else {
            continue;
        };
        let upright = Isometry3::from_parts(Vector3::zeros().into(), base.orientation);
        let pose: Vec<f64> = positions.iter().map(|own| own[k]).collect();
        kinematics.set_pose(robot, &upright, &pose);
        let lowest_of = |foot: &Foot| {
            let corners = foot.corners().map(|own| (kinematics.pose(foot.link) * own).z);
            corners.into_iter().fold(f64::INFINITY, f64::min)
        };
        let heights: Vec<f64> = robot.feet.iter().map(lowest_of).collect();
        let ground = heights.iter().copied().fold(f64::INFINITY, f64::min);
        for (up, height) in up.iter_mut().zip(&heights) {
            let above = height - ground;
            if *up && above < DOWN {
                landings.push(time);
            }
            *up = above > if *up { DOWN } else { UP };
        }
    }
    landings
}
