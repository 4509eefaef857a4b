//! The record of who trained a run and when, which is kept, and which nothing depends on.

use std::fs;
use std::path::Path;

use super::support::{omniwalk, state, succeeds, tiny};

const START: [&str; 6] = ["train", "tiny.toml", "--run", "run", "--engine", "lanes"];
const RESUME: [&str; 6] = ["train", "--resume", "--run", "run", "--steps", "480"];

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tiny.toml"), tiny()).unwrap();
    folder
}

#[test]
fn a_run_says_how_it_was_made() {
    let folder = folder();
    succeeds(
        folder.path(),
        &[
            &START[..],
            &["--set", "ppo.clip = 0.1", "--steps", "240", "--threads", "1"],
        ]
        .concat(),
    );
    succeeds(folder.path(), &[&RESUME[..], &["--threads", "2"]].concat());
    let described = succeeds(folder.path(), &["inspect", "run"]).out;
    for part in [
        "how it was made: in 2 sessions",
        "omniwalk train tiny.toml --run run --engine lanes --set 'ppo.clip = 0.1' --steps 240 --threads 1",
        "steps 0 to 240 in",
        "omniwalk train --resume --run run --steps 480 --threads 2",
        "steps 240 to 480 in",
        concat!("omniwalk ", env!("CARGO_PKG_VERSION")),
        "1 threads, learner ",
        " cores, ",
        "seed 1",
    ] {
        assert!(described.contains(part), "{part:?} is not in\n{described}");
    }
    let record = fs::read_to_string(folder.path().join("run/sessions.toml")).unwrap();
    let here = folder.path().display().to_string();
    assert!(!record.contains(&here), "{record}");
    assert!(
        succeeds(folder.path(), &["inspect", "run/sessions.toml"])
            .out
            .contains("in 2 sessions")
    );
}

/// The record of a run, broken in some way, and what is said of that.
fn broken(whole: &str) -> Vec<(Vec<u8>, &'static str)> {
    let line = |key: &str| whole.lines().find(|line| line.starts_with(key)).unwrap().to_owned();
    let with = |key: &str, value: &str| whole.replace(&line(key), &format!("{key} = {value}")).into_bytes();
    vec![
        (b"[[session]]\nversion = 3\n".to_vec(), "invalid type"),
        (b"rubbish".to_vec(), "is damaged"),
        (vec![0xff; 40], "it is not text"),
        (
            with("seconds", "1e308"),
            "`seconds` of session 1 is 1e308, which no session lasts",
        ),
        (with("seconds", "nan"), "`seconds` of session 1 is NaN"),
        (with("seconds", "-1.0"), "`seconds` of session 1 is -1e0"),
        (
            with("first_step", "1000"),
            "session 1 ends at step 240, before its first, 1000",
        ),
    ]
}

/// Whether standard error warns of the record and says `part`, and nothing shows walls of digits.
#[track_caller]
fn warns(folder: &Path, arguments: &[&str], part: &str) -> String {
    let output = succeeds(folder, arguments);
    let message = output.message();
    assert!(
        message.contains("warning: run/sessions.toml is damaged: ") && message.contains(part),
        "{message}"
    );
    let all = output.out.clone() + &message;
    assert!(!all.contains("00000000000000000000"), "{all}");
    all
}

#[test]
fn a_damaged_record_stops_nothing_and_is_kept() {
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    let run = folder.path().join("run");
    let record = run.join("sessions.toml");
    let whole = fs::read_to_string(&record).unwrap();
    for (bytes, part) in broken(&whole) {
        fs::write(&record, &bytes).unwrap();
        let said = warns(folder.path(), &["inspect", "run"], part);
        assert!(
            said.contains("how it was made: not known, its record is damaged"),
            "{said}"
        );
        warns(folder.path(), &["report", "run"], part);
        let html = fs::read_to_string(run.join("report.html")).unwrap();
        assert!(
            html.contains("How it was trained is not recorded: run/sessions.toml is damaged"),
            "{html}"
        );
        let alone = omniwalk(folder.path(), &["inspect", "run/sessions.toml"]);
        assert!(
            alone.code == 2 && alone.message().contains("it is a record only"),
            "{}",
            alone.err
        );
        assert_eq!(fs::read(&record).unwrap(), bytes);
    }
    let (first, second) = (b"first".to_vec(), b"second".to_vec());
    fs::write(run.join("sessions.damaged-1.toml"), &first).unwrap();
    fs::write(&record, &second).unwrap();
    let kept =
        "it is kept as run/sessions.damaged-2.toml, and who trained until now, and when, is not recorded any more";
    warns(folder.path(), &RESUME, kept);
    assert_eq!(fs::read(run.join("sessions.damaged-1.toml")).unwrap(), first);
    assert_eq!(fs::read(run.join("sessions.damaged-2.toml")).unwrap(), second);
    let described = succeeds(folder.path(), &["inspect", "run"]);
    for part in ["how it was made: in one session", "steps 240 to 480 in"] {
        assert!(described.out.contains(part), "{}", described.out);
    }
    let undisturbed = self::folder();
    succeeds(undisturbed.path(), &START);
    assert!(state(&run) == state(&undisturbed.path().join("run")));
}

#[test]
fn a_folder_in_the_place_of_the_record_is_moved_aside_with_what_is_in_it() {
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    let run = folder.path().join("run");
    fs::remove_file(run.join("sessions.toml")).unwrap();
    fs::create_dir(run.join("sessions.toml")).unwrap();
    fs::write(run.join("sessions.toml/mine"), "mine").unwrap();
    warns(folder.path(), &["inspect", "run"], "is a directory");
    warns(folder.path(), &RESUME, "is a directory");
    assert_eq!(fs::read(run.join("sessions.damaged-1.toml/mine")).unwrap(), b"mine");
}
