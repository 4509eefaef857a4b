//! Feet and legs: from the soles that loading finds in the collision shapes, or, where there are only meshes, from the
//! two lowest ends of the tree that are each other's mirror image.

use nalgebra::{Isometry3, Point3};
use omniwalk_env::robot::{Foot, JointKind, Kinematics, Robot};

use super::sides::Sides;

/// Length and width of a sole that nothing is known of, over the length of the leg: those of a human foot and its leg.
const SOLE: [f64; 2] = [0.30, 0.12];
/// An axis is a pitch axis when its share along y is above this.
const PITCH: f64 = 0.9;

/// A leg of a robot with all joints at zero.
pub(super) struct Leg {
    /// The foot at its end, named `left` or `right`.
    pub foot: Foot,
    /// From the base to the foot: indices into the robot's joints.
    pub joints: Vec<usize>,
    /// Height of the hip over the sole, m.
    pub length: f64,
    /// Of the degrees of freedom in it that bend the leg forward and back, from the hip down: index and direction of the
    /// axis, 1 to the left and -1 to the right.
    pub pitch: Vec<(usize, f64)>,
}

/// The two legs, left first, or none; and what was guessed.
pub(super) fn find(robot: &Robot, sides: Option<Sides>) -> (Vec<Leg>, Vec<String>) {
    let mut kinematics = Kinematics::new(robot);
    kinematics.set_pose(robot, &Isometry3::identity(), &vec![0.0; robot.dofs.len()]);
    let (mut feet, from) = match robot.feet.len() {
        2 => (robot.feet.clone(), "their collision shapes"),
        _ => (
            sides.map_or_else(Vec::new, |sides| lowest_ends(robot, &kinematics, sides)),
            "where the legs end and how long they are",
        ),
    };
    if feet.len() != 2 {
        return (
            Vec::new(),
            vec!["feet: no two found, so the base is taken to be fixed".into()],
        );
    }
    for (foot, name) in feet.iter_mut().zip(["left", "right"]) {
        foot.name = name.into();
    }
    let legs: Vec<Leg> = feet.into_iter().map(|foot| leg(robot, &kinematics, foot)).collect();
    let links = legs
        .iter()
        .map(|leg| robot.links[leg.foot.link].name.as_str())
        .collect::<Vec<_>>()
        .join(" and ");
    (legs, vec![format!("feet: {links}, soles from {from}")])
}

/// Joints between the base and a link, from the base on.
fn chain(robot: &Robot, mut link: usize) -> Vec<usize> {
    let mut joints = Vec::new();
    while let Some(parent) = robot.links[link].parent {
        joints.push(link - 1);
        link = parent;
    }
    joints.reverse();
    joints
}

fn leg(robot: &Robot, kinematics: &Kinematics, foot: Foot) -> Leg {
    let joints = chain(robot, foot.link);
    let sole = (kinematics.pose(foot.link) * foot.sole).translation.z;
    let hip = joints
        .first()
        .map_or(0.0, |&joint| kinematics.pose(joint + 1).translation.z);
    let bends = |&joint: &usize| {
        let turns = robot.joints[joint].kind == JointKind::Revolute;
        let dof = robot.dofs.iter().position(|&other| other == joint).filter(|_| turns)?;
        let y = (kinematics.pose(joint + 1).rotation * robot.joints[joint].axis.into_inner()).y;
        (y.abs() > PITCH).then_some((dof, y.signum()))
    };
    let pitch = joints.iter().filter_map(bends).collect();
    Leg {
        pitch,
        length: hip - sole,
        joints,
        foot,
    }
}

/// Soles below the two ends of the tree that reach lowest, if they are left and right of each other.
fn lowest_ends(robot: &Robot, kinematics: &Kinematics, sides: Sides) -> Vec<Foot> {
    let is_end = |link: &usize| *link > 0 && robot.links.iter().all(|other| other.parent != Some(*link));
    let height = |link: &usize| kinematics.pose(*link).translation.z;
    let mut ends: Vec<usize> = (0..robot.links.len()).filter(is_end).collect();
    ends.sort_by(|a, b| height(a).total_cmp(&height(b)));
    let [one, other, ..] = ends[..] else { return Vec::new() };
    let name = |link: usize| robot.joints[link - 1].name.as_str();
    let (left, right) = match sides.of_left(name(one)) {
        Some(twin) if twin == name(other) => (one, other),
        _ => (other, one),
    };
    if sides.of_left(name(left)).as_deref() != Some(name(right)) {
        return Vec::new();
    }
    [left, right].map(|link| sole_below(robot, kinematics, link)).into()
}

/// A sole as far below the centre of mass of a foot as its ankle is above.
fn sole_below(robot: &Robot, kinematics: &Kinematics, link: usize) -> Foot {
    let pose = kinematics.pose(link);
    let centre = pose * Point3::from(robot.links[link].inertial.com);
    let drop = (pose.translation.z - centre.z).max(0.0);
    let height = centre.z - drop;
    let hip = chain(robot, link)
        .first()
        .map_or(0.0, |&joint| kinematics.pose(joint + 1).translation.z);
    Foot {
        name: robot.links[link].name.clone(),
        link,
        sole: pose.inverse() * Isometry3::translation(centre.x, pose.translation.y, height),
        half_extents: SOLE.map(|share| share * (hip - height) / 2.0),
    }
}
