//! From logs of a servo that answers late to a robot that does: `excite`, `replay`, `identify`, `inspect`.

use std::collections::VecDeque;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{contents, omniwalk, refuses_in, robot, succeeds};

/// Step of the servo's simulation, s.
const DT: f64 = 1e-4;
/// By how much commands arrive late, s.
const LATE: f64 = 0.02;
const MAP: &str = "time = { column = \"t\", unit = \"s\" }\n[[joint]]\nnames = [\"hinge\"]\nposition = { column = \"q\" }\ncommand = { column = \"target\" }\n";

/// Writes a log of `robots/pendulum` whose commands arrive late: 4 s at 200 Hz, rounded to a tenth of a milliradian.
fn write_log(file: &Path, rate: f64) {
    let (mass, length, inertia) = (0.5, 0.15, 0.003_766_7 + 0.5 * 0.15 * 0.15 + 0.0012);
    let (mut q, mut speed): (f64, f64) = (0.0, 0.0);
    let mut past: VecDeque<f64> = std::iter::repeat_n(0.0, (LATE / DT).round() as usize).collect();
    let mut text = "t,q,target\n".to_owned();
    for step in 0..40_000 {
        let t = f64::from(step) * DT;
        // Held between readings, as a controller holds it.
        let at = (t / 0.005 + 1e-9).floor() * 0.005;
        let target = 0.5 * (rate * at).sin() + 0.3 * (2.7 * rate * at).sin();
        if step % 50 == 0 {
            writeln!(text, "{t:.3},{:.4},{target:.6}", q).unwrap();
        }
        past.push_back(target);
        let told = past.pop_front().unwrap();
        let torque = (10.0 * (told - q) - 0.2 * speed).clamp(-4.1, 4.1) - mass * 9.81 * length * q.sin();
        speed += DT * torque / inertia;
        q += DT * speed;
    }
    fs::write(file, text).unwrap();
}

/// Logs `a` to `c` to fit, `d` held out, and their map.
fn prepare(folder: &Path) {
    for (name, rate) in [("a", 2.0), ("b", 3.1), ("c", 4.3), ("d", 2.6)] {
        write_log(&folder.join(format!("{name}.csv")), rate);
    }
    fs::write(folder.join("map.toml"), MAP).unwrap();
}

#[test]
fn what_a_late_servo_lacks_is_named_with_the_motion_that_would_say_more() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let pendulum = robot("pendulum");
    let pendulum = pendulum.to_str().unwrap();
    let replay = [
        "replay",
        "a.csv",
        "--map",
        "map.toml",
        "--robot",
        pendulum,
        "--html",
        "replay.html",
    ];
    let replayed = succeeds(folder, &replay);
    assert!(
        replayed.out.contains("hinge") && replayed.err.contains("read Hz"),
        "{}",
        replayed.out
    );
    let page = fs::read_to_string(folder.join("replay.html")).unwrap();
    for part in [
        "spectrum and autocorrelation",
        "torque that the simulation of hinge lacks",
        "data:image/png",
    ] {
        assert!(page.contains(part), "{part}");
    }

    let identify = [
        "identify", "a.csv", "b.csv", "c.csv", "--map", "map.toml", "--robot", pendulum,
    ];
    let identify = [&identify[..], &["--heldout", "d.csv", "--out", "found"]].concat();
    let found = succeeds(folder, &identify);
    for part in [
        "command_delay",
        "sensor_delay",
        "in the robot that was written",
        "would tell",
        "noise floor",
    ] {
        assert!(found.out.contains(part), "{part:?} is not in\n{}", found.out);
    }
    let report: Value = serde_json::from_slice(&fs::read(folder.join("found/report.json")).unwrap()).unwrap();
    assert_eq!(report["verdict"], "indistinguishable");
    let late = report["alternatives"][0][0]["parameters"]["time"]["value"]
        .as_f64()
        .unwrap();
    assert!((late - LATE).abs() < 1e-3, "{late}");
    let error = |model: &str| report[model]["heldout"]["rmse"]["overall"].as_f64().unwrap();
    assert!(error("final") < 0.1 * error("refit"), "{report}");
    let page = fs::read_to_string(folder.join("found/report.html")).unwrap();
    for part in [
        "These logs cannot tell apart",
        "re-tuned values",
        "measured and simulated hinge, d",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(succeeds(folder, &["inspect", "found/robot"]).out.contains("delay"));

    let told = succeeds(folder, &["inspect", "found"]).out;
    assert!(
        told.contains("identification of pendulum: indistinguishable") && told.contains("sensor_delay"),
        "{told}"
    );
    assert!(
        succeeds(folder, &["inspect", "found/report.html"])
            .out
            .contains("pictures")
    );

    // An hour's result is not written over.
    let before = contents(folder);
    let again = omniwalk(folder, &identify);
    assert!(again.code == 2 && again.message().contains("result of an identification"));
    assert!(contents(folder) == before);
}

#[test]
fn a_held_out_log_that_is_none_is_refused_before_anything_is_searched() {
    let pendulum = robot("pendulum");
    let identify = [
        "identify",
        "a.csv",
        "--map",
        "map.toml",
        "--robot",
        pendulum.to_str().unwrap(),
        "--out",
        "found",
    ];
    for (log, part) in [("nowhere.csv", "nowhere.csv"), ("./a.csv", "given twice")] {
        refuses_in(prepare, &[&identify[..], &["--heldout", log]].concat(), &[part]);
    }
}

#[test]
fn a_robot_that_is_there_already_is_not_written_over() {
    let prepare = |folder: &Path| {
        prepare(folder);
        for robot in ["own/robot", "found/robot"] {
            fs::create_dir_all(folder.join(robot)).unwrap();
            for file in ["pendulum.urdf", "robot.toml"] {
                let from = crate::support::robot("pendulum").join(file);
                fs::copy(from, folder.join(robot).join(file)).unwrap();
            }
        }
    };
    let identify = [
        "identify",
        "a.csv",
        "b.csv",
        "--map",
        "map.toml",
        "--robot",
        "own/robot",
        "--out",
    ];
    for (out, part) in [
        ("own", "would be written over the robot that is read"),
        ("found", "found/robot is there already"),
    ] {
        refuses_in(prepare, &[&identify[..], &[out]].concat(), &[part]);
    }
}

#[test]
fn motions_to_record_say_what_they_show_and_what_they_do_not() {
    let folder = tempfile::tempdir().unwrap();
    let pendulum = robot("pendulum");
    let told = succeeds(
        folder.path(),
        &["excite", "--robot", pendulum.to_str().unwrap(), "--out", "motions"],
    );
    let line =
        "not told: command_delay from sensor_delay; the same with the motors off for its last third does (hinge)";
    assert!(told.out.contains(line), "{}", told.out);
    let again = omniwalk(
        folder.path(),
        &["excite", "--robot", pendulum.to_str().unwrap(), "--out", "motions"],
    );
    assert!(again.code == 2 && again.message().contains("holds motions already"));
    let motions: Value =
        serde_json::from_slice(&fs::read(folder.path().join("motions/motions.json")).unwrap()).unwrap();
    let shows = |motion: &str, effect: &str| {
        let all = motions["motions"].as_array().unwrap();
        let own = all.iter().find(|own| own["name"] == motion).unwrap();
        own["joints"][0]["shows"][effect].as_f64().unwrap()
    };
    assert!(shows("multisine-hinge", "command_delay") > 3.0 * shows("triangle-hinge", "command_delay"));
    assert!(shows("staircase-hinge", "stribeck_friction") > 1e-3);
}

#[test]
fn results_of_a_replay_replace_nothing_that_was_read() {
    let pendulum = robot("pendulum");
    let toml = pendulum.join("robot.toml").display().to_string();
    let replay = [
        "replay",
        "a.csv",
        "--map",
        "map.toml",
        "--robot",
        pendulum.to_str().unwrap(),
    ];
    for (results, part) in [
        (&["--json", "./a.csv"][..], "a.csv would be written over"),
        (&["--html", "map.toml"], "map.toml would be written over"),
        (&["--html", &toml], "robot.toml would be written over"),
        (&["--html", "."], ". is no file"),
        (&["--json", "none/r.json"], "cannot write none/r.json"),
        (&["--html", "both", "--json", "./both"], "is given for two results"),
    ] {
        refuses_in(prepare, &[&replay[..], results].concat(), &[part]);
    }
}

#[test]
fn logs_that_are_not_what_they_should_be_are_refused_by_replay_and_leave_room_for_the_next_try() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let degrees = MAP.replace("column = \"q\"", "column = \"q\", scale = 57.3");
    fs::write(folder.join("degrees.toml"), degrees).unwrap();
    let pendulum = robot("pendulum");
    let logs = |command: &'static str, map: &'static str| {
        [
            command,
            "a.csv",
            "b.csv",
            "--map",
            map,
            "--robot",
            pendulum.to_str().unwrap(),
        ]
    };
    let replayed = omniwalk(folder, &logs("replay", "degrees.toml"));
    let message = replayed.message();
    assert!(
        replayed.code == 2 && message.contains("degrees, not radians"),
        "{message}"
    );
    let into = ["--heldout", "copy.csv", "--out", "found"];
    fs::copy(folder.join("a.csv"), folder.join("copy.csv")).unwrap();
    let identified = omniwalk(folder, &[&logs("identify", "degrees.toml")[..], &into].concat());
    assert!(identified.code == 2 && folder.join("found/report.json").exists());
    assert_eq!(
        identified.message().matches("degrees, not radians").count(),
        2,
        "one for each kind"
    );
    // The same folder, with the right map; and a copy of what was fitted is not held out.
    let identified = omniwalk(folder, &[&logs("identify", "map.toml")[..], &into].concat());
    let message = identified.message();
    assert!(
        identified.code == 2 && message.contains("no held-out log can be compared"),
        "{message}"
    );
    assert!(
        message.contains("copy: its readings are those of a, which was fitted"),
        "{message}"
    );
    assert!(folder.join("found/robot/robot.toml").exists());
}
