//! `omniwalk rehearse`: two processes that must cope with each other's absence.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::support::{omniwalk, robot, succeeds, tiny};
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde_json::Value;

/// A policy that has not learned anything and may hardly move: it stands.
fn policy(folder: &Path) {
    fs::write(folder.join("tiny.toml"), tiny()).unwrap();
    let train = ["train", "tiny.toml", "--run", "run", "--engine", "lanes", "--quiet"];
    let still = ["--set", "action.scale=0.02", "--set", "randomise.pd_noise=0.0"];
    succeeds(folder, &[&train[..], &still].concat());
    succeeds(folder, &["export", "run", "--out", "p.omni"]);
}

/// Starts a rehearsal of `seconds` with more `options` and the signals of `disturb`, which gets the processes of robot and controller.
fn rehearse(folder: &Path, seconds: &str, options: &[&str], disturb: impl FnOnce(u32, u32)) -> Value {
    let mut process = Command::new(assert_cmd::cargo::cargo_bin("omniwalk"))
        .current_dir(folder)
        .args(["rehearse", "p.omni", "--seconds", seconds, "--command", "0,0,0"])
        .args(["--log", "log.mcap", "--json", "result.json", "--robot"])
        .arg(robot("nimbro_op2x"))
        .args(options)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(process.stdout.take().unwrap()).lines();
    let line = lines.next().unwrap().unwrap();
    let controller = line.strip_prefix("controller: process ").expect(&line).parse().unwrap();
    disturb(process.id(), controller);
    finish(&mut process);
    lines.for_each(drop);
    serde_json::from_str(&fs::read_to_string(folder.join("result.json")).unwrap()).unwrap()
}

fn finish(robot: &mut Child) {
    assert!(robot.wait().unwrap().success());
}

fn signal(process: u32, name: &str) {
    let status = Command::new("kill")
        .args([name, &process.to_string()])
        .status()
        .unwrap();
    assert!(status.success());
}

#[test]
fn what_cannot_be_rehearsed_is_refused_before_anything_starts() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    policy(folder);
    let home = robot("nimbro_op2x");
    for (option, value, part) in [
        (
            "--command",
            "9,9,9",
            "must be within the bounds the policy was trained for",
        ),
        ("--json", "none/x.json", "cannot write none/x.json"),
        ("--log", ".", "cannot write ."),
    ] {
        let rehearse = ["rehearse", "p.omni", "--robot", home.to_str().unwrap(), option, value];
        let output = omniwalk(folder, &rehearse);
        assert_eq!((output.code, output.out.as_str()), (2, ""), "{option}");
        assert!(output.message().contains(part), "{}", output.err);
    }
    assert!(!folder.join("p.rehearsal.mcap").exists());
}

#[test]
fn a_rehearsal_reports_and_writes_the_log_of_a_robot() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    policy(folder);
    let result = rehearse(folder, "4", &[], |_, _| {});
    let number = |pointer: &str| result.pointer(pointer).and_then(Value::as_f64).expect(pointer);
    assert!(number("/readings") > 20.0 && number("/commands") > 20.0, "{result}");
    assert_eq!(number("/restarts"), 0.0);
    assert!(result["fell_after_s"].is_null(), "{result}");
    // The median reading is used when it is as old as was drawn, to a physics step of 5 ms and the machine's own delays.
    assert!(number("/latency_s") > 0.0 && number("/latency_s") < 0.05, "{result}");
    let late = number("/latency_ms/p50") - 1e3 * number("/latency_s");
    assert!((-5.0..15.0).contains(&late), "{result}");
    assert!(number("/latency_ms/max") >= number("/latency_ms/p99"));
    assert!(number("/step_us/p50") > 0.0);
    let log = succeeds(folder, &["inspect", "log.mcap"]).out;
    for topic in ["/joint_states", "/joint_commands", "/imu", "/cmd_vel"] {
        assert!(log.contains(topic), "{topic} is not in\n{log}");
    }

    // Jitter makes single readings later, by what the configuration says.
    let jitter = ["latency.lower=0.01", "latency.upper=0.01", "latency.jitter=0.1"].map(|it| ["--set", it]);
    let late = rehearse(folder, "4", &jitter.concat(), |_, _| {});
    assert_eq!(late["jitter_s"], 0.1);
    let at = |which: &str| late["latency_ms"][which].as_f64().unwrap();
    assert!(at("p50") > 30.0 && at("p50") < 100.0 && at("p90") > 70.0, "{late}");

    // The controller's process stops for a second: the servos hold.
    let result = rehearse(folder, "9", &[], |_, controller| {
        sleep(Duration::from_secs(3));
        signal(controller, "-STOP");
        sleep(Duration::from_secs(1));
        signal(controller, "-CONT");
    });
    assert!(result["longest_silence_s"].as_f64().unwrap() > 0.9, "{result}");
    assert_eq!(result["restarts"], 0);
    recovered(&result);

    // It dies and is started again a second later: the servos hold, then another takes over.
    let result = rehearse(folder, "9", &[], |_, controller| {
        sleep(Duration::from_secs(3));
        signal(controller, "-KILL");
    });
    assert_eq!(result["restarts"], 1, "{result}");
    assert!(result["longest_silence_s"].as_f64().unwrap() > 0.9, "{result}");
    recovered(&result);

    // The robot is gone for a second: the controller holds, then goes to the nominal pose.
    let result = rehearse(folder, "9", &[], |robot, _| {
        sleep(Duration::from_secs(3));
        signal(robot, "-STOP");
        sleep(Duration::from_secs(1));
        signal(robot, "-CONT");
    });
    assert!(result["physics_skipped"].as_u64().unwrap() > 100, "{result}");
    recovered(&result);
}

#[test]
fn ctrl_c_ends_a_rehearsal_with_its_report_and_a_whole_log() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    policy(folder);
    let begin = Instant::now();
    let result = rehearse(folder, "600", &[], |robot, _| {
        let log = folder.join("log.mcap");
        let until = Instant::now() + Duration::from_secs(60);
        while fs::metadata(&log).map_or(0, |data| data.len()) < 50_000 && Instant::now() < until {
            sleep(Duration::from_millis(50));
        }
        signal(robot, "-INT");
    });
    assert!(begin.elapsed() < Duration::from_secs(120));
    let seconds = result["seconds"].as_f64().unwrap();
    assert!(seconds > 0.5 && seconds < 60.0, "{result}");
    assert!(result["readings"].as_u64().unwrap() > 20, "{result}");
    succeeds(folder, &["inspect", "log.mcap"]);
}

#[test]
fn a_robot_that_is_killed_leaves_its_log_and_nothing_else_and_can_be_started_again() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path();
    policy(folder);
    let litter = tempfile::tempdir().unwrap();
    let mut process = Command::new(assert_cmd::cargo::cargo_bin("omniwalk"))
        .current_dir(folder)
        .env("TMPDIR", litter.path())
        .args([
            "rehearse",
            "p.omni",
            "--seconds",
            "60",
            "--command",
            "0,0,0",
            "--log",
            "log.mcap",
            "--robot",
        ])
        .arg(robot("nimbro_op2x"))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(process.stdout.take().unwrap()).lines();
    let line = lines.next().unwrap().unwrap();
    let controller: u32 = line.strip_prefix("controller: process ").expect(&line).parse().unwrap();
    // The log is made safe twice a second, once the robot lives.
    let until = Instant::now() + Duration::from_secs(60);
    let log = folder.join("log.mcap");
    while fs::metadata(&log).map_or(0, |data| data.len()) < 50_000 && Instant::now() < until {
        sleep(Duration::from_millis(50));
    }
    signal(process.id(), "-KILL");
    process.wait().unwrap();
    // What has ended and waits to be reaped has no command line.
    let alive = |process: u32| fs::read(format!("/proc/{process}/cmdline")).is_ok_and(|line| !line.is_empty());
    let until = Instant::now() + Duration::from_secs(10);
    while alive(controller) && Instant::now() < until {
        sleep(Duration::from_millis(50));
    }
    assert!(!alive(controller), "the controller ends with its robot");
    assert_eq!(fs::read_dir(litter.path()).unwrap().count(), 0, "no litter");

    let output = omniwalk(folder, &["inspect", "log.mcap"]);
    assert!(
        output.message().contains("`mcap recover` makes a whole log"),
        "{}",
        output.err
    );
    // What `mcap recover` does: every whole chunk is read.
    let bytes = fs::read(&log).unwrap();
    let options = LinearReaderOptions::default().with_skip_end_magic(true);
    let mut reader = LinearReader::new_with_options(options);
    let (mut at, mut messages) = (0, 0);
    while let Some(Ok(event)) = reader.next_event() {
        match event {
            LinearReadEvent::ReadRequest(need) => {
                let some = &bytes[at..(at + need).min(bytes.len())];
                reader.insert(need)[..some.len()].copy_from_slice(some);
                reader.notify_read(some.len());
                at += some.len();
            }
            LinearReadEvent::Record { opcode, .. } => messages += u32::from(opcode == op::MESSAGE),
        }
    }
    assert!(messages > 20, "{messages} messages are left");

    let result = rehearse(folder, "6", &[], |_, _| {});
    recovered(&result);
}

/// It walks again or stands in the nominal pose, and the robot has not fallen: a machine with much else to do may keep it from
/// walking, as readings are stale then, but not from standing.
#[track_caller]
fn recovered(result: &Value) {
    let changes = result["changes"].as_array().unwrap();
    let last = changes.last().unwrap();
    assert!(["walking", "resting"].contains(&last[1].as_str().unwrap()), "{result}");
    assert!(result["fell_after_s"].is_null(), "{result}");
    assert!(result["commands"].as_u64().unwrap() > 50, "{result}");
}
