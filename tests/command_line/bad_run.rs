//! Runs that are damaged, edited or do not fit what is asked of them: exit code 2, a message, and nothing is written.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use super::support::{copy, omniwalk, refuses_in, robot, succeeds, tiny};
use tempfile::TempDir;

/// A finished run, trained once.
static RUN: LazyLock<(TempDir, PathBuf)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tiny.toml"), tiny()).unwrap();
    succeeds(
        folder.path(),
        &[
            "train",
            "tiny.toml",
            "--run",
            "run",
            "--quiet",
            "--set",
            "train.checkpoint_minutes=1e-9",
        ],
    );
    let run = folder.path().join("run");
    (folder, run)
});

/// A command on a copy of a finished run that `damage` has changed.
#[track_caller]
fn refuses_run(damage: impl FnOnce(&Path), arguments: &[&str], parts: &[&str]) {
    let prepare = |folder: &Path| {
        copy(&RUN.1, &folder.join("run"));
        damage(&folder.join("run"));
    };
    refuses_in(prepare, arguments, parts);
}

fn checkpoints(run: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(run.join("checkpoints")).unwrap();
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

fn cut(file: &Path) {
    let bytes = fs::read(file).unwrap();
    fs::write(file, &bytes[..bytes.len() / 2]).unwrap();
}

fn replace(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{from:?} is not in {}", file.display());
    fs::write(file, text.replacen(from, to, 1)).unwrap();
}

const RESUME: &[&str] = &["train", "--resume", "--run", "run", "--steps", "960"];

#[test]
fn a_run_folder_that_holds_a_run() {
    refuses_run(
        |_| (),
        &["train", "tiny.toml", "--run", "run"],
        &["run already holds a run", "--resume"],
    );
}

#[test]
fn a_run_that_cannot_be_resumed() {
    let without_checkpoints = |run: &Path| fs::remove_dir_all(run.join("checkpoints")).unwrap();
    refuses_run(
        without_checkpoints,
        RESUME,
        &["run holds no checkpoint yet", "another folder"],
    );
    let damaged = |run: &Path| checkpoints(run).iter().for_each(|file| cut(file));
    refuses_run(damaged, RESUME, &["is not a whole checkpoint"]);
    let empty = |run: &Path| fs::remove_file(run.join("config.toml")).unwrap();
    refuses_run(empty, RESUME, &["run holds no run", "config.toml"]);
    let config = |run: &Path| fs::write(run.join("config.toml"), "[ppo]\nepoch = 3\n").unwrap();
    refuses_run(config, RESUME, &["unknown key `ppo.epoch`", "config.toml:2:1"]);
    let columns = |run: &Path| fs::write(run.join("metrics.csv"), "step,return\n").unwrap();
    refuses_run(columns, RESUME, &["metrics.csv"]);
    let other_robot = |run: &Path| {
        fs::remove_dir_all(run.join("robot")).unwrap();
        copy(&robot("pendulum"), &run.join("robot"));
    };
    refuses_run(
        other_robot,
        RESUME,
        &[
            "cannot go on from",
            "robot/nimbro_op2x.urdf was",
            "robot/pendulum.urdf was added",
        ],
    );
}

#[test]
fn a_run_whose_settings_were_edited() {
    let edits = [
        (
            "hidden = [16, 16]",
            "hidden = [32, 16]",
            "ppo.hidden was [16,16] and is [32,16]",
        ),
        ("gamma = 0.99", "gamma = 0.95", "ppo.gamma was 0.99 and is 0.95"),
        ("zeta = 400.0", "zeta = 40.0", "curriculum.zeta was 400.0 and is 40.0"),
        (
            "kind = \"lanes\"",
            "kind = \"rapier\"",
            "engine.kind was \"lanes\" and is \"rapier\"",
        ),
    ];
    for (from, to, message) in edits {
        let edit = |run: &Path| replace(&run.join("config.toml"), from, to);
        refuses_run(
            edit,
            RESUME,
            &["cannot go on from", message, "undo the change", "--from RUN"],
        );
    }
    let robot = |run: &Path| {
        let path = run.join("robot/robot.toml");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(path, text + "# Edited.\n").unwrap();
    };
    refuses_run(robot, RESUME, &["robot/robot.toml was edited"]);
}

#[test]
fn results_that_could_not_be_written_are_refused_before_anything_is_played() {
    for file in ["none/such/x.json", "."] {
        let what = format!("cannot write {file}");
        let bench = ["bench", "ppo", "--set", "ppo.hidden=[8]", "--seconds", "1"];
        refuses_run(|_| (), &["eval", "run", "--json", file], &[&what]);
        refuses_run(|_| (), &[&bench[..], &["--json", file]].concat(), &[&what]);
        refuses_run(|_| (), &["export", "run", "--out", file], &[&what]);
    }
}

#[test]
fn an_export_over_files_that_are_something_else() {
    for file in ["run/config.toml", "run/metrics.csv", "tiny.toml"] {
        for option in ["--out", "--onnx"] {
            let what = format!("{option} would write over {file}");
            refuses_run(|_| (), &["export", "run", option, file], &[&what]);
        }
    }
    refuses_run(
        |_| (),
        &["export", "run", "--out", "x", "--onnx", "run/../x"],
        &["--out and --onnx are the same file"],
    );
    let folder = tempfile::tempdir().unwrap();
    copy(&RUN.1, &folder.path().join("run"));
    let export = ["export", "run", "--out", "p.omni", "--onnx", "p.onnx"];
    // Over what export itself has written it writes again.
    (0..2).for_each(|_| drop(succeeds(folder.path(), &export)));
    let output = omniwalk(
        folder.path(),
        &["export", "p.omni", "--out", "p.omni", "--format", "int8"],
    );
    assert_eq!(output.code, 2);
    assert!(output.message().contains("which is read"), "{}", output.err);
}

#[test]
fn a_run_whose_configuration_is_broken_is_not_described() {
    refuses_run(
        |run| replace(&run.join("config.toml"), "gamma = 0.99", "gamma = 7"),
        &["inspect", "run"],
        &["`ppo.gamma` must be 0 to 1", "run/config.toml:"],
    );
}

#[test]
fn a_report_into_a_file() {
    refuses_run(
        |run| fs::write(run.with_file_name("file"), "").unwrap(),
        &["report", "run", "--out", "file"],
        &["cannot create file", "file is a file, not a folder"],
    );
}

#[test]
fn weights_that_do_not_fit() {
    let start = ["train", "tiny.toml", "--run", "other", "--from", "run"];
    let refuses = |change: &str, parts: &[&str]| refuses_run(|_| (), &[&start[..], &["--set", change]].concat(), parts);
    let fit = "the networks of run do not fit this configuration";
    refuses("ppo.hidden=[32]", &[fit, "ppo.hidden is [16,16] there and [32] here"]);
    refuses("action.scale=0.5", &[fit, "action.scale is 0.7 there and 0.5 here"]);
    refuses(
        "clock.symmetric=false",
        &[fit, "clock.symmetric is true there and false here"],
    );
    refuses_in(|_| (), &start, &["run holds no run"]);
    refuses_run(
        |_| (),
        &["train", "--resume", "--run", "run", "--from", "run"],
        &["cannot be used with"],
    );
}

#[test]
fn an_evaluation_that_does_not_fit() {
    let pendulum = robot("pendulum").display().to_string();
    refuses_run(
        |_| (),
        &["eval", "run", "--robot", &pendulum],
        &["is not the robot that run was trained for"],
    );
    refuses_run(
        |_| (),
        &["eval", "run", "--episodes", "0"],
        &["`eval.episodes` must be at least 1"],
    );
    refuses_run(
        |_| (),
        &["eval", "run", "--seconds", "nan"],
        &["eval.seconds", "number"],
    );
    refuses_run(
        |_| (),
        &["eval", "run", "--seconds", "0.01"],
        &["`eval.seconds` must be"],
    );
    refuses_run(
        |_| (),
        &["eval", "run", "--set", "eval.commands=[[2.0, 0.0, 0.0]]"],
        &["`eval.commands`", "[2.0, 0.0, 0.0]", "bounds"],
    );
    let damaged = |run: &Path| checkpoints(run).iter().for_each(|file| cut(file));
    refuses_run(damaged, &["eval", "run"], &["is not a whole checkpoint"]);
}

#[test]
fn a_damaged_newest_checkpoint_is_skipped_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    copy(&RUN.1, &run);
    let files = checkpoints(&run);
    assert_eq!(files.len(), 3);
    cut(files.last().unwrap());
    let output = succeeds(folder.path(), &["eval", "run", "--seconds", "0.1"]);
    assert!(output.message().contains("warning:") && output.message().contains("is not a whole checkpoint"));
    assert!(output.out.contains("run after 360 steps"), "{}", output.out);
    let output = succeeds(folder.path(), RESUME);
    assert!(output.message().contains("is not a whole checkpoint"));
    assert!(output.out.contains("960 of 960 steps"), "{}", output.out);
    let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
    let steps: Vec<_> = metrics
        .lines()
        .skip(1)
        .map(|row| row.split(',').next().unwrap())
        .collect();
    assert_eq!(steps, ["120", "240", "360", "480", "600", "720", "840", "960"]);
}
