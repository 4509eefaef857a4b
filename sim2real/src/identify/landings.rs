//! When the feet of a robot that walks land, by its readings.
//!
//! About an impact no model of contact is to be believed, and what comes after depends on it: a robot that walks is followed from one
//! landing to the next.

use nalgebra::{Isometry3, Vector3};
use omniwalk_env::robot::{Foot, Kinematics, Robot};

use super::base::MeasuredBase;
use super::cut::linear;
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

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::UnitQuaternion;
    use omniwalk_env::robot::load;

    use super::*;
    use crate::recording::{ImuRecord, Samples, Series};

    const URDF: &str = r#"<robot name="treader"><link name="trunk"><inertial><mass value="4"/><inertia ixx="0.05" iyy="0.05" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="left"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="right"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="left_leg" type="prismatic"><parent link="trunk"/><child link="left"/><origin xyz="0 0.1 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="30" velocity="8"/></joint>
<joint name="right_leg" type="prismatic"><parent link="trunk"/><child link="right"/><origin xyz="0 -0.1 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="30" velocity="8"/></joint></robot>"#;
    const TOML: &str = "base = \"floating\"\n[[foot]]\nlink = \"left\"\nsole = [0.0, 0.0, -0.3]\nsize = [0.2, 0.1]\n\
        [[foot]]\nlink = \"right\"\nsole = [0.0, 0.0, -0.3]\nsize = [0.2, 0.1]\n";

    /// A foot that is up to `height` m in the air for 0.3 s from `begin` on, read at 200 Hz.
    fn steps(name: &str, swings: &[(f64, f64)]) -> JointRecord {
        let time: Vec<f64> = (0..300).map(|k| f64::from(k) * 5e-3).collect();
        let at = |t: f64| {
            let own = swings.iter().filter(|(begin, _)| (0.0..0.3).contains(&(t - begin)));
            own.map(|(begin, height)| height * (PI * (t - begin) / 0.3).sin()).sum()
        };
        JointRecord {
            name: name.to_owned(),
            position: Series {
                value: time.iter().map(|&t| at(t)).collect(),
                time,
            },
            ..JointRecord::default()
        }
    }

    #[test]
    fn a_foot_lands_where_it_comes_down_from_the_air() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("treader.urdf"), URDF).expect("written");
        std::fs::write(folder.path().join("robot.toml"), TOML).expect("written");
        let robot = load(folder.path()).expect("a robot");
        let still = Samples {
            time: vec![0.0, 1.5],
            value: vec![Vector3::zeros(); 2],
        };
        let recording = Recording {
            imu: Some(ImuRecord {
                orientation: Samples {
                    time: vec![0.0, 1.5],
                    value: vec![UnitQuaternion::from_euler_angles(0.01, 0.02, 1.0); 2],
                },
                angular_velocity: still,
                ..ImuRecord::default()
            }),
            ..Recording::default()
        };
        // The last is within what attitude and encoders may be off by.
        let left = steps("left_leg", &[(0.2, 0.04), (1.0, 0.008)]);
        let right = steps("right_leg", &[(0.6, 0.04)]);
        let found = landings(&robot, &recording, &[&left, &right], (0.0, 1.5));
        assert_eq!(found.len(), 2, "{found:?}");
        for (landing, end) in found.iter().zip([0.5, 0.9]) {
            assert!((0.0..0.04).contains(&(end - landing)), "{landing} for {end}");
        }
    }
}
