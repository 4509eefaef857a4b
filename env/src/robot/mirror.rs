//! The left-right mirror map: names give the pairs, the axes give the signs.

use nalgebra::{Isometry3, Vector3};

use super::settings::Mirror;
use super::source::{RobotError, Source};
use super::{JointKind, Kinematics, MirroredJoint, Robot};

/// How far the mirrored axis of a joint may be from its partner's axis (as a cosine) to give a sign.
const ALIGNED: f64 = 0.99;
/// How far mirrored limits and nominal positions may be apart, rad or m.
const SYMMETRIC: f64 = 1e-4;

/// Mirror map of the policy's joints for a reflection at the plane y = 0 of the base.
pub(super) fn map(robot: &Robot, mirror: &Mirror, source: &Source) -> Result<Vec<MirroredJoint>, RobotError> {
    let (left, right) = (mirror.left.get_ref(), mirror.right.get_ref());
    let joint = |name: &str| (0..robot.policy.len()).find(|&i| robot.policy_joint(i).name == name);
    for name in mirror.signs.keys() {
        if joint(name.get_ref()).is_none() {
            let message = format!("`{}` is not a joint of the policy", name.get_ref());
            return Err(source.error(name.span(), message, "name a joint of the policy"));
        }
    }
    if left == right {
        let message = format!("left and right are told apart by the same word, `{right}`");
        return Err(source.error(
            mirror.right.span(),
            message,
            "give the words by which left and right names differ",
        ));
    }
    let axes = world_axes(robot);
    let mirrored = |i: usize| {
        let name = &robot.policy_joint(i).name;
        let partner_name = match (name.contains(left.as_str()), name.contains(right.as_str())) {
            (true, _) => name.replacen(left, right, 1),
            (_, true) => name.replacen(right, left, 1),
            _ => name.clone(),
        };
        let Some(partner) = joint(&partner_name) else {
            let message = format!("`{name}` has no partner `{partner_name}` among the policy's joints");
            return Err(source.error(
                mirror.left.span(),
                message,
                "give the words by which left and right names differ",
            ));
        };
        let given = [name, &partner_name].into_iter().find_map(|name| {
            mirror
                .signs
                .iter()
                .find(|(key, _)| key.get_ref() == name)
                .map(|(_, sign)| *sign.get_ref())
        });
        let cosine = axes[i].dot(&reflected(robot.policy_joint(i).kind, &axes[partner]));
        match given {
            Some(sign) => Ok(MirroredJoint { joint: partner, sign }),
            None if cosine.abs() > ALIGNED => Ok(MirroredJoint {
                joint: partner,
                sign: cosine.signum(),
            }),
            None => {
                let message = format!("the axes of `{name}` and `{partner_name}` are no mirror images");
                Err(source.error(
                    mirror.left.span(),
                    message,
                    format!("add signs = {{ {name} = 1.0 }} or -1.0"),
                ))
            }
        }
    };
    let map: Vec<MirroredJoint> = (0..robot.policy.len()).map(mirrored).collect::<Result<_, _>>()?;
    check(robot, &map).map_err(|message| {
        let help = "a mirror map is for a robot whose left side is the mirror image of its right; leave [mirror] out otherwise";
        source.error(mirror.left.span(), message, help)
    })?;
    Ok(map)
}

/// Whether the map is its own inverse, with nominal pose and limits symmetric under it.
fn check(robot: &Robot, map: &[MirroredJoint]) -> Result<(), String> {
    let close = |a: f64, b: f64| (a - b).abs() <= SYMMETRIC;
    for (i, &MirroredJoint { joint, sign }) in map.iter().enumerate() {
        let (own, twin) = (robot.policy_joint(i), robot.policy_joint(joint));
        let names = format!("`{}` and `{}`", own.name, twin.name);
        if map[joint] != (MirroredJoint { joint: i, sign }) {
            return Err(format!("{names} are not each other's mirror image"));
        }
        let limits = match sign > 0.0 {
            true => twin.limits,
            false => (-twin.limits.1, -twin.limits.0),
        };
        if !close(own.limits.0, limits.0) || !close(own.limits.1, limits.1) {
            return Err(format!(
                "the limits of {names} are no mirror images: {} to {}, and mirrored {} to {}",
                own.limits.0, own.limits.1, limits.0, limits.1
            ));
        }
        if !close(own.nominal, sign * twin.nominal) {
            return Err(format!(
                "the nominal positions of {names} are no mirror images: {}, and mirrored {}",
                own.nominal,
                sign * twin.nominal
            ));
        }
    }
    Ok(())
}

/// The policy joints' axes in the base frame with all joints at zero.
fn world_axes(robot: &Robot) -> Vec<Vector3<f64>> {
    let mut kinematics = Kinematics::new(robot);
    kinematics.set_pose(robot, &Isometry3::identity(), &vec![0.0; robot.dofs.len()]);
    let axis = |&dof: &usize| {
        let joint = robot.dofs[dof];
        kinematics.pose(joint + 1).rotation * robot.joints[joint].axis.into_inner()
    };
    robot.policy.iter().map(axis).collect()
}

/// A reflection turns y for a direction, and the others for an axis of rotation.
fn reflected(kind: JointKind, axis: &Vector3<f64>) -> Vector3<f64> {
    match kind {
        JointKind::Revolute => Vector3::new(-axis.x, axis.y, -axis.z),
        JointKind::Prismatic => Vector3::new(axis.x, -axis.y, axis.z),
    }
}
