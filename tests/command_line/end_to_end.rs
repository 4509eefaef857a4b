//! Train, evaluate, inspect: what a first user does, on a small scale.

use std::fs;
use std::path::Path;

use super::support::{GAIT, contents, robot, succeeds, tiny};
use serde_json::Value;

#[track_caller]
fn inspects(folder: &Path, path: &str, parts: &[&str]) {
    let text = succeeds(folder, &["inspect", path]).out;
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

#[test]
fn a_run_is_trained_evaluated_and_described() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("tiny.toml"), tiny()).unwrap();
    let trained = succeeds(
        folder,
        &[
            "train",
            "tiny.toml",
            "--run",
            "run",
            "--engine",
            "lanes",
            "--steps",
            "600",
        ],
    );
    assert!(trained.out.contains("600 of 600 steps") && trained.out.contains("judge:  omniwalk eval run"));
    let evaluated = succeeds(folder, &["eval", "run", "--json", "result.json", "--seed", "3"]);
    assert!(
        evaluated
            .out
            .contains("run after 600 steps, randomised conditions, 2 episodes of 3 s")
    );
    assert!(evaluated.out.contains("(0.40, 0.00, 0.00)"), "{}", evaluated.out);
    result(&fs::read_to_string(folder.join("result.json")).unwrap());
    assert_eq!(
        fs::read(folder.join("result.json")).unwrap(),
        fs::read(folder.join("run/eval.json")).unwrap()
    );
    again(folder);
    files(folder);
}

/// The keys that programs read.
fn result(text: &str) {
    let result: Value = serde_json::from_str(text).unwrap();
    let at = |pointer: &str| {
        result
            .pointer(pointer)
            .unwrap_or_else(|| panic!("{pointer} is not in {text}"))
    };
    assert_eq!(
        (at("/policy"), at("/engine"), at("/seed")),
        (&"run".into(), &"rapier".into(), &3.into())
    );
    assert_eq!(
        (at("/robot"), at("/conditions")),
        (&"nimbro_op2x".into(), &"randomised".into())
    );
    assert_eq!(at("/forward/rows").as_array().unwrap().len(), 2);
    assert_eq!(at("/forward/rows/0/command"), &serde_json::json!([0.0, 0.0, 0.0]));
    assert!(at("/forward/rows/0/drift_m").is_f64());
    for row in 0..2 {
        let key = |name: &str| at(&format!("/forward/rows/{row}/{name}"));
        assert_eq!(key("episodes"), 2);
        assert!(key("falls").as_u64().unwrap() <= 2);
        let error = key("error_xy_mps");
        assert!(error.is_null() || error.as_f64().unwrap() >= 0.0);
    }
    for name in GAIT {
        assert!(at(&format!("/forward/rows/1/gait/{name}")).is_number(), "{name}");
    }
}

/// The same seed gives the same figures; other conditions do not.
fn again(folder: &Path) {
    succeeds(folder, &["eval", "run", "--json", "again.json", "--seed", "3"]);
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    assert_eq!(read("again.json"), read("result.json"));
    succeeds(
        folder,
        &["eval", "run", "--json", "nominal.json", "--seed", "3", "--nominal"],
    );
    let nominal: Value = serde_json::from_str(&read("nominal.json")).unwrap();
    assert_eq!(nominal["conditions"], "nominal");
    let randomised: Value = serde_json::from_str(&read("result.json")).unwrap();
    assert_ne!(nominal["forward"], randomised["forward"]);
}

/// `inspect` knows everything a run writes.
fn files(folder: &Path) {
    inspects(
        folder,
        "run",
        &[
            "train.steps = 600",
            "5 rows of",
            "newest whole one: step 600",
            "rollouts: 2",
        ],
    );
    inspects(folder, "run/config.toml", &["train.steps = 600"]);
    inspects(
        folder,
        "run/metrics.csv",
        &["5 rows of", "last row: step 600", "gait/alternation"],
    );
    inspects(
        folder,
        "run/checkpoints/step-000000000600.safetensors",
        &["checkpoint at step 600", "environments", "agent."],
    );
    let events = fs::read_dir(folder.join("run"))
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let events = events
        .filter(|path| path.display().to_string().contains("tfevents"))
        .collect::<Vec<_>>();
    assert_eq!(events.len(), 1);
    inspects(
        folder,
        &events[0].display().to_string(),
        &["TensorBoard events", "gait/air_time_s", "5 values, last"],
    );
    let rollout = "run/rollouts/eval_0.40_0.00_0.00.mcap";
    inspects(
        folder,
        rollout,
        &[
            "/joint_states (sensor_msgs/msg/JointState)",
            "/policy",
            "40.0 Hz",
            "robot = nimbro_op2x",
        ],
    );
    let standing = [
        "floating base",
        "16 of them moved by the policy",
        "left_knee_pitch",
        "targets at the nominal pose   stands 10 s",
        "zero increments               falls within",
        "contact force over weight     1.0000",
        "mirrored start",
    ];
    inspects(folder, "run/robot", &standing);
    inspects(folder, "run/checkpoints", &["step 600: whole"]);
    // A walk is followed from state to state, and reads as the log of a stand too.
    let replay = ["replay", rollout, "--robot", "run/robot", "--stand"];
    for arguments in [&replay[..4], &replay] {
        assert!(succeeds(folder, arguments).out.contains("left_knee_pitch"));
    }
    inspects(
        folder,
        "run/rollouts",
        &["rollouts: 2", "eval_0.40_0.00_0.00.mcap: log: "],
    );
    inspects(
        folder,
        "run/eval.json",
        &[
            "evaluation of run after 600 steps",
            "engine rapier, nominal conditions, seed 3",
            "forward: 2 rows",
        ],
    );
    succeeds(folder, &["report", "run"]);
    inspects(folder, "run/learning.png", &["picture: ", " pixels"]);
    inspects(folder, "run/report.html", &["report: ", "with 5 pictures"]);
    for path in contents(&folder.join("run")).into_keys() {
        succeeds(folder, &["inspect", &path.display().to_string()]);
    }
    succeeds(folder, &["inspect", "run/.lock"]);
}

#[test]
fn robots_are_described_from_a_folder_or_a_urdf() {
    let folder = tempfile::tempdir().unwrap();
    let pendulum = robot("pendulum");
    inspects(
        folder.path(),
        &pendulum.display().to_string(),
        &["fixed base", "1 degrees of freedom", "no feet"],
    );
    let urdf = pendulum.join("pendulum.urdf");
    inspects(
        folder.path(),
        &urdf.display().to_string(),
        &["fixed base", "all 1 with an actuator and limits"],
    );
    fs::copy(&urdf, folder.path().join("alone.urdf")).unwrap();
    inspects(folder.path(), "alone.urdf", &["fixed base", "no TOML beside the URDF"]);
}
