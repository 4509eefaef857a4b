//! Same configuration and seed, same bits: with any number of threads, stopped and resumed or not.

use std::fs;
use std::path::{Path, PathBuf};

use super::support::{state, succeeds, tiny};
use omniwalk::run::checkpoints::Checkpoints;

const ENGINES: [&str; 2] = ["rapier", "lanes"];

/// Columns that hold wall time.
const TIMING: [&str; 5] = [
    "seconds",
    "steps_per_second",
    "time/physics",
    "time/inference",
    "time/update",
];

/// Trains into `name` within `folder`.
fn train(folder: &Path, name: &str, engine: &str, arguments: &[&str]) -> PathBuf {
    fs::write(folder.join("tiny.toml"), tiny()).unwrap();
    // More environments than lanes are wide, so that there is more than one group to share among threads.
    let change = ["--engine", engine, "--set", "train.environments=40", "--quiet"];
    let steps = ["--steps", "4800"];
    let steps = if arguments.contains(&"--steps") {
        &[]
    } else {
        &steps[..]
    };
    succeeds(
        folder,
        &[&["train", "tiny.toml", "--run", name], &change[..], steps, arguments].concat(),
    );
    folder.join(name)
}

/// The rows of `metrics.csv` without the columns of [`TIMING`].
fn metrics(run: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(run.join("metrics.csv")).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    assert!(TIMING.iter().all(|name| names.contains(name)));
    let kept = |row: &str| -> Vec<String> {
        let cells = row.split(',').zip(&names).filter(|(_, name)| !TIMING.contains(name));
        cells.map(|(cell, _)| cell.to_owned()).collect()
    };
    text.lines().map(kept).collect()
}

#[test]
fn one_and_two_threads_give_the_same_bits_and_another_seed_gives_others() {
    for engine in ENGINES {
        let folder = tempfile::tempdir().unwrap();
        let one = train(folder.path(), "one", engine, &["--threads", "1"]);
        let two = train(folder.path(), "two", engine, &["--threads", "2"]);
        assert!(state(&one) == state(&two), "checkpoints differ in {engine}");
        assert_eq!(metrics(&one), metrics(&two));
        let other = train(folder.path(), "other", engine, &["--seed", "2"]);
        assert!(state(&one) != state(&other));
        assert_ne!(metrics(&one)[1], metrics(&other)[1]);
    }
}

#[test]
fn a_run_that_was_stopped_goes_on_to_the_same_bits() {
    for engine in ENGINES {
        let folder = tempfile::tempdir().unwrap();
        let whole = train(folder.path(), "whole", engine, &[]);
        let parts = train(folder.path(), "parts", engine, &["--steps", "1920"]);
        assert!(state(&whole) != state(&parts));
        for steps in ["2880", "4800"] {
            let resume = [
                "train",
                "--resume",
                "--run",
                "parts",
                "--steps",
                steps,
                "--threads",
                "1",
                "--quiet",
            ];
            succeeds(folder.path(), &resume);
        }
        assert!(state(&whole) == state(&parts), "checkpoints differ in {engine}");
        assert_eq!(metrics(&whole), metrics(&parts));
        assert_eq!(metrics(&whole).len(), 6, "a header and five updates");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupt_finishes_the_update_and_writes_a_checkpoint() {
    // Ctrl-C, and what a machine sends that shuts down.
    for signal in ["-INT", "-TERM"] {
        interrupted_by(signal, &[]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_terminal_that_is_closed_interrupts_unless_nohup_says_otherwise() {
    // These tests may themselves run under nohup.
    interrupted_by("-HUP", &["env", "--default-signal=HUP"]);

    let folder = tempfile::tempdir().unwrap();
    let mut child = training(folder.path(), &["nohup"]);
    let rows = || fs::read_to_string(folder.path().join("run/metrics.csv")).map_or(0, |text| text.lines().count());
    let before = rows();
    kill("-HUP", &child);
    while rows() < before + 20 {
        assert!(child.try_wait().unwrap().is_none(), "training has ended");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    kill("-INT", &child);
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[cfg(target_os = "linux")]
#[test]
fn an_interrupt_whose_words_nobody_reads_writes_a_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tiny.toml"), tiny()).unwrap();
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_omniwalk"))
        .current_dir(folder.path())
        .args(["train", "tiny.toml", "--run", "run", "--steps", "1000000000", "--quiet"])
        .stdout(full())
        .stderr(full())
        .spawn()
        .unwrap();
    let rows = || fs::read_to_string(folder.path().join("run/metrics.csv")).map_or(0, |text| text.lines().count());
    while rows() < 3 {
        assert!(child.try_wait().unwrap().is_none(), "training has ended");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    kill("-INT", &child);
    // What cannot be said is an error, and no more than that.
    assert_eq!(child.wait().unwrap().code(), Some(2));
    let run = folder.path().join("run");
    let latest = Checkpoints::new(run.join("checkpoints")).latest().unwrap().unwrap();
    assert_eq!(latest.checkpoint.step.to_string(), metrics(&run).last().unwrap()[0]);
}

#[cfg(unix)]
fn kill(signal: &str, child: &std::process::Child) {
    let sent = std::process::Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
}

/// A training in the folder's `run` that has done some updates; `prefix` are words before the program's name.
#[cfg(unix)]
fn training(folder: &Path, prefix: &[&str]) -> std::process::Child {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    fs::write(folder.join("tiny.toml"), tiny()).unwrap();
    let train = ["train", "tiny.toml", "--run", "run", "--steps", "1000000000"];
    let mut words = prefix.iter().copied().chain([env!("CARGO_BIN_EXE_omniwalk")]);
    let child = Command::new(words.next().unwrap())
        .current_dir(folder)
        .args(words)
        .args(train)
        .args(["--engine", "lanes"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let rows = || fs::read_to_string(folder.join("run/metrics.csv")).map_or(0, |text| text.lines().count());
    let started = Instant::now();
    while rows() < 3 && started.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

#[cfg(unix)]
fn interrupted_by(signal: &str, prefix: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let child = training(folder.path(), prefix);
    kill(signal, &child);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let (out, err) = (
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    );
    assert!(err.contains("stopped; writing a checkpoint"), "{err}");
    assert!(out.contains("go on:  omniwalk train --resume --run run"), "{out}");
    let run = folder.path().join("run");
    let latest = Checkpoints::new(run.join("checkpoints"))
        .latest()
        .unwrap()
        .unwrap()
        .checkpoint;
    let last = metrics(&run).last().unwrap()[0].clone();
    assert_eq!(
        latest.step.to_string(),
        last,
        "the checkpoint is of the last update in metrics.csv"
    );
    let more = (latest.step + 1).to_string();
    let resumed = succeeds(folder.path(), &["train", "--resume", "--run", "run", "--steps", &more]);
    assert!(
        resumed.out.contains(&format!("{} of {more} steps", latest.step + 120)),
        "{}",
        resumed.out
    );
}
