//! Two arms on one base, of which each is looked at by itself, and one arm of several joints.

use omniwalk_env::effect::{self, Effect, Kind, Table, Variable};
use omniwalk_env::robot::Robot;
use omniwalk_sim2real::identify::{Alternative, Verdict};
use omniwalk_sim2real::recording::Recording;

use super::record::record;
use super::rig::{Files, identify_files, load};

const URDF: &str = r#"<robot name="arms"><link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="left_arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="right_arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="left" type="continuous"><parent link="base"/><child link="left_arm"/><axis xyz="0 1 0"/></joint>
<joint name="right" type="continuous"><parent link="base"/><child link="right_arm"/><axis xyz="0 1 0"/></joint></robot>"#;
/// Three joints one after the other, each with a bob of its own.
const CHAIN: &str = r#"<robot name="chain"><link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="upper"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="middle"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="first" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="second" type="continuous"><parent link="upper"/><child link="middle"/><axis xyz="1 0 0"/></joint>
<joint name="third" type="continuous"><parent link="middle"/><child link="lower"/><axis xyz="0 1 0"/></joint></robot>"#;
const TOML: &str = "base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\nkp = 3.0\nkd = 0.05\ntorque_limit = 1.5\nspeed_limit = 12.0\narmature = 0.003\ndamping = 0.02\nfriction = 0.04\n";
const FILES: Files = (URDF, TOML);

/// `count` logs of `truth`, the first of them number `first`, in which every joint swings at a pace of its own.
fn swings(truth: &Robot, count: u64, first: u64) -> Vec<Recording> {
    let log = |seed: u64| {
        let beat = 1.3 + 0.4 * (seed % 7) as f64;
        record(truth, seed, |d, t| {
            let phase = (beat + 0.3 * d as f64) * t;
            0.5 * phase.sin() + 0.4 * (2.7 * phase).sin()
        })
    };
    (first..first + count).map(log).collect()
}

#[test]
fn what_each_arm_lacks_is_named_with_its_joint() {
    let nominal = load(FILES);
    let [left, right] = ["left", "right"].map(|name| {
        (0..2)
            .find(|&d| nominal.dof(d).name == name)
            .expect("a joint of the robot")
    });
    let mut truth = nominal.clone();
    truth.joints[truth.dofs[left]].passive.damping *= 2.0;
    effect::apply(&mut truth, &Effect::new(Kind::CommandRateLimit, right, &[2.0]));
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = identify_files(
        folder.path(),
        FILES,
        &nominal,
        swings(&truth, 4, 1),
        Some(swings(&truth, 2, 100)),
    );
    assert_eq!(outcome.verdict, Verdict::Explained);
    let named = outcome.accepted.iter().map(|a| (a.effect, a.target.as_str()));
    assert_eq!(named.collect::<Vec<_>>(), [("command_rate_limit", "right")]);
    assert!(outcome.gap_closed.expect("a gap") > 0.8);
    let damping = |joint: &str| {
        let retuned = &outcome.retuned[joint];
        retuned["damping"].value + retuned["kd"].value
    };
    assert!((damping("left") / 0.09 - 1.0).abs() < 0.05, "{}", damping("left"));
    assert!((damping("right") / 0.07 - 1.0).abs() < 0.05, "{}", damping("right"));
}

/// What the third joint lacks is in no library, and too little to be seen in the sum over all three.
#[test]
fn what_one_joint_lacks_is_not_lost_among_the_others_of_its_arm() {
    let files = (CHAIN, TOML);
    let nominal = load(files);
    let third = (0..3).find(|&d| nominal.dof(d).name == "third").expect("a joint");
    let mut truth = nominal.clone();
    let spring = Table {
        axes: vec![(Variable::Position, vec![-2.0, 0.1, 1.1])],
        values: vec![0.0, 0.0, -0.02],
        friction: false,
    };
    effect::apply(&mut truth, &Effect::of_table(third, spring));
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = identify_files(
        folder.path(),
        files,
        &nominal,
        swings(&truth, 2, 1),
        Some(swings(&truth, 1, 100)),
    );
    assert_eq!(outcome.verdict, Verdict::Unexplained);
    assert_eq!(outcome.unexplained.depends_on[0], "position of third");
}

/// A load in the middle of the arm, most of which other gains make up for; with these logs other links may weigh more instead.
#[test]
fn what_an_arm_carries_is_named_and_not_made_up_for_by_its_gains() {
    let files = (CHAIN, TOML);
    let nominal = load(files);
    let middle = nominal
        .links
        .iter()
        .position(|link| link.name == "middle")
        .expect("a link");
    let mut truth = nominal.clone();
    effect::apply(&mut truth, &Effect::new(Kind::Payload, middle, &[0.05, 0.0, 0.0, -0.1]));
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = identify_files(
        folder.path(),
        files,
        &nominal,
        swings(&truth, 2, 1),
        Some(swings(&truth, 1, 100)),
    );
    let middle = |effect: &Alternative| effect.effect == "payload" && effect.target == "middle";
    let named = outcome.alternatives.iter().flatten().find(|effect| middle(effect));
    let mass = named.expect("what it carries").parameters["mass"].value;
    assert!((mass / 0.05 - 1.0).abs() < 0.1, "{mass}");
    assert!(outcome.accepted.is_empty() && outcome.verdict == Verdict::Indistinguishable);
    assert!(outcome.gap_closed.expect("a gap") > 0.8);
}
