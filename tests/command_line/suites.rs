//! `omniwalk eval --suite` as a user meets it, with sequences of a blink.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use super::support::{GAIT, copy, omniwalk, policy, robot, succeeds, tiny};
use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

/// A run that has learned nothing.
static RUN: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tiny.toml"), tiny()).unwrap();
    let arguments = ["train", "tiny.toml", "--run", "run", "--engine", "lanes", "--quiet"];
    succeeds(folder.path(), &arguments);
    folder
});

/// A folder with a copy of the run.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy(&RUN.path().join("run"), &folder.path().join("run"));
    folder
}

fn json(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("run/eval.json")).unwrap()).unwrap()
}

const SHORT: [&str; 6] = ["--engine", "lanes", "--episodes", "2", "--seconds", "2.5"];

#[track_caller]
fn is_interval(value: &Value, around: f64) {
    let ends = [0, 1].map(|i| value[i].as_f64().unwrap());
    assert!(
        ends[0] <= around && around <= ends[1],
        "{ends:?} is not around {around}"
    );
}

#[test]
fn all_suites_give_tables_figures_pictures_and_a_rollout() {
    let folder = folder();
    let output = succeeds(
        folder.path(),
        &[&["eval", "run", "--suite", "all"], &SHORT[..]].concat(),
    );
    for part in [
        "run after 480 steps, lanes, seed 1000",
        "falls, randomised conditions",
        "falls, nominal conditions",
        "falls in all: ",
        "sequence of fig. 7.9",
        "grid of 245 commands",
        "changes, nominal conditions",
        "push, randomised conditions",
        "rollout: run/rollouts/tracking.mcap",
        "picture: run/eval_push.png",
    ] {
        assert!(output.out.contains(part), "{part:?} is not in\n{}", output.out);
    }
    let result = json(folder.path());
    assert_eq!(result["conditions"], "randomised");
    assert_eq!(
        result["suites"],
        serde_json::json!(["falls", "tracking", "changes", "push"])
    );
    for conditions in ["", "/nominal"] {
        let at = |path: &str, rest: &str| {
            let pointer = format!("/{path}{conditions}/{rest}");
            result.pointer(&pointer).unwrap_or_else(|| panic!("{pointer}"))
        };
        assert_eq!(at("falls", "rows").as_array().unwrap().len(), 10);
        let share = at("falls", "falls").as_f64().unwrap() / 20.0;
        is_interval(at("falls", "falls_share_ci95"), share);
        assert!(at("falls", "rows/0/drift_m").is_f64());
        for name in GAIT {
            assert!(at("falls", &format!("rows/1/gait/{name}")).is_number(), "{name}");
        }
        for name in [
            "double_support_share",
            "torque_rms_share",
            "speed_max_share",
            "action_change",
            "asymmetry_rad",
        ] {
            assert!(at("tracking", &format!("sequence/gait/{name}")).is_number(), "{name}");
        }
        assert_eq!(at("tracking", "rows").as_array().unwrap().len(), 37);
        assert_eq!(at("tracking", "sequence/rows").as_array().unwrap().len(), 20);
        assert_eq!(at("tracking", "grid/cells/falls/4/6").as_array().unwrap().len(), 7);
        assert_eq!(at("changes", "total"), 32);
        assert!(at("changes", "survived").as_u64().unwrap() <= 32);
        assert_eq!(at("push", "rows").as_array().unwrap().len(), 20);
        let row = |i: usize, key: &str| at("push", &format!("rows/{i}/{key}"));
        assert_eq!(
            (row(0, "direction"), row(2, "direction")),
            (&"front".into(), &"right".into())
        );
        assert!(row(5, "all_ten_n").as_f64().unwrap() <= row(5, "max_n").as_f64().unwrap());
    }
    for name in ["eval_velocity.png", "eval_error.png", "eval_grid.png", "eval_push.png"] {
        let bytes = fs::read(folder.path().join("run").join(name)).unwrap();
        assert!(bytes.starts_with(b"\x89PNG"), "{name}");
    }
    let html = {
        succeeds(folder.path(), &["report", "run"]);
        fs::read_to_string(folder.path().join("run/report.html")).unwrap()
    };
    assert!(html.contains("alt=\"eval_grid.png\"") && html.contains("--suite falls,tracking,changes,push"));
}

#[test]
fn policies_are_judged_in_rapier_unless_another_engine_is_named_either_way() {
    let folder = folder();
    let played = |options: &[&str]| {
        let short = ["eval", "run", "--episodes", "1", "--seconds", "0.5"];
        succeeds(folder.path(), &[&short, options].concat());
        let result = json(folder.path());
        (result["engine"].clone(), result["simd"].clone())
    };
    assert_eq!(played(&[]), ("rapier".into(), Value::Null));
    let lanes = ("lanes".into(), "scalar".into());
    let narrow = ["--set", "simd=scalar"];
    assert_eq!(played(&[&["--engine", "lanes"], &narrow[..]].concat()), lanes);
    assert_eq!(played(&[&["--set", "engine=lanes"], &narrow[..]].concat()), lanes);
}

#[test]
fn figures_do_not_depend_on_the_number_of_threads_but_on_the_seed() {
    for engine in ["rapier", "lanes"] {
        let figures = |threads: &str, seed: &str| {
            let folder = folder();
            Command::cargo_bin("omniwalk")
                .unwrap()
                .current_dir(folder.path())
                .env("RAYON_NUM_THREADS", threads)
                .args(["eval", "run", "--suite", "changes,falls", "--engine", engine])
                .args(["--episodes", "2", "--seconds", "0.5", "--seed", seed])
                .assert()
                .success();
            json(folder.path())
        };
        let one = figures("1", "5");
        assert_eq!(one, figures("2", "5"), "{engine}");
        assert_ne!(one["changes"], figures("2", "6")["changes"], "{engine}");
    }
}

#[test]
fn a_suite_judges_under_its_own_conditions_unless_they_are_changed() {
    let folder = folder();
    // What the run was trained under does not count.
    let config = folder.path().join("run/config.toml");
    let arguments = [&["eval", "run", "--suite", "falls"], &SHORT[..]].concat();
    succeeds(folder.path(), &arguments);
    let before = json(folder.path());
    let text = fs::read_to_string(&config).unwrap();
    assert!(text.contains("pd_noise = 0.1") && text.contains("mass = 0.1"));
    fs::write(
        &config,
        text.replace("pd_noise = 0.1", "pd_noise = 0.3")
            .replace("mass = 0.1", "mass = 0.5"),
    )
    .unwrap();
    succeeds(folder.path(), &arguments);
    assert_eq!(json(folder.path()), before);
    succeeds(
        folder.path(),
        &[&arguments[..], &["--set", "friction.tangential=[0.1, 0.1]"]].concat(),
    );
    let slippery = json(folder.path());
    assert_ne!(slippery["falls"]["rows"], before["falls"]["rows"]);
    succeeds(folder.path(), &[&arguments[..], &["--nominal"]].concat());
    let nominal = json(folder.path());
    assert_eq!(nominal["conditions"], "nominal");
    assert_eq!(nominal["falls"]["rows"], before["falls"]["nominal"]["rows"]);
    assert!(nominal["falls"].get("nominal").is_none());
}

#[test]
fn suites_that_cannot_be_played_are_refused() {
    let folder = folder();
    for (arguments, part) in [
        (&["--suite", "walk"][..], "invalid value 'walk' for '--suite"),
        (
            &["--suite", "falls", "--episodes", "0"],
            "`eval.episodes` must be at least 1",
        ),
        (&["--suite", "push", "--seconds", "0.01"], "`eval.seconds` must be"),
        (
            &["--suite", "changes", "--set", "clock.period=2.0"],
            "`--set` does not fit the policy, the clock is",
        ),
        (
            &["--suite", "changes", "--set", "action.law=\"increment_on_target\""],
            "`--set` does not fit the policy, the action law",
        ),
    ] {
        let output = omniwalk(folder.path(), &[&["eval", "run"], arguments].concat());
        assert_eq!((output.code, output.out.as_str()), (2, ""), "{}", output.err);
        assert!(
            output.message().contains(part),
            "{part:?} is not in\n{}",
            output.message()
        );
        assert!(!folder.path().join("run/eval.json").exists());
    }
}

#[test]
fn a_suite_beyond_the_bounds_a_policy_was_trained_for_is_refused() {
    let folder = folder();
    let config = folder.path().join("run/config.toml");
    let text = fs::read_to_string(&config).unwrap();
    let narrow = text.replacen("upper = [0.6, 0.6, 0.6]", "upper = [0.5, 0.6, 0.6]", 1);
    assert_ne!(narrow, text);
    fs::write(&config, narrow).unwrap();
    let output = omniwalk(folder.path(), &["eval", "run", "--suite", "changes,falls"]);
    assert_eq!((output.code, output.out.as_str()), (2, ""), "{}", output.err);
    let part = "what `falls` asks for must be within the bounds the policy was trained for";
    assert!(output.message().contains(part), "{}", output.message());
}

#[test]
fn a_policy_file_is_judged_into_a_folder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(policy(), folder.path().join("p.omni")).unwrap();
    let home = robot("nimbro_op2x");
    let quick = ["--engine", "lanes", "--nominal", "--episodes", "1", "--seconds", "1"];
    let judge = ["eval", "p.omni", "--suite", "falls", "--robot", home.to_str().unwrap()];
    succeeds(folder.path(), &[&judge[..], &quick].concat());
    assert!(folder.path().join("p.eval/eval.json").is_file());
}

#[test]
fn a_robot_with_play_is_not_judged_at_200_hz_without_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    copy(&robot("nimbro_op2x"), &folder.path().join("loose"));
    let file = folder.path().join("loose/robot.toml");
    let text = fs::read_to_string(&file).unwrap();
    let play = "\n[[effect]]\nid = \"backlash\"\nmatch = [\"*_knee_pitch\"]\ngap = 0.01\n";
    fs::write(file, text + play).unwrap();
    fs::copy(policy(), folder.path().join("p.omni")).unwrap();
    let said = |more: &str| {
        let judge = format!("eval p.omni --robot loose --engine lanes --episodes 1 --seconds 1 {more}");
        succeeds(folder.path(), &judge.split_whitespace().collect::<Vec<_>>()).message()
    };
    let warning =
        "play or springs between motor and joint (left_knee_pitch and 1 more) move otherwise at 200 Hz than at 1000";
    assert!(said("").contains(warning), "{}", said(""));
    let quiet = said("--set engine.physics_hz=1000");
    assert!(!quiet.contains("warning"), "{quiet}");
}
