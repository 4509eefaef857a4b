//! `omniwalk export`, and what else takes a policy file, as a user meets them.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::support::{omniwalk, robot, succeeds, tiny};
use omniwalk_controller::Policy;
use serde_json::Value;

fn policy(folder: &Path, name: &str) -> Policy {
    Policy::from_bytes(&fs::read(folder.join(name)).unwrap()).unwrap()
}

#[test]
fn a_run_becomes_a_policy_file_that_evaluation_and_benchmark_take() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("tiny.toml"), tiny()).unwrap();
    succeeds(
        folder,
        &["train", "tiny.toml", "--run", "run", "--engine", "lanes", "--quiet"],
    );
    let out = succeeds(
        folder,
        &["export", "run", "--out", "p.omni", "--onnx", "p.onnx", "--c", "for_c"],
    )
    .out;
    assert!(
        out.contains("policy: p.omni") && out.contains("actions within 0.0e0 of f32"),
        "{out}"
    );
    identity(&policy(folder, "p.omni"), &folder.join("run"));
    for format in ["f16", "int8"] {
        succeeds(folder, &["export", "p.omni", "--out", format, "--format", format]);
        let error = policy(folder, format).golden_error(&policy(folder, "p.omni"));
        assert!(error > 0.0 && error < 0.02, "{format}: {error}");
    }
    for rounded in ["f16", "int8"] {
        let output = omniwalk(folder, &["export", rounded, "--out", "again.omni", "--c", "again"]);
        let part = format!("the weights in {rounded} are rounded to {rounded}; what that lost is not in the file");
        assert_eq!(output.code, 2, "{rounded}");
        assert!(output.message().contains(&part), "{}", output.err);
        assert!(!folder.join("again.omni").exists() && !folder.join("again").exists());
    }
    compiles(&folder.join("for_c"));
    assert!(
        succeeds(folder, &["inspect", "p.omni"])
            .out
            .contains("policy of 480 policy steps")
    );
    evaluated(folder);
    succeeds(
        folder,
        &["bench", "controller", "p.omni", "--steps", "2000", "--json", "b.json"],
    );
    let result: Value = serde_json::from_str(&fs::read_to_string(folder.join("b.json")).unwrap()).unwrap();
    for key in ["p50_us", "p99_us", "p999_us", "max_us"] {
        assert!(result[key].as_f64().unwrap() > 0.0 && result["portable"][key].as_f64().unwrap() > 0.0);
    }
}

/// What the file says of training, from other sources than the exporter's.
fn identity(policy: &Policy, run: &Path) {
    let identity = policy.identity();
    assert_eq!((identity.steps, identity.seed, identity.latency), (480, 1, [0.0, 0.05]));
    let output = Command::new("sha256sum").arg(run.join("config.toml")).output().unwrap();
    let expected = String::from_utf8(output.stdout).unwrap();
    let hash: String = identity.config_hash.iter().map(|byte| format!("{byte:02x}")).collect();
    assert!(expected.starts_with(&hash), "{hash} {expected}");
    let trained = &identity.curriculum;
    assert!((0..3).all(|axis| trained.lower[axis] >= -0.6 && trained.upper[axis] <= 0.6));
    assert!(
        trained.upper[0] >= 0.3,
        "the core of the default configuration: {trained:?}"
    );
    assert!(
        (0..3).all(|axis| trained.lower[axis] <= 0.0),
        "it was asked to stand as well: {trained:?}"
    );
    let bounds = policy.bounds();
    for (i, joint) in policy.spec().joints.iter().enumerate() {
        assert!(
            bounds.lower[i] < joint.nominal && bounds.upper[i] > joint.nominal,
            "{}",
            joint.name
        );
    }
    assert!(
        bounds.lower.iter().chain(&bounds.upper).all(|x| x.is_finite()),
        "what was seen is known"
    );
}

fn compiles(folder: &Path) {
    let mut compiler = Command::new("cc");
    compiler.args([
        "-std=c99",
        "-pedantic",
        "-Wall",
        "-Werror",
        "-DPOLICY_INSIDE",
        "-c",
        "policy.c",
        "golden.c",
    ]);
    assert!(compiler.current_dir(folder).status().unwrap().success());
}

/// The file walks like the run it came from, in conditions without anything random.
fn evaluated(folder: &Path) {
    let commands = "eval.commands=[[0.0, 0.0, 0.0]]";
    let options = [
        "--engine",
        "lanes",
        "--nominal",
        "--episodes",
        "1",
        "--seconds",
        "2",
        "--set",
        commands,
    ];
    let home = robot("nimbro_op2x");
    let run = |what: &str, json: &str| -> Value {
        let arguments: Vec<&str> = ["eval", what, "--json", json, "--robot", home.to_str().unwrap()]
            .into_iter()
            .chain(options)
            .collect();
        succeeds(folder, &arguments);
        serde_json::from_str(&fs::read_to_string(folder.join(json)).unwrap()).unwrap()
    };
    let (ours, theirs) = (run("run", "run.json"), run("p.omni", "policy.json"));
    assert!(folder.join("p.eval/eval.json").is_file());
    let drift = |result: &Value| result["forward"]["rows"][0]["drift_m"].as_f64();
    let (ours, theirs) = (drift(&ours), drift(&theirs));
    // Networks of other instruction sets differ by 1e-6, which two seconds of standing do not blow up to millimetres.
    match (ours, theirs) {
        (Some(ours), Some(theirs)) => assert!((ours - theirs).abs() < 1e-3, "{ours} {theirs}"),
        (ours, theirs) => assert_eq!(ours, theirs),
    }
    let other = robot("nimbro_op2x_small");
    let output = omniwalk(folder, &["eval", "p.omni", "--robot", other.to_str().unwrap()]);
    assert_eq!(output.code, 2);
    assert!(output.message().contains("does not fit robot"), "{}", output.err);
    // Each thing that differs is said once, not for each joint.
    assert!(output.err.lines().count() <= 25, "{}", output.err);
    let output = omniwalk(folder, &["rehearse", "p.omni"]);
    assert_eq!(output.code, 2);
    assert!(
        output.message().contains("p.omni does not hold the body of its robot")
            && output
                .message()
                .contains("give the robot it was trained for by --robot"),
        "{}",
        output.err
    );
    // In its run it finds the robot that is there.
    fs::copy(folder.join("p.omni"), folder.join("run/found.omni")).unwrap();
    let short = [
        "--engine",
        "lanes",
        "--episodes",
        "1",
        "--seconds",
        "1",
        "--suite",
        "forward",
        "--set",
        commands,
    ];
    succeeds(folder, &[&["eval", "run/found.omni"], &short[..]].concat());
}

#[test]
fn what_cannot_be_exported_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("noise.omni"), b"OMNIWALK and then nothing").unwrap();
    for (source, part) in [("none", "holds no run"), ("noise.omni", "noise.omni")] {
        let output = omniwalk(folder, &["export", source, "--out", "p.omni"]);
        assert_eq!(output.code, 2, "{source}");
        assert!(output.message().contains(part), "{}", output.err);
    }
    assert!(!folder.join("p.omni").exists());
    let output = omniwalk(folder, &["export", "noise.omni"]);
    assert_eq!(output.code, 2, "nothing to write");
}
