//! A robot in tables for people.

use std::fmt::{self, Write};

use super::{Base, Joint, JointKind, Kinematics, Robot};
use crate::effect::Site;

/// Everything about a robot that decides how it moves: joints, links, feet, balance of the nominal pose, notes.
pub fn describe(robot: &Robot) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write_all(&mut out, robot);
    out
}

fn write_all(out: &mut String, robot: &Robot) -> fmt::Result {
    let base = match robot.base {
        Base::Floating => "floating",
        Base::Fixed => "fixed",
    };
    writeln!(
        out,
        "{}: {base} base `{}`, {:.3} kg, {} links, {} degrees of freedom, {} of them moved by the policy\n",
        robot.name,
        robot.links[0].name,
        robot.mass(),
        robot.links.len(),
        robot.dofs.len(),
        robot.policy.len()
    )?;
    write_joints(out, robot)?;
    write_links(out, robot)?;
    write_effects(out, robot)?;
    write_balance(out, robot)?;
    if !robot.notes.is_empty() {
        writeln!(out, "\nnotes")?;
    }
    robot.notes.iter().try_for_each(|note| writeln!(out, "  {note}"))
}

fn write_joints(out: &mut String, robot: &Robot) -> fmt::Result {
    writeln!(out, "joints (rad, N m; sliding: m, N)")?;
    writeln!(
        out,
        "  {:<24} {:<9} {:>6} {:>16} {:>8} {:>7} {:>6} {:>7} {:>6} {:>9} {:>8} {:>8}  follows",
        "name", "kind", "policy", "limits", "nominal", "kp", "kd", "torque", "speed", "armature", "damping", "friction"
    )?;
    for (index, joint) in robot.joints.iter().enumerate() {
        let policy = robot.policy.iter().position(|&dof| robot.dofs[dof] == index);
        write_joint(out, robot, joint, policy)?;
    }
    Ok(())
}

fn write_joint(out: &mut String, robot: &Robot, joint: &Joint, policy: Option<usize>) -> fmt::Result {
    let kind = match joint.kind {
        JointKind::Revolute => "revolute",
        JointKind::Prismatic => "prismatic",
    };
    let limits = format!("{:.2} .. {:.2}", joint.limits.0, joint.limits.1);
    let policy = policy.map_or("-".into(), |i| i.to_string());
    write!(
        out,
        "  {:<24} {kind:<9} {policy:>6} {limits:>16} {:>8.3}",
        joint.name, joint.nominal
    )?;
    match joint.actuator {
        Some(a) => write!(
            out,
            " {:>7.1} {:>6.2} {:>7.2} {:>6.2}",
            a.kp, a.kd, a.torque_limit, a.speed_limit
        )?,
        None => write!(out, " {:>7} {:>6} {:>7} {:>6}", "-", "-", "-", "-")?,
    }
    let passive = joint.passive;
    write!(
        out,
        " {:>9.4} {:>8.3} {:>8.3}",
        passive.armature, passive.damping, passive.friction
    )?;
    if let Some(actuator) = joint.actuator.filter(|actuator| actuator.kp_scale != 1.0) {
        write!(out, "  kp x {:.3}", actuator.kp_scale)?;
    }
    if let Some(mimic) = joint.mimic {
        write!(out, "  {} x {}", mimic.multiplier, robot.joints[mimic.joint].name)?;
        if mimic.offset != 0.0 {
            write!(out, " + {}", mimic.offset)?;
        }
    }
    writeln!(out)
}

fn write_links(out: &mut String, robot: &Robot) -> fmt::Result {
    writeln!(out, "\nlinks")?;
    writeln!(
        out,
        "  {:<24} {:>8} {:>26} {:>7} {:>7}",
        "name", "mass kg", "centre of mass m", "shapes", "points"
    )?;
    for link in &robot.links {
        let com = link.inertial.com;
        let com = format!("{:.4} {:.4} {:.4}", com.x, com.y, com.z);
        let (shapes, points) = (link.shapes.len(), link.contact_points.len());
        writeln!(
            out,
            "  {:<24} {:>8.3} {com:>26} {shapes:>7} {points:>7}",
            link.name, link.inertial.mass
        )?;
    }
    let name = |link: usize| &robot.links[link].name;
    robot
        .overlap_pairs
        .iter()
        .try_for_each(|&(a, b)| writeln!(out, "  overlap ends an episode: {} - {}", name(a), name(b)))
}

fn write_effects(out: &mut String, robot: &Robot) -> fmt::Result {
    if !robot.effects.is_empty() || !robot.ranges.is_empty() {
        writeln!(out, "\neffects")?;
    }
    for effect in &robot.effects {
        let info = effect.kind.info();
        let (name, sliding) = match info.site {
            Site::Joint => {
                let joint = robot.dof(effect.target);
                (&joint.name, joint.kind == JointKind::Prismatic)
            }
            Site::Link => (&robot.links[effect.target].name, false),
        };
        write!(out, "  {:<24} {:<24}", info.id, name)?;
        for (parameter, value) in info.parameters.iter().zip(&effect.values) {
            write!(out, " {} {value} {}", parameter.name, parameter.scale.unit(sliding))?;
        }
        for (variable, grid) in effect.table.iter().flat_map(|table| &table.axes) {
            write!(out, " over {} points of {}", grid.len(), variable.name())?;
        }
        writeln!(out)?;
    }
    for range in &robot.ranges {
        let (info, joint) = (range.kind.info(), robot.dof(range.target));
        let parameter = &info.parameters[range.parameter];
        let unit = parameter.scale.unit(joint.kind == JointKind::Prismatic);
        let (lower, upper) = (range.lower, range.upper);
        writeln!(
            out,
            "  {:<24} {:<24} {} drawn from {lower} to {upper} {unit}",
            info.id, joint.name, parameter.name
        )?;
    }
    Ok(())
}

fn write_balance(out: &mut String, robot: &Robot) -> fmt::Result {
    let kinematics = Kinematics::new(robot);
    let com = kinematics.center_of_mass(robot.links.iter().map(|link| &link.inertial));
    writeln!(out, "\nnominal pose")?;
    writeln!(
        out,
        "  base at height {:.4} m, centre of mass at {:.4} {:.4} {:.4} m",
        robot.base_pose.translation.z, com.x, com.y, com.z
    )?;
    let mut middle = [0.0; 2];
    for (index, foot) in robot.feet.iter().enumerate() {
        let sole = kinematics.sole(robot, index);
        let at = sole.translation.vector;
        middle = [middle[0] + at.x, middle[1] + at.y];
        let tilt = (sole.rotation * nalgebra::Vector3::z()).z.clamp(-1.0, 1.0).acos();
        let [length, width] = foot.half_extents.map(|half| 2.0 * half);
        writeln!(
            out,
            "  foot {:<10} on {:<22} sole {length:.3} x {width:.4} m at {:.4} {:.4} {:.4} m, tilt {tilt:.4} rad",
            foot.name, robot.links[foot.link].name, at.x, at.y, at.z
        )?;
    }
    if robot.feet.is_empty() {
        return writeln!(out, "  no feet");
    }
    let [x, y] = middle.map(|sum| sum / robot.feet.len() as f64);
    writeln!(
        out,
        "  centre of mass over the middle of the soles: {:+.4} m forward, {:+.4} m left",
        com.x - x,
        com.y - y
    )
}
