//! Run folders that cannot be lost and that say where they come from, through the command line.

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::support::{contents, omniwalk, state, succeeds, tiny};
use omniwalk::run::checkpoint::Checkpoint;
use omniwalk::run::checkpoints::Checkpoints;
use omniwalk::run::tensor::Data;

const START: [&str; 6] = ["train", "tiny.toml", "--run", "run", "--engine", "lanes"];
const RESUME: [&str; 6] = ["train", "--resume", "--run", "run", "--steps", "480"];

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tiny.toml"), tiny()).unwrap();
    folder
}

/// The state of a run of 480 steps that nothing disturbed.
fn undisturbed() -> Vec<u8> {
    let folder = folder();
    succeeds(folder.path(), &START);
    state(&folder.path().join("run"))
}

/// Training without an end, in the background.
fn endless(folder: &Path) -> Child {
    Command::new(env!("CARGO_BIN_EXE_omniwalk"))
        .current_dir(folder)
        .args(START)
        .args(["--steps", "1000000000", "--quiet"])
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn wait_for(file: &Path) {
    let started = Instant::now();
    while !file.exists() {
        assert!(started.elapsed() < Duration::from_secs(120), "no {}", file.display());
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// As `kill -9` does.
fn kill(mut child: Child) {
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_run_killed_at_any_moment_goes_on_or_starts_again_to_the_same_bits() {
    let expected = undisturbed();
    let began = |folder: &Path| folder.join("run/config.toml").exists();
    for moment in [
        "run/.lock",
        "run/robot",
        "run/checkpoints",
        "run/sessions.toml",
        "run/config.toml",
        "run/metrics.csv",
    ] {
        let folder = folder();
        let child = endless(folder.path());
        wait_for(&folder.path().join(moment));
        kill(child);
        // Only a run that has begun can be resumed; before, it is started again in place.
        if began(folder.path()) {
            succeeds(folder.path(), &RESUME);
        } else {
            assert_eq!(omniwalk(folder.path(), &RESUME).code, 2, "at {moment}");
            succeeds(folder.path(), &START);
        }
        assert!(
            state(&folder.path().join("run")) == expected,
            "other bits after a kill at {moment}"
        );
    }
}

#[test]
fn a_process_that_was_killed_leaves_no_lock_behind() {
    let folder = folder();
    let child = endless(folder.path());
    wait_for(&folder.path().join("run/metrics.csv"));
    let second = omniwalk(folder.path(), &RESUME);
    assert_eq!(second.code, 2);
    assert!(
        second.message().contains("another omniwalk is training in run"),
        "{}",
        second.err
    );
    kill(child);
    succeeds(folder.path(), &RESUME);
}

#[test]
fn a_run_folder_that_somebody_removes_ends_the_run_at_once() {
    for replaced in [false, true] {
        let folder = folder();
        let mut child = Command::new(env!("CARGO_BIN_EXE_omniwalk"))
            .current_dir(folder.path())
            .args(START)
            .args([
                "--steps",
                "1000000000",
                "--quiet",
                "--set",
                "train.checkpoint_minutes=60.0",
            ])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let run = folder.path().join("run");
        let metrics = run.join("metrics.csv");
        wait_for(&metrics);
        while fs::read_to_string(&metrics).unwrap().lines().count() < 2 {
            std::thread::sleep(Duration::from_millis(1));
        }
        // In one go: files that are written meanwhile would keep a folder from being removed.
        fs::rename(&run, folder.path().join("gone")).unwrap();
        fs::remove_dir_all(folder.path().join("gone")).unwrap();
        if replaced {
            fs::create_dir_all(run.join("checkpoints")).unwrap();
            fs::write(run.join(".lock"), "omniwalk\n").unwrap();
        }
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(2), "{said}");
        assert!(
            said.contains("was removed or replaced while training wrote to it"),
            "{said}"
        );
        // Nothing of it is left behind that looks like a run.
        assert!(!run.join("metrics.csv").exists() && !run.join("sessions.toml").exists());
    }
}

#[test]
fn a_finished_run_is_extended_with_other_settings_of_the_machine() {
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    let config = folder.path().join("run/config.toml");
    let text = fs::read_to_string(&config).unwrap();
    let edited = text
        .replace("checkpoint_minutes = 5.0", "checkpoint_minutes = 1.0")
        .replace("keep_checkpoints = 3", "keep_checkpoints = 2");
    assert_ne!(edited, text);
    fs::write(&config, &edited).unwrap();
    succeeds(folder.path(), &[&RESUME[..], &["--threads", "1"]].concat());
    assert!(state(&folder.path().join("run")) == undisturbed());
    let extended = fs::read_to_string(&config).unwrap();
    assert_eq!(extended, edited.replace("steps = 240", "steps = 480"));
    let before = contents(folder.path());
    let again = succeeds(folder.path(), &RESUME[..4]).out;
    assert!(
        again.contains("nothing to do: run has done 480 of 480 steps"),
        "{again}"
    );
    assert!(
        again.contains("extend: omniwalk train --resume --run run --steps N"),
        "{again}"
    );
    assert!(contents(folder.path()) == before, "something was written");
}

#[test]
fn a_run_that_comes_apart_says_so_at_once() {
    let folder = folder();
    let wild = [
        "--set",
        "ppo.schedule={type=\"fixed\"}",
        "--set",
        "ppo.learning_rate=1.0",
    ];
    let train = |more: &[&str]| {
        fs::remove_dir_all(folder.path().join("run")).ok();
        succeeds(folder.path(), &[&START, &wild[..], more].concat()).out
    };
    let text = train(&[]);
    assert!(
        text.contains("WARNING: diverging: the policy changed by a KL of"),
        "{text}"
    );
    let quiet = train(&["--quiet"]);
    assert!(
        quiet.contains("WARNING: in") && quiet.contains("at last: diverging"),
        "{quiet}"
    );
    let json = train(&["--log-format", "json"]);
    assert!(json.contains("\"warning\":\"diverging"), "{json}");
    let objects = json.lines().map(serde_json::from_str::<serde_json::Value>);
    let objects: Vec<_> = objects.map(|object| object.expect("an object a line")).collect();
    let end = objects.last().expect("lines");
    assert_eq!(end["finished"], 480, "{json}");
    for figure in [
        "episode_s",
        "fallen",
        "leg_overlap",
        "error_xy_mps",
        "error_yaw_radps",
        "alternation",
    ] {
        assert!(end.get(figure).is_some(), "{figure} is not in {end}");
    }
    assert_eq!(end["next"][1], "omniwalk eval run");
    assert!(
        !succeeds(folder.path(), &[&START[..2], &["--run", "sound"]].concat())
            .out
            .contains("WARNING")
    );
}

#[test]
fn rows_of_metrics_that_are_damaged_are_left_out_with_a_warning() {
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    let path = folder.path().join("run/metrics.csv");
    let text = fs::read_to_string(&path).unwrap();
    let row = text.lines().last().unwrap();
    fs::write(&path, text.replace(row, &format!("{row},,"))).unwrap();
    let resumed = succeeds(folder.path(), &RESUME);
    let line = text.lines().count();
    let says = format!("run/metrics.csv:{line}: this row has another number of cells");
    assert!(resumed.message().contains(&says), "{}", resumed.err);
    let refused = |header: &str, says: &str| {
        fs::write(&path, format!("{header}\n")).unwrap();
        let output = omniwalk(folder.path(), &[&RESUME[..4], &["--steps", "720"]].concat());
        assert_eq!(output.code, 2);
        assert!(output.message().contains(says), "{}", output.err);
    };
    refused(
        "\u{1}\u{2}\u{3}",
        "metrics.csv:1: this run writes no column \"\\u{1}\\u{2}\\u{3}\"",
    );
    refused(
        "step,update,update",
        "metrics.csv:1: this run writes no column \"update\"",
    );
}

#[test]
fn metrics_that_are_gone_are_missed() {
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    fs::remove_file(folder.path().join("run/metrics.csv")).unwrap();
    let resumed = succeeds(folder.path(), &RESUME);
    assert!(resumed.message().contains("run/metrics.csv is gone"), "{}", resumed.err);
    assert!(state(&folder.path().join("run")) == undisturbed());
    fs::write(folder.path().join("run/metrics.csv"), "").unwrap();
    fs::write(folder.path().join("run/sessions.toml"), "").unwrap();
    let emptied = succeeds(folder.path(), &[&RESUME[..4], &["--steps", "600"]].concat());
    for says in ["run/metrics.csv is empty", "sessions.damaged-1.toml"] {
        assert!(emptied.message().contains(says), "{}", emptied.err);
    }
}

#[cfg(unix)]
#[test]
fn a_folder_that_nobody_may_write_to_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    let run = folder.path().join("run");
    let allow = |mode| {
        fs::set_permissions(run.join(".lock"), fs::Permissions::from_mode(mode & 0o666)).unwrap();
        fs::set_permissions(&run, fs::Permissions::from_mode(mode)).unwrap();
    };
    allow(0o555);
    let everything_is_allowed = fs::File::create(run.join("probe")).is_ok();
    if everything_is_allowed {
        eprintln!("not tested: this user may write anywhere");
        return;
    }
    let refused = omniwalk(folder.path(), &RESUME);
    allow(0o755);
    assert_eq!(refused.code, 2);
    let message = refused.message();
    for part in ["cannot write to the run folder run", "make it writable"] {
        assert!(message.contains(part), "{part:?} is not in\n{message}");
    }
}

/// A folder in the lock's place can be opened by nobody, not even by root.
#[test]
fn a_lock_that_cannot_be_taken_is_named() {
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    let lock = folder.path().join("run/.lock");
    fs::remove_file(&lock).unwrap();
    fs::create_dir(&lock).unwrap();
    let refused = omniwalk(folder.path(), &RESUME);
    assert_eq!(refused.code, 2);
    assert!(
        refused.message().contains("cannot write to the run folder run"),
        "{}",
        refused.err
    );
}

fn newest(run: &Path) -> Checkpoint {
    Checkpoints::new(run.join("checkpoints"))
        .latest()
        .unwrap()
        .unwrap()
        .checkpoint
}

#[test]
fn a_run_begins_with_the_weights_of_another() {
    let folder = folder();
    succeeds(folder.path(), &START);
    let start = [
        "train",
        "tiny.toml",
        "--run",
        "fine",
        "--from",
        "run",
        "--engine",
        "rapier",
        "--steps",
        "120",
    ];
    succeeds(folder.path(), &start);
    let source = newest(&folder.path().join("run"));
    let first = folder.path().join("fine/checkpoints/step-000000000000.safetensors");
    let begun = Checkpoint::read(&first).unwrap();
    for (name, tensor) in begun.tensors.iter().filter(|(name, _)| name.starts_with("agent.")) {
        let zero = matches!(&tensor.data, Data::F32(values) if values.iter().all(|x| *x == 0.0));
        match name.as_str() {
            "agent.optimiser_steps" => assert_eq!(tensor.data, Data::U64(vec![0])),
            "agent.learning_rate" => assert_eq!(tensor.data, Data::F64(vec![3e-4])),
            _ if name.ends_with("_moment") => assert!(zero, "{name}"),
            _ => assert!(source.tensors[name] == *tensor, "{name}"),
        }
    }
    let described = succeeds(folder.path(), &["inspect", "fine"]).out;
    let origin = "began with actor, critic, normaliser of run at step 480, configuration ";
    assert!(described.contains(origin), "{described}");
}

/// The program with `arguments` and its standard output at `out`: exit code and standard error.
#[cfg(target_os = "linux")]
fn written_to(folder: &Path, arguments: &[&str], out: impl Into<Stdio>) -> (Option<i32>, String) {
    let child = Command::new(env!("CARGO_BIN_EXE_omniwalk"))
        .current_dir(folder)
        .args(arguments)
        .stdout(out)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let output = child.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_output_is_said_and_costs_no_run() {
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let folder = folder();
    let (code, said) = written_to(folder.path(), &START, full());
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("cannot write to standard output"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    let run = folder.path().join("run");
    assert!(newest(&run).step > 0, "what was learned is lost");
    succeeds(folder.path(), &RESUME);
    assert!(state(&run) == undisturbed());
    let (code, said) = written_to(folder.path(), &["inspect", "run"], full());
    assert_eq!(code, Some(2), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_reader_that_has_gone_ends_the_program_without_a_word() {
    let closed = || {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        writer
    };
    let folder = folder();
    let (code, said) = written_to(folder.path(), &START, closed());
    assert_eq!(code, Some(0), "{said}");
    assert!(!said.contains("Error") && !said.contains("panicked"), "{said}");
    assert!(newest(&folder.path().join("run")).step > 0, "what was learned is lost");
    let (code, said) = written_to(folder.path(), &["inspect", "run"], closed());
    assert_eq!((code, said.as_str()), (Some(0), ""));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_costs_no_checkpoint() {
    let folder = folder();
    succeeds(folder.path(), &[&START[..], &["--steps", "240"]].concat());
    let run = folder.path().join("run");
    // What is written to this device finds no room, whoever writes.
    let unfinished = run.join("checkpoints/step-000000000480.safetensors.unfinished");
    std::os::unix::fs::symlink("/dev/full", &unfinished).unwrap();
    let full = omniwalk(folder.path(), &RESUME);
    assert_eq!(full.code, 2);
    let message = full.message();
    for part in [
        "cannot write run/checkpoints/step-000000000480.safetensors",
        "No space left",
        "--resume",
    ] {
        assert!(message.contains(part), "{part:?} is not in\n{message}");
    }
    assert_eq!(newest(&run).step, 240);
    succeeds(folder.path(), &RESUME);
    assert!(state(&run) == undisturbed());
}
