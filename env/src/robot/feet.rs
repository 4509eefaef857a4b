//! Feet: the soles the TOML gives, or a guess from the shapes that stand lowest.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::settings::Settings;
use super::source::{RobotError, Source};
use super::tree::Tree;
use super::urdf::Urdf;
use super::{Foot, Kinematics, Robot};

/// How far apart in height points of one flat sole may be, m.
const FLAT: f64 = 0.005;

/// Feet of the TOML, in its order; the sole's pose is moved into the frame of the link that carries it.
pub(super) fn from_settings(
    settings: &Settings,
    source: &Source,
    urdf: &Urdf,
    tree: &Tree,
) -> Result<Vec<Foot>, RobotError> {
    let foot = |entry: &super::settings::FootEntry| {
        let (link, frame) = find_link(&entry.link, source, urdf, tree)?;
        let rpy = entry.rpy.as_ref().map_or([0.0; 3], |rpy| *rpy.get_ref());
        let sole = Isometry3::from_parts(
            Translation3::from(*entry.sole.get_ref()),
            UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]),
        );
        let name = entry.name.clone().unwrap_or_else(|| entry.link.get_ref().clone());
        Ok(Foot {
            name,
            link,
            sole: frame * sole,
            half_extents: entry.size.get_ref().map(|size| size / 2.0),
        })
    };
    let feet: Vec<Foot> = settings.foot.iter().map(foot).collect::<Result<_, _>>()?;
    for (i, (foot, entry)) in feet.iter().zip(&settings.foot).enumerate() {
        if feet[..i].iter().any(|other| other.name == foot.name) {
            return Err(source.error(
                entry.link.span(),
                format!("two feet are named `{}`", foot.name),
                "give each [[foot]] a name of its own",
            ));
        }
        if let Some(other) = feet[..i].iter().find(|other| other.link == foot.link) {
            return Err(source.error(
                entry.link.span(),
                format!("the feet `{}` and `{}` are on one link", other.name, foot.name),
                "each foot has a link of its own, with a joint between it and the other's",
            ));
        }
    }
    Ok(feet)
}

/// Refuses a foot that nobody can stand on: one whose sole is above the robot's centre of mass in the nominal pose.
pub(super) fn check(robot: &Robot, settings: &Settings, source: &Source) -> Result<(), RobotError> {
    let kinematics = Kinematics::new(robot);
    let weighed = robot.links.iter().enumerate().map(|(link, body)| {
        let mass = body.inertial.mass;
        mass * (kinematics.pose(link) * Point3::from(body.inertial.com)).z
    });
    let centre = weighed.sum::<f64>() / robot.mass();
    for (foot, entry) in robot.feet.iter().zip(&settings.foot) {
        let height = (kinematics.pose(foot.link) * foot.sole).translation.z;
        if height > centre {
            return Err(source.error(
                entry.link.span(),
                format!(
                    "the sole of foot `{}` is {:.2} m above the robot's centre of mass in the nominal pose",
                    foot.name,
                    height - centre
                ),
                "a foot is a link that the robot stands on",
            ));
        }
    }
    Ok(())
}

/// The link a URDF link of this name was merged into, and the named link's pose there.
pub(super) fn find_link(
    name: &toml::Spanned<String>,
    source: &Source,
    urdf: &Urdf,
    tree: &Tree,
) -> Result<(usize, Isometry3<f64>), RobotError> {
    let found = urdf.robot.links.iter().position(|link| &link.name == name.get_ref());
    found.and_then(|link| tree.frames[link]).ok_or_else(|| {
        let message = format!("there is no link `{}`", name.get_ref());
        source.error(name.span(), message, format!("name a link of {}", urdf.source.file))
    })
}

/// Guesses the soles of a robot that stands with all joints at zero: the flat undersides of the leaf links that
/// reach lowest. Fewer than two is taken for an arm or a rig, which has none.
pub(super) fn guess(robot: &Robot) -> Vec<Foot> {
    let mut kinematics = Kinematics::new(robot);
    kinematics.set_pose(robot, &Isometry3::identity(), &vec![0.0; robot.dofs.len()]);
    let is_leaf = |link: usize| link > 0 && robot.links.iter().all(|other| other.parent != Some(link));
    let undersides: Vec<(usize, f64, Foot)> = (0..robot.links.len())
        .filter(|&link| is_leaf(link))
        .filter_map(|link| underside(robot, kinematics.pose(link), link).map(|(z, foot)| (link, z, foot)))
        .collect();
    let lowest = undersides.iter().map(|(_, z, _)| *z).fold(f64::INFINITY, f64::min);
    let mut feet: Vec<(f64, Foot)> = undersides
        .into_iter()
        .filter(|(_, z, _)| *z < lowest + 2.0 * FLAT)
        .map(|(link, _, foot)| (-kinematics.pose(link).translation.y, foot))
        .collect();
    feet.sort_by(|a, b| a.0.total_cmp(&b.0));
    if feet.len() < 2 {
        Vec::new()
    } else {
        feet.into_iter().map(|(_, foot)| foot).collect()
    }
}

/// Height and rectangle of the flat underside of a link at `pose`, if it has one.
fn underside(robot: &Robot, pose: &Isometry3<f64>, link: usize) -> Option<(f64, Foot)> {
    let down = pose.rotation.inverse() * -Vector3::z();
    let points: Vec<Point3<f64>> = robot.links[link]
        .shapes
        .iter()
        .flat_map(|shape| shape.low_points(&down))
        .map(|point| pose * point)
        .collect();
    let lowest = points.iter().map(|point| point.z).fold(f64::INFINITY, f64::min);
    let flat = points.iter().filter(|point| point.z < lowest + FLAT);
    let (mut min, mut max) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    flat.for_each(|point| (min, max) = (min.inf(&point.coords), max.sup(&point.coords)));
    let (center, half) = ((min + max) / 2.0, (max - min) / 2.0);
    if half.x < FLAT || half.y < FLAT {
        return None;
    }
    let sole = pose.inverse() * Isometry3::translation(center.x, center.y, lowest);
    let name = robot.links[link].name.clone();
    Some((
        lowest,
        Foot {
            name,
            link,
            sole,
            half_extents: [half.x, half.y],
        },
    ))
}
