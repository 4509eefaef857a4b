//! The left-right mirror map: names give the pairs, the axes give the signs.

use nalgebra::{Isometry3, Vector3};

use super::settings::Mirror;
use super::source::{RobotError, Source};
use super::{JointKind, Kinematics, MirroredJoint, Robot};

/// How far the mirrored axis of a joint may be from its partner's axis (as a cosine) to give a sign.
const ALIGNED: f64 = 0.99;

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
    (0..robot.policy.len()).map(mirrored).collect()
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
