//! `robot.toml` as text, with a comment at everything that is a guess.

use std::fmt::Write;

use omniwalk_env::robot::{Foot, JointKind, Robot};

use super::Findings;
use super::actuators::Servo;
use super::training::round;

/// The settings of the robot that loads `bare` from its URDF alone.
pub(super) fn settings(bare: &Robot, found: &Findings) -> String {
    let mut text = format!(
        "# {}: written by `omniwalk init` from its URDF. Lines that say `guess` are guesses: put the robot's own numbers there.\n\n",
        bare.name
    );
    text += if found.legs.is_empty() {
        "base = \"fixed\"\n"
    } else {
        "base = \"floating\"\n"
    };
    text += &locked(&found.locked);
    text += &policy(found);
    text += &overlap(bare, found);
    let mut left = found.servos.iter().collect::<Vec<_>>();
    while let Some(servo) = left.first().copied() {
        let twin = found.sides.and_then(|sides| sides.of_left(&servo.joint));
        let twin = twin.filter(|twin| left.iter().any(|other| other.joint == *twin && alike(servo, other)));
        text += &joint(servo, twin.as_deref(), bare);
        left.retain(|other| other.joint != servo.joint && Some(&other.joint) != twin.as_ref());
    }
    if !found.nominal.is_empty() {
        text += "\n# The standing pose.\n";
    }
    for (name, position) in &found.nominal {
        let _ = writeln!(
            text,
            "[[joint]]\nmatch = [{}]\nnominal = {position:?} # rad, guess\n",
            quoted(name)
        );
    }
    found.legs.iter().for_each(|leg| text += &foot(&leg.foot, bare));
    if let Some(sides) = found.sides.filter(|_| !found.legs.is_empty()) {
        let _ = writeln!(
            text,
            "\n# What names of joints on the left and right begin or end with, guess.\n[mirror]\nleft = {}\nright = {}",
            quoted(sides.left),
            quoted(sides.right)
        );
    }
    text
}

/// The line that holds joints rigidly, if there are any.
pub(super) fn locked(joints: &[String]) -> String {
    if joints.is_empty() {
        return String::new();
    }
    let names: Vec<String> = joints.iter().map(|joint| quoted(joint)).collect();
    format!("locked = [{}] # guess: they move no mass\n", names.join(", "))
}

/// The policy moves the legs; the other joints hold the pose.
fn policy(found: &Findings) -> String {
    if found.legs.is_empty() {
        return String::new();
    }
    let of = |in_leg: bool| {
        let chosen = found.servos.iter().filter(move |servo| servo.in_leg == in_leg);
        chosen.map(|servo| quoted(&servo.joint)).collect::<Vec<_>>()
    };
    let mut text = format!("policy = [{}] # guess: the joints of the legs\n", of(true).join(", "));
    if !of(false).is_empty() {
        let _ = writeln!(
            text,
            "# These hold their nominal position; to let the policy move some, add them to `policy`: {}",
            of(false).join(", ")
        );
    }
    text
}

/// Feet and shanks may not pass through each other.
fn overlap(bare: &Robot, found: &Findings) -> String {
    let [left, right] = &found.legs[..] else {
        return String::new();
    };
    let shank = |leg: &super::legs::Leg| leg.pitch.get(1).map(|&(dof, _)| bare.dofs[dof] + 1);
    let mut pairs = vec![(left.foot.link, right.foot.link)];
    pairs.extend(shank(left).zip(shank(right)).filter(|pair| *pair != pairs[0]));
    let name = |link: usize| quoted(&bare.links[link].name);
    let pairs: Vec<String> = pairs
        .iter()
        .map(|&(a, b)| format!("[{}, {}]", name(a), name(b)))
        .collect();
    format!(
        "overlap_pairs = [{}] # guess: links that may not pass through each other\n",
        pairs.join(", ")
    )
}

fn alike(a: &Servo, b: &Servo) -> bool {
    let values = |servo: &Servo| {
        let known = [servo.kp, servo.kd, servo.armature].map(round);
        (
            known,
            servo.torque_limit.map(round),
            servo.speed_limit.map(round),
            servo.limits,
        )
    };
    values(a) == values(b)
}

fn joint(servo: &Servo, twin: Option<&str>, bare: &Robot) -> String {
    let slides = bare
        .joints
        .iter()
        .any(|joint| joint.name == servo.joint && joint.kind == JointKind::Prismatic);
    let (torque, angle, inertia) = if slides {
        ("N", "m", "kg")
    } else {
        ("N m", "rad", "kg m^2")
    };
    let names: Vec<String> = [Some(servo.joint.as_str()), twin]
        .into_iter()
        .flatten()
        .map(quoted)
        .collect();
    let mut text = format!("\n[[joint]]\nmatch = [{}]\n", names.join(", "));
    let mut line = |key: &str, value: String, unit: &str| {
        let _ = writeln!(text, "{:<32}# {unit}, guess", format!("{key} = {value}"));
    };
    line("kp", round(servo.kp), &format!("{torque}/{angle}"));
    line("kd", round(servo.kd), &format!("{torque} s/{angle}"));
    line("armature", round(servo.armature), inertia);
    if let Some(limit) = servo.torque_limit {
        line("torque_limit", round(limit), torque);
    }
    if let Some(limit) = servo.speed_limit {
        line("speed_limit", round(limit), &format!("{angle}/s"));
    }
    if let Some(limits) = servo.limits {
        line("limits", format!("{limits:?}"), angle);
    }
    text
}

fn foot(foot: &Foot, bare: &Robot) -> String {
    let (roll, pitch, yaw) = foot.sole.rotation.euler_angles();
    let list = |values: &[f64]| {
        // To tenths of millimetres; `+ 0.0` has no negative zeros.
        let values = values
            .iter()
            .map(|value| format!("{:?}", (1e4 * value).round() / 1e4 + 0.0));
        values.collect::<Vec<_>>().join(", ")
    };
    format!(
        "\n[[foot]]\nname = {}\nlink = {}\nsole = [{}] # centre in the link's frame, m, guess\nrpy = [{}] # its turn there, rad, guess\nsize = [{}] # length and width, m, guess\n",
        quoted(&foot.name),
        quoted(&bare.links[foot.link].name),
        list(foot.sole.translation.vector.as_slice()),
        list(&[roll, pitch, yaw]),
        list(&foot.half_extents.map(|half| 2.0 * half)),
    )
}

/// A name as a TOML string, whatever is in it.
fn quoted(name: &str) -> String {
    toml::Value::String(name.to_owned()).to_string()
}
