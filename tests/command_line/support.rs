//! What tests of the command line share: running it, a configuration small enough for tests, comparing folders.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use omniwalk::run::checkpoints::Checkpoints;

/// Gait measures of every row of an evaluation.
pub const GAIT: [&str; 6] = [
    "alternation",
    "touchdowns_per_second",
    "clearance_m",
    "air_time_s",
    "slip_mps",
    "leg_overlap",
];

/// What a run of the program gave.
pub struct Output {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Output {
    /// Standard error as one line: reports wrap long lines at the width of the terminal.
    pub fn message(&self) -> String {
        let frame = ["|", "│", "·", "╰──", "×", "╰─▶", "├─▶"];
        let words = self.err.split_whitespace().filter(|word| !frame.contains(word));
        words.collect::<Vec<_>>().join(" ")
    }
}

/// Runs `omniwalk` in `folder`.
pub fn omniwalk(folder: &Path, arguments: &[&str]) -> Output {
    let output = Command::cargo_bin("omniwalk")
        .unwrap()
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap();
    Output {
        code: output.status.code().unwrap_or(-1),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs `omniwalk` in `folder` and expects it to succeed.
#[track_caller]
pub fn succeeds(folder: &Path, arguments: &[&str]) -> Output {
    let output = omniwalk(folder, arguments);
    assert_eq!(output.code, 0, "omniwalk {}\n{}", arguments.join(" "), output.err);
    output
}

/// Runs `omniwalk` in a folder that `prepare` has filled, beside `tiny.toml`: it must refuse with a message that has
/// these parts, and write nothing.
#[track_caller]
pub fn refuses_in(prepare: impl FnOnce(&Path), arguments: &[&str], parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tiny.toml"), tiny()).unwrap();
    prepare(folder.path());
    let before = contents(folder.path());
    let output = omniwalk(folder.path(), arguments);
    let message = output.message();
    assert_eq!((output.code, output.out.as_str()), (2, ""), "{message}");
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in\n{message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert!(contents(folder.path()) == before, "something was written");
}

/// A folder of the repository's robots.
pub fn robot(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("robots").join(name)
}

/// The walk of the repository.
pub fn policy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("runs/nimbro_op2x_omni/policy.omni")
}

/// A configuration that trains in a blink: small networks, few environments, everything random switched on.
pub fn tiny() -> String {
    format!(
        "robot.path = {:?}\n\
         [train]\nenvironments = 5\nsteps_per_update = 24\nsteps = 480\n\
         [ppo]\nhidden = [16, 16]\nminibatch = 50\nepochs = 2\n\
         [randomise]\nmass = 0.1\ncentre_of_mass = 0.01\n\
         [push]\nenabled = true\ninterval = 0.5\n\
         [eval]\ncommands = [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]\nepisodes = 2\nseconds = 3.0\n",
        robot("nimbro_op2x")
    )
}

/// Every file below `folder` with its content, and every folder; the lock of a run folder, which stays when a run
/// ends, is left out.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path.clone());
                found.insert(path, None);
            } else if path.file_name().is_some_and(|name| name != ".lock") {
                let content = fs::read(&path).unwrap();
                found.insert(path, Some(content));
            }
        }
    }
    found
}

/// Copies a folder and what is below it.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

/// The newest checkpoint without the wall time in its metadata, as bytes.
pub fn state(run: &Path) -> Vec<u8> {
    let latest = Checkpoints::new(run.join("checkpoints")).latest().unwrap().unwrap();
    let mut checkpoint = latest.checkpoint;
    checkpoint.metadata.remove("wall_seconds").expect("the wall time");
    let path = run.join("state.safetensors");
    checkpoint.write(&path).unwrap();
    fs::read(path).unwrap()
}
