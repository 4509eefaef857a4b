//! `omniwalk inspect` as a user meets it.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use omniwalk::run::RunFolder;
use omniwalk::run::checkpoint::Checkpoint;
use omniwalk::run::events::{EventWriter, event_files};
use omniwalk::run::metrics::MetricsWriter;
use omniwalk_controller::*;
use omniwalk_sim2real::log::messages::JointState;
use omniwalk_sim2real::log::{LogWriter, Message};

/// Exit code, stdout and stderr of `omniwalk inspect PATH`.
fn inspect(path: &Path) -> (i32, String, String) {
    let output = Command::cargo_bin("omniwalk")
        .unwrap()
        .arg("inspect")
        .arg(path)
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[track_caller]
fn assert_describes(path: &Path, parts: &[&str]) {
    let (code, out, err) = inspect(path);
    assert_eq!((code, err.as_str()), (0, ""));
    for part in parts {
        assert!(out.contains(part), "{part:?} is not in\n{out}");
    }
}

#[track_caller]
fn assert_refuses(path: &Path, part: &str) {
    let (code, out, err) = inspect(path);
    assert_eq!((code, out.as_str()), (2, ""), "{err}");
    // The report wraps long lines at the width of the terminal.
    let one_line = err
        .split_whitespace()
        .filter(|word| !["|", "│"].contains(word))
        .collect::<Vec<_>>()
        .join(" ");
    assert!(one_line.contains(part), "{part:?} is not in\n{err}");
    assert!(!err.contains("panicked"), "{err}");
}

/// A run with a row of metrics, events, three checkpoints of which the newest is cut off, and a log.
fn sample(folder: &Path) -> RunFolder {
    let run = RunFolder::create(folder, "[train]\nseed = 7\n").unwrap();
    MetricsWriter::create(&run.metrics(), &["return", "falls"])
        .unwrap()
        .append(128, &[2.5, f64::NAN])
        .unwrap();
    EventWriter::create(run.path(), None)
        .unwrap()
        .scalars(128, [("return/total", 2.5)])
        .unwrap();
    for step in [64, 128, 192] {
        let mut checkpoint = Checkpoint::new(step);
        checkpoint.insert("actor.0.weight", &[2, 2], &[1.0_f32, -2.0, f32::NAN, 0.5]);
        checkpoint.metadata.insert("robot".into(), "nimbro\u{1b}[31m".into());
        run.checkpoints().save(&checkpoint, 3).unwrap();
    }
    let newest = run.checkpoints().list().pop().unwrap().1;
    fs::write(&newest, &fs::read(&newest).unwrap()[..100]).unwrap();
    fs::create_dir(run.rollouts()).unwrap();
    let mut log = LogWriter::create(&run.rollouts().join("a.mcap")).unwrap();
    for step in 0..41 {
        let joints = JointState {
            name: vec!["left_knee".into()],
            position: vec![0.5],
            ..JointState::default()
        };
        log.write(step * 25_000_000, &Message::JointStates(joints)).unwrap();
    }
    log.finish().unwrap();
    run
}

#[test]
fn every_file_of_a_run_is_described() {
    let folder = tempfile::tempdir().unwrap();
    let run = sample(&folder.path().join("run"));
    let checkpoints = run.checkpoints().list();
    assert_describes(
        run.path(),
        &[
            "train.seed = 7",
            "1 rows of 2 columns",
            "checkpoints: 3",
            "newest whole one: step 128",
            "step-000000000192.safetensors is not a whole checkpoint",
            "event files: 1",
            "rollouts: 1",
        ],
    );
    assert_describes(
        &checkpoints[0].1,
        &[
            "checkpoint at step 64",
            "actor.0.weight  f32 2 x 2",
            "from -2.0000e0 to 1.0000e0, 1 NOT FINITE",
        ],
    );
    assert_describes(
        &run.metrics(),
        &["last row: step 128", "return  2.5", "falls   not measured"],
    );
    assert_describes(
        &event_files(run.path())[0],
        &["return/total  1 values, last 2.500000 at step 128"],
    );
    assert_describes(
        &run.rollouts().join("a.mcap"),
        &[
            "log: 1.000 s, 1 topics",
            "/joint_states (sensor_msgs/msg/JointState): 41 messages, 40.0 Hz",
            "left_knee",
        ],
    );
    assert_describes(&run.config(), &["1 values differ", "train.seed = 7"]);
}

#[test]
fn a_configuration_that_was_emptied_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let run = sample(&folder.path().join("run"));
    fs::write(run.config(), "# nothing\n").unwrap();
    assert_describes(
        &run.config(),
        &["configuration: empty, all defaults; a run's has every value"],
    );
    assert_describes(
        run.path(),
        &["config.toml is empty: it is no run's configuration", "checkpoints: 3"],
    );
}

#[test]
fn absurd_numbers_are_refused_or_written_short() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("eval.json");
    let evaluation = |more: &str| {
        let text = format!(r#"{{"policy": "a", "robot": "b", "engine": "rapier", "conditions": "nominal", {more}}}"#);
        fs::write(&path, text).unwrap();
    };
    evaluation(r#""steps": 7, "changes": {"survived": 3, "total": 4}"#);
    assert_describes(&path, &["after 7 steps", "changes: 3 of 4 survive"]);
    let row =
        |falls: &str| format!(r#""falls": {{"rows": [{{"command": [0, 0, 0], "falls": {falls}, "episodes": 10}}]}}"#);
    for (more, part) in [
        (r#""steps": 7"#.to_owned(), "it has no suite"),
        (r#""steps": 1e308, "changes": {}"#.to_owned(), "steps"),
        (
            r#""steps": 18446744073709551615, "changes": {}"#.to_owned(),
            "`steps` is no number from 0 to",
        ),
        (
            r#""changes": {"survived": 1e308, "total": 4}"#.to_owned(),
            "`survived` is no number from 0 to 1000000000",
        ),
        (row("1e308"), "falls, episodes or errors that are none"),
        (row("11"), "falls, episodes or errors that are none"),
        (
            format!(r#""policy": "{}", "changes": {{}}"#, "9".repeat(300)),
            "has more than 200 characters",
        ),
    ] {
        evaluation(&more);
        assert_refuses(&path, part);
        assert!(!inspect(&path).2.contains(&"0".repeat(20)), "{more}");
    }
    let metrics = folder.path().join("metrics.csv");
    fs::write(&metrics, "step,a,b\n1,1e308,0.5\n").unwrap();
    assert_describes(&metrics, &["a  1.000000e308", "b  0.500000"]);
}

/// A policy of one joint whose network is zero.
fn policy() -> Policy {
    let joint = JointSpec {
        name: "knee".into(),
        nominal: 0.1,
        lower: -1.0,
        upper: 1.0,
        kp: 50.0,
        kd: 1.0,
        torque_limit: 10.0,
        action_scale: 0.3,
    };
    let spec = Spec {
        control_hz: 40.0,
        joints: vec![joint],
        observation: vec![Block::JointPosition, Block::JointVelocity],
        action: ActionSpec {
            law: ActionLaw::OffsetFromNominal,
            filter: Some(FilterSpec::Butterworth { cutoff_hz: 5.0 }),
            torque_clamp: true,
        },
        clock: None,
        symmetry: None,
        command: CommandSpec {
            rate: [1.0; 3],
            lower: [0.0; 3],
            upper: [0.5, 0.0, 0.0],
        },
        legs: Vec::new(),
        inertial_frame_period: 10.0,
        upright: [0.7; 2],
    };
    let actor = Actor {
        mean: vec![0.0; 2],
        deviation: vec![1.0; 2],
        clip: 10.0,
        layers: vec![Dense {
            inputs: 2,
            weights: Weights::F32(vec![0.0; 4]),
            bias: vec![0.0; 2],
        }],
        activation: Activation::Tanh,
        head: Head::Beta,
    };
    let bounds = Bounds {
        lower: vec![-5.0; 2],
        upper: vec![5.0; 2],
    };
    let program = "omniwalk 0.1.0".into();
    let identity = Identity {
        config_hash: [0xab; 32],
        seed: 7,
        steps: 1_000_000,
        program,
        curriculum: Curriculum {
            lower: [-0.5; 3],
            upper: [0.5; 3],
            velocity_factor: 1.0,
            foot_factor: 1.0,
        },
        latency: [0.0, 0.02],
    };
    Policy::new(spec, actor, bounds, identity).unwrap()
}

#[test]
fn a_policy_is_described_and_a_damaged_one_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.omni");
    let mut bytes = policy().to_bytes();
    fs::write(&path, &bytes).unwrap();
    assert_describes(
        &path,
        &[
            "policy of 1000000 policy steps, seed 7, by omniwalk 0.1.0",
            "40 Hz, observation of 2 numbers:",
            "joint_velocity       1  rad/s or m/s; joint",
            "the curriculum had reached [-0.5, -0.5, -0.5] to [0.5, 0.5, 0.5]",
            "head beta, weights in f32",
            "offset_from_nominal, second-order Butterworth at 5 Hz, clamped",
            "knee  nominal 0.1000, limits -1.0000 to 1.0000",
            "at most at [1.0, 1.0, 1.0] m/s^2, m/s^2, rad/s^2",
            "inertial frame set to the heading every 10 s",
            "no legs: the velocity of the base must be given",
            "normalised by mean and deviation, then clipped to",
            "reproduces its golden vectors",
        ],
    );
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(&path, &bytes).unwrap();
    assert_refuses(&path, "is damaged (checksum)");
}

#[test]
fn what_a_file_says_cannot_control_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let run = sample(&folder.path().join("run"));
    let (_, out, _) = inspect(&run.checkpoints().list()[0].1);
    assert!(out.contains("nimbro") && !out.contains('\u{1b}'), "{out:?}");
}

#[test]
fn unknown_and_damaged_files_are_refused_with_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    assert_refuses(&folder.path().join("none.toml"), "cannot read");
    assert_refuses(folder.path(), "none of the files omniwalk knows");
    assert_refuses(&write("picture.png", b"\x89PNG"), "none of the files omniwalk knows");
    assert_refuses(&write("empty.safetensors", b""), "not a whole checkpoint");
    assert_refuses(&write("rubbish.safetensors", &[0xff; 64]), "not a whole checkpoint");
    assert_refuses(&write("rubbish.mcap", b"rubbish"), "not a whole MCAP file");
    assert_refuses(&write("cut.mcap", b"\x89MCAP0\r\n\x01"), "not a whole MCAP file");
    assert_refuses(&write("broken.toml", b"[train\nseed = 1"), "broken.toml:1:");
    assert_refuses(
        &write("other.csv", b"time;position\n0;1\n"),
        "the first column of a run's metrics is `step`",
    );
    assert_refuses(&write("events.out.tfevents.1", &[0; 20]), "a checksum is wrong");
    assert_refuses(&write("events.out.tfevents.2", b""), "no TensorBoard events");
    assert_refuses(&write("eval.json", b"{\"policy\": 3}"), "no evaluation");
    assert_refuses(&write("eval.json", b"{}"), "no evaluation");
    assert_refuses(&write("other.html", b"<!DOCTYPE html>"), "no page of `omniwalk report`");
    assert_refuses(&write("cut.png", b"\x89PNG\r\n\x1a\n\0\0"), "cut.png: ");
}

#[test]
fn a_wrong_command_is_refused_with_exit_code_2() {
    for arguments in [&["inspec"][..], &["inspect"], &["inspect", "a", "b"], &[]] {
        let output = Command::cargo_bin("omniwalk")
            .unwrap()
            .args(arguments)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
}
