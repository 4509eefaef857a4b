//! The configurations of the project: all of them load, and the thesis's holds what the thesis states.

use std::fs;
use std::path::{Path, PathBuf};

use omniwalk::config::Layers;
use omniwalk::settings::{DEFAULT, Settings};
use omniwalk_env::robot;
use omniwalk_env::task::shared::spec;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("configs")
}

/// The settings of a file of `configs/`, and the whole of them as TOML.
fn load(file: &Path) -> (Settings, toml::Value) {
    let layers = Layers::new(DEFAULT).expect("the defaults").file(file);
    let built = layers.and_then(|layers| layers.build::<Settings>());
    let (settings, text) = built.unwrap_or_else(|error| panic!("{}: {error:?}", file.display()));
    (settings, toml::from_str(&text).expect("the effective configuration"))
}

#[test]
fn every_configuration_of_the_project_loads() {
    let files = fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path());
    let files: Vec<PathBuf> = files
        .filter(|file| file.extension().is_some_and(|e| e == "toml"))
        .collect();
    for name in ["default.toml", "forward.toml", "thesis.toml"] {
        assert!(files.contains(&folder().join(name)), "{name}");
    }
    files.iter().for_each(|file| drop(load(file)));
}

/// Every value that chapter 7 states: key, value, section.
const STATED: [(&str, &str, &str); 65] = [
    ("engine.physics_hz", "1000", "7.5"),
    ("engine.control_hz", "40", "7.5"),
    ("action.law", "\"increment_on_measured\"", "7.3.2"),
    ("action.filter.enabled", "true", "7.4"),
    ("action.filter.kind", "\"butterworth\"", "7.4"),
    ("action.filter.cutoff_hz", "10.0", "7.4"),
    ("clock.enabled", "false", "7.3.1: the state has none"),
    ("command.lower", "[-0.6, -0.6, -0.6]", "7.5"),
    ("command.upper", "[0.6, 0.6, 0.6]", "7.5"),
    ("command.zero_share", "0.0", "7.3.5: a uniform distribution"),
    ("command.axis_share", "0.0", "7.3.5: a uniform distribution"),
    ("command.resample_seconds", "0.0", "7.3.5: each episode"),
    ("task.episode_seconds", "20.0", "7.5: 800 time steps of 25 ms"),
    ("reward.velocity_weight", "42.0", "7.5"),
    ("reward.velocity_kernel", "9.0", "7.5"),
    ("reward.velocity_filter", "0.0", "7.9: the current velocity"),
    ("reward.commanded_heading", "false", "7.9: the inertial frame"),
    ("reward.pose_weight", "4.0", "7.5"),
    ("reward.pose_kernel", "3.0", "7.5"),
    ("reward.alive_weight", "4.0", "7.5"),
    ("reward.foot_weight", "18.0", "7.5"),
    ("reward.foot_kernel", "10.0", "7.5"),
    ("reward.clock_swing", "false", "7.3.3: by height"),
    ("reward.action_rate_weight", "0.0", "7.8: four terms"),
    ("reward.slip_weight", "0.0", "7.8: four terms"),
    ("reward.tap_weight", "0.0", "7.8: four terms"),
    ("noise.enabled", "true", "7.4"),
    ("noise.gyro", "1e-4", "7.5"),
    ("noise.accelerometer", "1e-4", "7.5"),
    ("noise.position", "1e-3", "7.5"),
    ("noise.velocity", "1e-3", "7.5"),
    ("latency.enabled", "true", "7.4"),
    ("latency.lower", "0.0", "7.5"),
    ("latency.upper", "0.05", "7.5"),
    ("friction.enabled", "true", "7.4"),
    ("friction.tangential", "[0.4, 0.8]", "7.5"),
    ("friction.torsional", "[0.1, 0.3]", "7.5"),
    ("friction.rolling", "[0.0, 0.2]", "7.5"),
    ("randomise.pd_noise", "0.1", "7.5"),
    ("randomise.mass", "0.0", "7.4: masses are from CAD"),
    ("randomise.centre_of_mass", "0.0", "7.4: masses are from CAD"),
    ("randomise.start_position", "0.0", "7.3.6: the standing position"),
    ("push.enabled", "false", "7.4: no pushes in training"),
    ("curriculum.core", "[0.4, 0.0, 0.0]", "7.5"),
    ("curriculum.scheduler", "true", "7.3.5"),
    ("curriculum.gated", "false", "7.3.5: by the episode alone"),
    ("curriculum.velocity_start", "0.01", "7.5"),
    ("curriculum.velocity_decay", "0.95", "7.5"),
    ("curriculum.velocity_gate_foot", "0.0", "7.3.3: each epoch"),
    ("curriculum.foot_start", "0.05", "7.5"),
    ("curriculum.foot_decay", "0.995", "7.5"),
    ("ppo.hidden", "[512, 512]", "7.3.4"),
    ("ppo.activation", "\"tanh\"", "7.3.4"),
    ("ppo.policy", "\"beta\"", "7.3.2"),
    ("ppo.learning_rate", "1e-4", "7.5"),
    ("ppo.schedule.type", "\"fixed\"", "7.5"),
    ("ppo.gamma", "0.99", "7.5"),
    ("ppo.lambda", "0.97", "7.5"),
    ("ppo.epochs", "10", "7.5"),
    ("ppo.dual_clip", "0.0", "7.2: PPO as published"),
    ("ppo.minibatch", "480", "7.5"),
    ("train.environments", "12", "7.5"),
    ("train.steps_per_update", "800", "7.5"),
    ("train.steps", "71_040_000", "7.5: 7400 updates of 9600 time steps"),
    ("train.mirror", "false", "7.3: none"),
];

#[test]
fn the_thesis_configuration_holds_every_value_the_thesis_states() {
    let (settings, effective) = load(&folder().join("thesis.toml"));
    for (key, value, section) in STATED {
        let found = key.split('.').try_fold(&effective, |table, key| table.get(key));
        let stated: toml::Table = toml::from_str(&format!("value = {value}")).unwrap();
        assert_eq!(found, stated.get("value"), "{key}, section {section}");
    }
    assert_eq!(settings.train.environments * settings.train.steps_per_update, 9600);
    assert_eq!(settings.train.steps, 7400 * 9600);
}

#[test]
fn an_engine_is_chosen_by_a_word_and_a_key_by_its_last_part() {
    let defaults = || Layers::new(DEFAULT).expect("the defaults");
    let effective = |layers: Layers| layers.build::<Settings>().expect("a configuration").1;
    let rapier = effective(defaults().set("engine.kind=rapier").expect("a change"));
    assert_ne!(rapier, effective(defaults()));
    assert_eq!(
        rapier,
        effective(defaults().text("a.toml", "engine = \"rapier\"").expect("a file"))
    );
    assert_eq!(rapier, effective(defaults().set("engine=rapier").expect("a change")));
    let forced = effective(defaults().set("engine.simd=f32x8").expect("a change"));
    assert_ne!(forced, effective(defaults()));
    assert_eq!(forced, effective(defaults().set("simd=f32x8").expect("a change")));
}

/// Section 7.5: "The action space is then 16-dimensional", "The state space is then composed of 49 dimensions".
#[test]
fn the_thesis_configuration_gives_49_observations_and_16_actions() {
    let (settings, _) = load(&folder().join("thesis.toml"));
    let robot = robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x")).unwrap();
    let spec = spec(&robot, &settings.env);
    assert_eq!((spec.observation_len(), spec.action_len()), (49, 16));
}
