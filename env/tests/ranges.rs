//! Values of effects that every environment draws: `[[range]]` in a robot's TOML.

use std::path::Path;
use std::sync::Arc;

use omniwalk_env::config::EnvConfig;
use omniwalk_env::effect::Kind;
use omniwalk_env::random::Stream;
use omniwalk_env::robot::{self, Robot, RobotError};
use omniwalk_env::{Batch, EnvError};

const KNEE: &str = r#"
[[effect]]
id = "command_gain"
match = ["left_knee_pitch"]
gain = 0.9

[[range]]
id = "command_gain"
match = ["left_knee_pitch"]
gain = [0.8, 1.0]

[[range]]
id = "coulomb_friction"
match = ["*_ankle_roll"]
torque = [0.1, 0.5]
"#;

/// The project's humanoid with `text` at the end of its TOML.
fn humanoid(text: &str) -> Result<Robot, RobotError> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/nimbro_op2x");
    let folder = tempfile::tempdir().expect("a folder");
    for entry in std::fs::read_dir(own).expect("the robot").flatten() {
        if entry.path().is_file() {
            std::fs::copy(entry.path(), folder.path().join(entry.file_name())).expect("a copy");
        }
    }
    let toml = folder.path().join("robot.toml");
    let settings = std::fs::read_to_string(&toml).expect("its TOML") + text;
    std::fs::write(toml, settings).expect("written");
    robot::load(folder.path())
}

fn drawn_by(robot: &Robot, environment: u64) -> [f64; 3] {
    let drawn = robot.drawn(&mut Stream::new(1, environment, 0));
    let gain = drawn.effects.iter().find(|effect| effect.kind == Kind::CommandGain);
    let friction = |side: &str| {
        let name = format!("{side}_ankle_roll");
        let joint = drawn.joints.iter().find(|joint| joint.name == name);
        joint.expect("an ankle").passive.friction
    };
    [gain.expect("the effect").values[0], friction("left"), friction("right")]
}

#[test]
fn values_are_drawn_within_their_ranges_by_the_seed_alone() {
    let robot = humanoid(KNEE).expect("a robot");
    assert_eq!(robot.ranges.len(), 3);
    let draws: Vec<[f64; 3]> = (0..200).map(|e| drawn_by(&robot, e)).collect();
    assert!(
        draws
            .iter()
            .enumerate()
            .all(|(e, draw)| *draw == drawn_by(&robot, e as u64))
    );
    for (i, (lower, upper)) in [(0.8, 1.0), (0.1, 0.5), (0.1, 0.5)].into_iter().enumerate() {
        let column = || draws.iter().map(|draw| draw[i]);
        assert!(column().all(|value| (lower..=upper).contains(&value)));
        let (least, most) = (column().fold(upper, f64::min), column().fold(lower, f64::max));
        assert!(most - least > 0.9 * (upper - lower), "{least} to {most}");
    }
    assert!(draws.iter().all(|[_, left, right]| left != right));
}

/// The default without anything random.
fn still(effects: bool) -> EnvConfig {
    let mut config: EnvConfig = toml::from_str(include_str!("../../configs/default.toml")).expect("the defaults");
    config.noise.enabled = false;
    config.latency.enabled = false;
    config.push.enabled = false;
    config.friction.enabled = false;
    config.randomise.pd_noise = 0.0;
    config.randomise.mass = 0.0;
    config.randomise.centre_of_mass = 0.0;
    config.randomise.start_position = 0.0;
    config.randomise.effects = effects;
    // Environments in the other half of the cycle would have the mirror image of the action.
    config.clock.symmetric = false;
    config
}

/// Positions of the joints of every environment after some steps, as bits.
fn moved(batch: &mut Batch) -> Vec<Vec<u64>> {
    let joints = batch.shared().spec.action_len();
    let actions = vec![0.6; batch.environments() * joints];
    (0..8).for_each(|_| batch.step(&actions));
    let of = |e: usize| {
        let (_, engine, world) = batch.look(e);
        let positions = &engine.joints().position;
        let worlds = positions.len() / batch.shared().robot.dofs.len();
        positions
            .iter()
            .skip(world)
            .step_by(worlds)
            .map(|q| q.to_bits())
            .collect()
    };
    (0..batch.environments()).map(of).collect()
}

#[test]
fn every_environment_has_its_own_values_unless_they_are_switched_off() -> Result<(), EnvError> {
    let robot = Arc::new(humanoid(KNEE).expect("a robot"));
    let batch = |effects, seed| Batch::new(robot.clone(), &still(effects), 3, seed);
    let same = moved(&mut batch(false, 7)?);
    assert!(same[0] == same[1] && same[0] == same[2]);
    let apart = moved(&mut batch(true, 7)?);
    assert!(apart[0] != apart[1] && apart[0] != apart[2] && apart[1] != apart[2]);
    assert_eq!(apart, moved(&mut batch(true, 7)?));
    let mut other = batch(true, 8)?;
    other.reseed(7);
    assert_eq!(apart, moved(&mut other), "a batch with another seed is a new one");
    Ok(())
}

#[test]
fn ranges_that_mean_nothing_are_refused_where_they_stand() {
    let effect = KNEE.split_once("[[range]]").expect("ranges").0;
    let range = |id: &str, joint: &str, rest: &str| {
        format!("{effect}[[range]]\nid = \"{id}\"\nmatch = [\"{joint}\"]\n{rest}\n")
    };
    for (text, says) in [
        (
            range("mass", "*_knee_pitch", "factor = [0.9, 1.1]"),
            "no range for \"mass\"",
        ),
        (range("nothing", "*_knee_pitch", ""), "no range for \"nothing\""),
        (
            range("command_gain", "right_knee_pitch", "gain = [0.8, 1.0]"),
            "`right_knee_pitch` has no `command_gain`",
        ),
        (
            range("command_gain", "left_knee_pitch", "gain = [1.0, 0.8]"),
            "no range of `command_gain`'s values",
        ),
        (
            range("command_gain", "left_knee_pitch", "gain = [0.8, 0.9, 1.0]"),
            "no range of `command_gain`'s values",
        ),
        (
            range("command_gain", "left_knee_pitch", "gain = [0.8, 1e6]"),
            "no range of `command_gain`'s values",
        ),
        (
            range("command_gain", "left_knee_pitch", "gain = 0.8"),
            "no range of `command_gain`'s values",
        ),
        (
            range("command_gain", "left_knee_pitch", "gian = [0.8, 1.0]"),
            "`command_gain` has no `gian`",
        ),
        (
            range("command_gain", "*_tail", "gain = [0.8, 1.0]"),
            "no joint matches `*_tail`",
        ),
        (format!("{effect}[[range]]\nmatch = [\"left_knee_pitch\"]\n"), "`id`"),
    ] {
        let error = humanoid(&text).expect_err("a refusal").to_string();
        assert!(error.contains(says), "{error}");
    }
}
