//! A trunk on a leg that stands on the ground and sways, and what is found in its logs.

use omniwalk_env::effect::{self, Effect, Kind};
use omniwalk_env::robot::Robot;
use omniwalk_sim2real::identify::{Outcome, Verdict, replay};
use omniwalk_sim2real::recording::Recording;

use super::record::{NOISE, record, record_on_rigid_ground};
use super::rig::{Files, identify_files, identify_files_aloud, load};
use super::{goes_on, named};

const URDF: &str = r#"<robot name="swayer"><link name="trunk"><inertial><origin xyz="0 0 0.1"/><mass value="4"/><inertia ixx="0.05" iyy="0.05" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="leg"><inertial><origin xyz="0 0 -0.15"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="foot"><inertial><mass value="0.5"/><inertia ixx="0.002" iyy="0.004" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hip" type="revolute"><parent link="trunk"/><child link="leg"/><axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="30" velocity="8"/></joint>
<joint name="ankle" type="revolute"><parent link="leg"/><child link="foot"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="30" velocity="8"/></joint></robot>"#;
const TOML: &str = "base = \"floating\"\n[[joint]]\nmatch = [\"*\"]\nkp = 60.0\nkd = 1.5\ntorque_limit = 30.0\nspeed_limit = 8.0\narmature = 0.02\ndamping = 0.1\nfriction = 0.2\n[[foot]]\nlink = \"foot\"\nsole = [0.0, 0.0, -0.04]\nsize = [0.26, 0.2]\n";
const FILES: Files = (URDF, TOML);
/// Degree of freedom of the ankle.
const ANKLE: usize = 1;

/// The robot with an effect at its ankle.
fn walker(effect: Option<(Kind, &[f64])>) -> Robot {
    let mut robot = load(FILES);
    assert_eq!(robot.dof(ANKLE).name, "ankle");
    if let Some((kind, values)) = effect {
        effect::apply(&mut robot, &Effect::new(kind, ANKLE, values));
    }
    robot
}

/// What a log's robot stands on.
#[derive(Clone, Copy)]
enum Ground {
    /// The model's.
    Own,
    /// Rapier's, which is rigid.
    Rigid,
}

/// Logs in which it sways about its ankle, its trunk leaning a little.
fn logs(truth: &Robot, ground: Ground, count: u64, first: u64) -> Vec<Recording> {
    let log = |seed: u64| {
        let (a, w) = (0.08 + 0.01 * (seed % 4) as f64, 3.0 + 0.7 * (seed % 5) as f64);
        let sway = move |t: f64| a * (w * t).sin() + 0.03 * (2.3 * w * t).sin();
        let lean = move |t: f64| 0.15 * (1.7 * w * t + seed as f64).sin() * (t / 0.5).min(1.0);
        let target = |d, t| if d != ANKLE { lean(t) - sway(t) } else { sway(t) };
        match ground {
            Ground::Own => record(truth, seed, target),
            Ground::Rigid => record_on_rigid_ground(truth, seed, target),
        }
    };
    (first..first + count).map(log).collect()
}

/// What is found in `logs`.
fn found(logs: Vec<Recording>, heldout: Vec<Recording>) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    identify_files(folder.path(), FILES, &walker(None), logs, Some(heldout))
}

#[test]
fn what_stands_on_the_ground_is_followed_down_to_the_noise() {
    let robot = walker(None);
    let error = |logs: &[Recording]| replay(&robot, logs).expect("a replay").measure.overall();
    let late = walker(Some((Kind::CommandDelay, &[0.01])));
    for ground in [Ground::Own, Ground::Rigid] {
        let [own, late] = [&robot, &late].map(|truth| error(&logs(truth, ground, 3, 0)));
        // The ankle sways at up to 0.5 rad/s: 10 ms late it is 5 mrad off at most. Much of that another ground could have done, but no
        // less is left than what counts as more than noise: 1.5 times its square.
        assert!(own < 1.2 * NOISE && late * late > 1.5 * own * own, "{own} {late}");
    }
}

#[test]
fn threads_change_no_bit_of_starts() {
    let (robot, logs) = (walker(None), logs(&walker(None), Ground::Own, 1, 0));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let replay = pool
            .expect("threads")
            .install(|| replay(&robot, &logs))
            .expect("a replay");
        // Starts are fitted within 0.02 rad and 0.1 rad/s of what the inertial unit says, along every axis.
        let [turned, turning] = ["orientation", "angular_velocity"].map(|own| replay.measure.by_quantity[own]["rmse"]);
        assert!(turned < 0.03 && turning < 0.17, "{turned} {turning}");
        replay.measure.overall().to_bits()
    };
    assert_eq!(with(1), with(2));
}

#[test]
fn what_was_interrupted_goes_on_to_the_same_bits() {
    let truth = walker(None);
    goes_on("re-tuned", |folder, log| {
        identify_files_aloud((folder, FILES), &truth, logs(&truth, Ground::Own, 2, 0), None, log)
    });
}

#[test]
fn whatever_it_stands_on_nothing_is_missing() {
    let truth = walker(None);
    for ground in [Ground::Own, Ground::Rigid] {
        let outcome = found(logs(&truth, ground, 3, 0), logs(&truth, ground, 1, 100));
        assert_eq!(outcome.verdict, Verdict::NoMissingEffect, "{:?}", named(&outcome));
        assert!(outcome.refit.heldout.overall() < 1.5 * NOISE);
    }
}

#[test]
fn a_delay_is_named_where_the_robot_stands_freely() {
    let truth = walker(Some((Kind::CommandDelay, &[0.02])));
    let outcome = found(logs(&truth, Ground::Rigid, 2, 0), logs(&truth, Ground::Rigid, 1, 100));
    let named = named(&outcome);
    assert!(
        named.iter().any(|name| name == "command_delay"),
        "{:?} {named:?}",
        outcome.verdict
    );
    assert!(
        outcome
            .accepted
            .iter()
            .all(|a| a.target == "ankle" && a.effect.ends_with("_delay"))
    );
}

#[test]
fn of_a_fall_nothing_is_concluded() {
    // It kicks itself off the ground time and again: what the ground does is more than what the model could lack.
    let robot = walker(Some((Kind::CoulombFriction, &[2.0])));
    let kick = |_, t: f64| if (4.0 * t).fract() < 0.5 { 0.6 } else { -0.6 };
    let logs: Vec<Recording> = (0..2).map(|seed| record_on_rigid_ground(&robot, seed, kick)).collect();
    let outcome = found(logs, Vec::new());
    assert!(outcome.accepted.is_empty(), "{:?}", named(&outcome));
    assert_ne!(outcome.verdict, Verdict::NoMissingEffect);
}

#[test]
fn a_log_that_does_not_say_how_the_base_was_is_refused() {
    let robot = walker(None);
    let mut log = logs(&robot, Ground::Own, 1, 0);
    log[0].imu = None;
    let refused = replay(&robot, &log).map(|_| ()).expect_err("a refusal");
    assert!(
        refused.to_string().contains("does not say how it is oriented"),
        "{refused}"
    );
}
