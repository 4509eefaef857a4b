//! A bob on a servo, and logs of it.

use std::path::Path;

use omniwalk_env::effect::{self, Effect, Kind};
use omniwalk_env::robot::{self, Robot};
use omniwalk_sim2real::identify::{self, Outcome, Task};
use omniwalk_sim2real::recording::Recording;

use super::record::record;

const URDF: &str = r#"<robot name="rig"><link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
const TOML: &str = "base = \"fixed\"\n[[joint]]\nmatch = [\"hinge\"]\nkp = 3.0\nkd = 0.05\ntorque_limit = 1.5\nspeed_limit = 12.0\narmature = 0.003\ndamping = 0.02\nfriction = 0.04\n";

/// The files of a robot: its URDF, and its TOML.
pub type Files = (&'static str, &'static str);

/// The rig's.
pub const RIG: Files = (URDF, TOML);

/// The same rig, of whose servo only the limits are told.
pub const LIMITS_ALONE: Files = (
    URDF,
    "base = \"fixed\"\n[[joint]]\nmatch = [\"hinge\"]\ntorque_limit = 1.5\nspeed_limit = 12.0\narmature = 0.003\ndamping = 0.02\nfriction = 0.04\n",
);

/// The same rig, of which is known that its commands are late, and pushed.
pub const PUSHED: Files = (
    URDF,
    "base = \"fixed\"\n[[joint]]\nmatch = [\"hinge\"]\nkp = 3.0\nkd = 0.05\ntorque_limit = 1.5\nspeed_limit = 12.0\narmature = 0.003\ndamping = 0.02\nfriction = 0.04\n\
        [[effect]]\nid = \"command_delay\"\nmatch = [\"hinge\"]\ntime = 0.01\n[[effect]]\nid = \"external_force\"\nmatch = [\"hinge\"]\ntorque = -0.05\n\
        [[range]]\nid = \"external_force\"\nmatch = [\"hinge\"]\ntorque = [-0.06, -0.04]\n",
);

/// Writes the files of a robot into `folder`.
fn write(folder: &Path, (urdf, toml): Files) {
    std::fs::write(folder.join("rig.urdf"), urdf).expect("written");
    std::fs::write(folder.join("robot.toml"), toml).expect("written");
}

/// The robot of `files`.
pub fn load(files: Files) -> Robot {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), files);
    robot::load(folder.path()).expect("a robot")
}

/// The rig with effects.
pub fn rig(effects: &[(Kind, &[f64])]) -> Robot {
    let mut robot = load(RIG);
    for (kind, values) in effects {
        effect::apply(&mut robot, &Effect::new(*kind, 0, values));
    }
    robot
}

/// Target of log `seed` at `t`.
fn target(seed: u64, t: f64) -> f64 {
    let (a, b) = (0.3 + 0.13 * (seed % 5) as f64, 1.3 + 0.4 * (seed % 7) as f64);
    match seed % 3 {
        0 => a * (b * t).sin() + 0.4 * (2.7 * b * t).sin(),
        1 => 1.2 * (b * t / std::f64::consts::TAU + 0.25).fract().mul_add(4.0, -2.0).abs() - 1.2,
        _ => (a + 0.4) * if (0.5 * b * t).sin() > 0.0 { 1.0 } else { -0.6 },
    }
}

/// `count` logs of `truth`, the first of them number `first`.
pub fn logs(truth: &Robot, count: u64, first: u64) -> Vec<Recording> {
    let log = |seed| record(truth, seed, |_, t| target(seed, t));
    (first..first + count).map(log).collect()
}

/// Identifies `robot` from `logs`.
pub fn identify(robot: &Robot, logs: Vec<Recording>, heldout: Option<Vec<Recording>>) -> Outcome {
    identify_into(tempfile::tempdir().expect("a folder").path(), robot, logs, heldout)
}

/// The same, what is written into `folder`.
pub fn identify_into(folder: &Path, robot: &Robot, logs: Vec<Recording>, heldout: Option<Vec<Recording>>) -> Outcome {
    identify_files(folder, RIG, robot, logs, heldout)
}

/// Identifies `robot`, of `files`, from `logs`; what is written goes into `folder`.
pub fn identify_files(
    folder: &Path,
    files: Files,
    robot: &Robot,
    logs: Vec<Recording>,
    heldout: Option<Vec<Recording>>,
) -> Outcome {
    identify_files_aloud((folder, files), robot, logs, heldout, &|line| println!("{line}"))
}

/// The same; `log` hears of progress.
pub fn identify_files_aloud(
    (folder, files): (&Path, Files),
    robot: &Robot,
    logs: Vec<Recording>,
    heldout: Option<Vec<Recording>>,
    log: &dyn Fn(&str),
) -> Outcome {
    write(folder, files);
    let open = || Ok(heldout.clone().unwrap_or_default());
    let task = Task {
        robot,
        files: (folder.join("rig.urdf"), Some(folder.join("robot.toml"))),
        logs,
        heldout: heldout.is_some().then_some(&open),
        compare: false,
        out: folder,
    };
    let outcome = identify::run(&task, log).expect("an outcome");
    identify::close(folder).expect("removed");
    no_effect_may_be_none(&outcome);
    outcome
}

/// Every effect that is named and has sizes has an interval of one of them that does not hold that of no effect.
fn no_effect_may_be_none(outcome: &Outcome) {
    for accepted in &outcome.accepted {
        let kind = Kind::named(accepted.effect).expect("a kind");
        let sizes = kind.info().parameters.iter().filter_map(|p| Some((p.name, p.neutral?)));
        let sizes: Vec<(&str, f64)> = sizes.collect();
        let certain = |(name, none): &(&str, f64)| {
            let interval = accepted.parameters.get(*name).and_then(|parameter| parameter.ci95);
            interval.is_some_and(|[low, high]| *none < low || *none > high)
        };
        assert!(sizes.is_empty() || sizes.iter().any(certain), "{accepted:?}");
    }
}
