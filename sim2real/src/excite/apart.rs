//! Links that must not meet where a robot's files name none.

use nalgebra::IsometryMatrix3;
use omniwalk_env::robot::{Kinematics, Robot};
use omniwalk_env::task::overlap::Overlap;

/// `robot` with every pair of links that must not overlap: those of its files, or, where they name none, all that are apart in the nominal pose.
/// Shapes that overlap there are rougher than the links, or a joint connects them.
pub(super) fn watched(robot: &Robot) -> Robot {
    if !robot.overlap_pairs.is_empty() {
        return robot.clone();
    }
    let mut kinematics = Kinematics::new(robot);
    kinematics.set_pose(robot, &robot.base_pose, &robot.nominal());
    let poses = poses(robot, &kinematics);
    let links = 0..robot.links.len();
    let pairs = links.flat_map(|a| (a + 1..robot.links.len()).map(move |b| (a, b)));
    let mut one = robot.clone();
    let is_apart = |&pair: &(usize, usize)| {
        one.overlap_pairs = vec![pair];
        !Overlap::new(&one, 0.0).any(|link| &poses[link])
    };
    let overlap_pairs = pairs.filter(is_apart).collect();
    Robot {
        overlap_pairs,
        ..robot.clone()
    }
}

/// The pose of every link.
pub(super) fn poses(robot: &Robot, kinematics: &Kinematics) -> Vec<IsometryMatrix3<f64>> {
    let of = |link: usize| {
        let pose = kinematics.pose(link);
        IsometryMatrix3::from_parts(pose.translation, pose.rotation.to_rotation_matrix())
    };
    (0..robot.links.len()).map(of).collect()
}
