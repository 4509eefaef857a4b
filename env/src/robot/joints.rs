//! Joints with their settings: which are held, limits, nominal pose, actuators and the policy's order.

use toml::Spanned;

use super::settings::{JointEntry, Settings, matches};
use super::source::{RobotError, Source};
use super::tree::Tree;
use super::urdf::Urdf;
use super::{Actuator, Joint, Mimic, Passive};

/// Gains of a joint whose TOML gives none: full torque at this error, rad (m).
const DEFAULT_REACH: f64 = 0.5;
/// Damping of the same, as time constant `kd / kp`, s.
const DEFAULT_DAMPING_TIME: f64 = 0.025;
/// Largest position limit, rad or m, of a joint that the policy moves: single precision, in which it is observed, tells
/// thousandths of a radian apart up to here. Published files write larger numbers for no limit.
const LARGEST_LIMIT: f64 = 8192.0;

/// The position of each URDF joint that does not move: fixed ones, locked ones and those that mimic them.
pub(super) fn held(urdf: &Urdf, settings: &Settings, source: &Source) -> Result<Vec<Option<f64>>, RobotError> {
    let joints = &urdf.robot.joints;
    let found = |name: &Spanned<String>| (0..joints.len()).any(|joint| matches(name.get_ref(), &joints[joint].name));
    let moving = |name: &Spanned<String>| {
        (0..joints.len()).any(|joint| urdf.moves(joint) && matches(name.get_ref(), &joints[joint].name))
    };
    for name in &settings.locked {
        if !found(name) {
            return Err(no_joint(name, source, urdf));
        }
    }
    for name in settings.joint.iter().flat_map(|entry| &entry.get_ref().names) {
        if !found(name) {
            return Err(no_joint(name, source, urdf));
        }
        if !moving(name) {
            let message = format!("`{}` matches only joints that do not move", name.get_ref());
            return Err(source.error(name.span(), message, "settings are for joints that turn or slide"));
        }
    }
    Ok((0..urdf.robot.joints.len())
        .map(|joint| position_if_held(urdf, settings, joint))
        .collect())
}

fn position_if_held(urdf: &Urdf, settings: &Settings, joint: usize) -> Option<f64> {
    let name = &urdf.robot.joints[joint].name;
    if !urdf.moves(joint) {
        return Some(0.0);
    }
    if settings.locked.iter().any(|pattern| matches(pattern.get_ref(), name)) {
        return Some(settings.joint(name).nominal.map_or(0.0, |nominal| *nominal.get_ref()));
    }
    let mimic = urdf.robot.joints[joint].mimic.as_ref()?;
    let followed = position_if_held(urdf, settings, urdf.joint(&mimic.joint)?)?;
    Some(mimic.multiplier.unwrap_or(1.0) * followed + mimic.offset.unwrap_or(0.0))
}

fn no_joint(name: &Spanned<String>, source: &Source, urdf: &Urdf) -> RobotError {
    let names: Vec<&str> = (0..urdf.robot.joints.len())
        .filter(|&joint| urdf.moves(joint))
        .map(|joint| urdf.robot.joints[joint].name.as_str())
        .collect();
    let help = format!("the moving joints of {} are {}", urdf.source.file, names.join(", "));
    source.error(name.span(), format!("no joint matches `{}`", name.get_ref()), help)
}

/// The joints of the tree with their settings, and which of them move by themselves.
pub(super) fn build(
    urdf: &Urdf,
    tree: &Tree,
    settings: &Settings,
    source: &Source,
    notes: &mut Vec<String>,
) -> Result<(Vec<Joint>, Vec<usize>), RobotError> {
    let mut joints = Vec::with_capacity(tree.joints.len());
    for joint in &tree.joints {
        let (name, entry) = (
            &urdf.robot.joints[joint.urdf].name,
            settings.joint(&urdf.robot.joints[joint.urdf].name),
        );
        let limits = match (&entry.limits, urdf.limits[joint.urdf]) {
            (Some(limits), _) => (limits.get_ref()[0], limits.get_ref()[1]),
            (None, Some(limits)) => limits,
            (None, None) => (f64::NEG_INFINITY, f64::INFINITY),
        };
        let mimic = mimic(urdf, tree, joint.urdf);
        let dynamics = urdf.robot.joints[joint.urdf].dynamics.clone().unwrap_or_default();
        let value = |setting: &Option<Spanned<f64>>, default: f64| setting.as_ref().map_or(default, |s| *s.get_ref());
        joints.push(Joint {
            name: name.clone(),
            kind: joint.kind,
            parent: joint.parent,
            origin: joint.origin,
            axis: joint.axis,
            limits,
            nominal: nominal(&entry, limits, mimic.is_some(), source, name, notes)?,
            passive: Passive {
                armature: value(&entry.armature, 0.0),
                damping: value(&entry.damping, dynamics.damping),
                friction: value(&entry.friction, dynamics.friction),
            },
            actuator: match mimic {
                Some(_) => no_actuator(&entry, source, name).map(|()| None)?,
                None => actuator(&entry, &urdf.robot.joints[joint.urdf].limit, source, name, notes)?,
            },
            mimic,
        });
    }
    for index in 0..joints.len() {
        if let Some(mimic) = joints[index].mimic {
            joints[index].nominal = mimic.multiplier * joints[mimic.joint].nominal + mimic.offset;
        }
    }
    let dofs = (0..joints.len())
        .filter(|&joint| joints[joint].mimic.is_none())
        .collect();
    Ok((joints, dofs))
}

/// The coupling of a URDF joint to the joint at the end of its mimic chain.
fn mimic(urdf: &Urdf, tree: &Tree, joint: usize) -> Option<Mimic> {
    let (mut at, mut multiplier, mut offset) = (joint, 1.0, 0.0);
    while let Some(mimic) = &urdf.robot.joints[at].mimic {
        offset += multiplier * mimic.offset.unwrap_or(0.0);
        multiplier *= mimic.multiplier.unwrap_or(1.0);
        at = urdf.joint(&mimic.joint)?;
    }
    let followed = tree.joints.iter().position(|other| other.urdf == at)?;
    (at != joint).then_some(Mimic {
        joint: followed,
        multiplier,
        offset,
    })
}

fn nominal(
    entry: &JointEntry,
    (lower, upper): (f64, f64),
    follows: bool,
    source: &Source,
    name: &str,
    notes: &mut Vec<String>,
) -> Result<f64, RobotError> {
    let Some(nominal) = &entry.nominal else {
        let position = 0.0_f64.max(lower).min(upper);
        if position != 0.0 && !follows {
            notes.push(format!(
                "nominal position of `{name}`: {position}, the limit nearest to zero"
            ));
        }
        return Ok(position);
    };
    let position = *nominal.get_ref();
    if follows {
        let message = format!("`{name}` follows another joint and has no nominal position of its own");
        return Err(source.error(nominal.span(), message, "set the joint it follows"));
    }
    if position < lower || position > upper {
        let message = format!("nominal position {position} of `{name}` is outside its limits");
        return Err(source.error(nominal.span(), message, format!("choose from {lower} to {upper}")));
    }
    Ok(position)
}

fn no_actuator(entry: &JointEntry, source: &Source, name: &str) -> Result<(), RobotError> {
    let settings = [
        &entry.kp,
        &entry.kp_scale,
        &entry.kd,
        &entry.torque_limit,
        &entry.speed_limit,
    ];
    let Some(setting) = settings.into_iter().flatten().next() else {
        return Ok(());
    };
    let message = format!("`{name}` follows another joint and has no actuator");
    Err(source.error(setting.span(), message, "give the actuator to the joint it follows"))
}

/// The actuator from the TOML, completed by the URDF's effort and velocity; `None` if neither says anything.
fn actuator(
    entry: &JointEntry,
    limit: &urdf_rs::JointLimit,
    source: &Source,
    name: &str,
    notes: &mut Vec<String>,
) -> Result<Option<Actuator>, RobotError> {
    let positive = |value: f64| (value > 0.0 && value.is_finite()).then_some(value);
    let value = |setting: &Option<Spanned<f64>>| setting.as_ref().map(|setting| *setting.get_ref());
    let torque_limit = value(&entry.torque_limit).or(positive(limit.effort));
    let speed_limit = value(&entry.speed_limit).or(positive(limit.velocity));
    let (kp, kd) = (value(&entry.kp), value(&entry.kd));
    let asked = [
        &entry.kp,
        &entry.kp_scale,
        &entry.kd,
        &entry.torque_limit,
        &entry.speed_limit,
    ]
    .into_iter()
    .flatten()
    .next();
    let (Some(torque_limit), Some(speed_limit)) = (torque_limit, speed_limit) else {
        let missing = if torque_limit.is_none() {
            "torque_limit"
        } else {
            "speed_limit"
        };
        let Some(asked) = asked else {
            notes.push(format!(
                "`{name}` is passive: neither the URDF nor the TOML gives a torque and a speed limit above 0"
            ));
            return Ok(None);
        };
        let message = format!("the actuator of `{name}` has no {missing}, and the URDF gives none above 0");
        return Err(source.error(
            asked.span(),
            message,
            format!("add {missing} to an entry that matches it"),
        ));
    };
    if kp.is_none() || kd.is_none() {
        notes.push(format!(
            "gains of `{name}` are guessed from its torque limit: set kp and kd"
        ));
    }
    let kp = kp.unwrap_or(torque_limit / DEFAULT_REACH);
    let kd = kd.unwrap_or(kp * DEFAULT_DAMPING_TIME);
    Ok(Some(Actuator {
        kp,
        kp_scale: value(&entry.kp_scale).unwrap_or(1.0),
        kd,
        torque_limit,
        speed_limit,
    }))
}

/// The policy's joints as indices into `dofs`.
pub(super) fn policy(
    joints: &[Joint],
    dofs: &[usize],
    settings: &Settings,
    source: &Source,
    urdf: &Urdf,
    notes: &mut Vec<String>,
) -> Result<Vec<usize>, RobotError> {
    let can_move = |dof: usize| {
        let joint = &joints[dofs[dof]];
        joint.actuator.is_some() && joint.limits.0.abs().max(joint.limits.1.abs()) <= LARGEST_LIMIT
    };
    let Some(patterns) = &settings.policy else {
        let policy: Vec<usize> = (0..dofs.len()).filter(|&dof| can_move(dof)).collect();
        notes.push(format!(
            "policy joints: all {} with an actuator and limits",
            policy.len()
        ));
        return Ok(policy);
    };
    let mut policy = Vec::new();
    for pattern in patterns {
        let name = pattern.get_ref();
        let error = |message: String, help: &str| Err(source.error(pattern.span(), message, help));
        let exact = !name.contains('*');
        let found: Vec<usize> = (0..dofs.len())
            .filter(|&dof| matches(name, &joints[dofs[dof]].name))
            .collect();
        if found.is_empty() {
            if urdf.joint(name).is_some() {
                return error(
                    format!("`{name}` does not move by itself"),
                    "name joints that are not fixed, locked or mimics",
                );
            }
            return Err(no_joint(pattern, source, urdf));
        }
        for dof in found {
            let joint = &joints[dofs[dof]];
            if policy.contains(&dof) && exact {
                return error(format!("`{name}` is named twice"), "name each joint once");
            }
            if joint.limits.0.is_infinite() {
                return error(
                    format!("policy joint `{}` has no position limits", joint.name),
                    "add limits = [lower, upper] to an entry that matches it",
                );
            }
            if joint.limits.0.abs().max(joint.limits.1.abs()) > LARGEST_LIMIT {
                return error(
                    format!(
                        "policy joint `{}` has limits of {:e} to {:e}",
                        joint.name, joint.limits.0, joint.limits.1
                    ),
                    "add limits = [lower, upper] that it can reach to an entry that matches it",
                );
            }
            if joint.actuator.is_none() {
                return error(
                    format!("policy joint `{}` has no actuator", joint.name),
                    "add kp, kd, torque_limit and speed_limit to an entry that matches it",
                );
            }
            if !policy.contains(&dof) {
                policy.push(dof);
            }
        }
    }
    Ok(policy)
}
