//! The measured logs that `OMNIWALK_SHARED` points to are read through the maps in the documentation.

use std::path::{Path, PathBuf};

use omniwalk_env::robot::load;
use omniwalk_sim2real::check::Check;
use omniwalk_sim2real::identify::{Outcome, Task, Verdict, replay, run};
use omniwalk_sim2real::recording::{Map, Recording, read};

/// What is in a folder of the measured logs; `None` without it, and says so.
fn folder(set: &str) -> Option<PathBuf> {
    let Some(shared) = std::env::var_os("OMNIWALK_SHARED") else {
        eprintln!("skipped: OMNIWALK_SHARED is not set");
        return None;
    };
    let folder = PathBuf::from(shared).join("data").join(set);
    if !folder.is_dir() {
        eprintln!("skipped: OMNIWALK_SHARED has no {}", folder.display());
        return None;
    }
    Some(folder)
}

/// The recordings of a set of logs; `None` without the logs.
fn recordings(set: &str, map: &str) -> Option<Vec<Recording>> {
    let folder = std::fs::read_dir(folder(set)?).unwrap();
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/maps");
    let map = Map::load(&docs.join(map)).unwrap();
    let mut files: Vec<PathBuf> = folder.map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| {
        file.extension()
            .is_some_and(|ending| ending == "json" || ending == "csv")
    });
    files.sort();
    Some(files.iter().flat_map(|file| read(file, Some(&map)).unwrap()).collect())
}

#[test]
fn servo_logs_say_when_the_motor_was_off_and_which_gain_it_had() {
    let Some(logs) = recordings("bam_xl330", "bam_xl330.toml") else {
        return;
    };
    assert_eq!(logs.len(), 16);
    for log in &logs {
        let joint = log.joint("hinge").unwrap();
        assert!(joint.position.len() > 800 && log.duration() > 5.9, "{}", log.name);
        let dropped = joint.enabled.held_at(5.0) == Some(&0.0);
        assert_eq!(dropped, log.groups["trajectory"] == "lift_and_drop", "{}", log.name);
        assert!(joint.extra["load"].value.iter().all(|load| load.abs() < 1000.0));
        assert!((0.4..4.0).contains(&log.overrides["kp"]));
    }
    let repeated: usize = logs.iter().map(|log| log.joints[0].repeated).sum();
    let rows: usize = logs.iter().map(|log| log.joints[0].command.len()).sum();
    // Equal positions beside a changing speed are slow motion on a coarse encoder, and half the rows of a hold are equal.
    assert!(
        repeated < rows / 1000,
        "{repeated} of {rows} readings repeat the one before"
    );
    let Some(logs) = recordings("bam_sts3250", "bam_sts3250.toml") else {
        return;
    };
    assert!(logs.len() == 4 && logs.iter().all(|log| log.joints[0].velocity.len() > 200));
}

#[test]
fn the_linear_axis_has_metres_and_newtons() {
    let Some(logs) = recordings("emps", "emps.toml") else {
        return;
    };
    let axis = &logs[0].joints[0];
    assert_eq!((logs.len(), axis.position.len()), (1, 24841));
    let largest = |values: &[f64]| values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    assert!(largest(&axis.position.value) < 0.3 && (50.0..500.0).contains(&largest(&axis.effort.value)));
}

#[test]
fn the_humanoid_has_a_recording_per_segment_in_radians() {
    let Some(logs) = recordings("poppy", "poppy.toml") else {
        return;
    };
    assert_eq!(logs.len(), 61);
    assert!(logs.iter().all(|log| log.joints.len() == 25 && log.duration() < 3.0));
    let knees = logs
        .iter()
        .flat_map(|log| &log.joint("l_knee_y").unwrap().position.value);
    assert!((0.5..1.6).contains(&knees.fold(0.0_f64, |largest, value| largest.max(*value))));
}

#[test]
fn the_check_finds_the_measured_logs_usable() {
    let [servo, other, humanoid] = [
        ("bam_xl330", "bam_xl330.toml"),
        ("bam_sts3250", "bam_sts3250.toml"),
        ("poppy", "poppy.toml"),
    ]
    .map(|(set, map)| recordings(set, map));
    let pendulum = load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/pendulum")).unwrap();
    if let (Some(mut logs), Some(others)) = (servo, other) {
        logs.extend(others);
        let check = Check::new(&logs, &pendulum);
        assert!(check.usable(), "{check}");
    }
    if let (Some(logs), Some(folder)) = (humanoid, folder("poppy")) {
        let poppy = load(&folder.join("poppy_humanoid.urdf")).unwrap();
        let check = Check::new(&logs, &poppy);
        assert!(check.usable(), "{check}");
    }
}

/// A folder of the repository's robots.
fn robot_folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(name)
}

#[test]
fn nominal_models_follow_the_measured_logs_as_far_as_the_documentation_says() {
    // Errors of nominal models on the logs that docs/measured/real-data says were fitted or held out lie between these, rad or m.
    for (set, map, robot, least, most) in [
        ("bam_xl330", "bam_xl330.toml", "xl330_rig", 0.1, 0.4),
        ("bam_sts3250", "bam_sts3250.toml", "sts3250_rig", 0.02, 0.2),
        ("emps", "emps.toml", "emps", 2e-5, 1e-4),
    ] {
        let Some(logs) = recordings(set, map) else {
            return;
        };
        let robot = load(&robot_folder(robot)).unwrap();
        let error = replay(&robot, &logs).unwrap().measure.overall();
        assert!((least..most).contains(&error), "{set}: {error}");
    }
}

/// What comes of the logs of a robot of the repository's; the robot that is written can be read.
fn identified(robot: &str, logs: Vec<Recording>, heldout: Option<Vec<Recording>>) -> Outcome {
    let folder = robot_folder(robot);
    let robot = load(&folder).unwrap();
    let out = tempfile::tempdir().unwrap();
    let open = || Ok(heldout.clone().unwrap_or_default());
    let task = Task {
        robot: &robot,
        files: omniwalk_env::robot::files(&folder).unwrap(),
        logs,
        heldout: heldout.is_some().then_some(&open),
        compare: false,
        out: out.path(),
    };
    let outcome = run(&task, &|_| {}).unwrap();
    assert!(load(&out.path().join("robot")).is_ok());
    outcome
}

#[test]
fn friction_that_the_axis_shows_is_missing_in_its_model() {
    let Some(logs) = recordings("emps", "emps.toml") else {
        return;
    };
    let outcome = identified("emps", logs, None);
    // Beside a constant force friction of both directions and that of one are the same.
    assert_eq!(outcome.verdict, Verdict::Indistinguishable);
    assert_eq!(
        outcome.indistinguishable,
        [["coulomb_friction", "directional_friction"]]
    );
    assert!(outcome.retuned["carriage"].contains_key("external_force.torque"));
    assert!(outcome.last.heldout.overall() < 0.6 * outcome.refit.heldout.overall());
}

#[test]
fn friction_under_load_is_named_of_a_measured_servo_and_helps_at_a_gain_that_was_not_fitted() {
    let Some(mut logs) = recordings("bam_xl330", "bam_xl330.toml") else {
        return;
    };
    let of = |log: &Recording, label: &str, values: &[&str]| values.contains(&log.groups[label].as_str());
    logs.retain(|log| of(log, "trajectory", &["sin_sin", "up_and_down"]) && of(log, "gain", &["200", "400", "800"]));
    let (heldout, logs): (Vec<Recording>, Vec<Recording>) = logs.into_iter().partition(|log| of(log, "gain", &["400"]));
    assert_eq!((heldout.len(), logs.len()), (2, 4));
    let outcome = identified("xl330_rig", logs, Some(heldout));
    let names: Vec<&str> = outcome.accepted.iter().map(|own| own.effect).collect();
    assert_eq!(
        (names, outcome.verdict),
        (vec!["load_dependent_friction"], Verdict::Unexplained)
    );
    let [nominal, refit, last] = [&outcome.nominal, &outcome.refit, &outcome.last].map(|sets| sets.heldout.overall());
    assert!(refit < 0.5 * nominal && last < 0.95 * refit, "{nominal} {refit} {last}");
}

#[test]
fn a_measured_servo_is_identified_and_what_is_left_is_said() {
    let Some(logs) = recordings("bam_sts3250", "bam_sts3250.toml") else {
        return;
    };
    let (heldout, logs): (Vec<Recording>, Vec<Recording>) = logs
        .into_iter()
        .partition(|log| log.groups["trajectory"] == "sin_time_square");
    let outcome = identified("sts3250_rig", logs, Some(heldout));
    assert_eq!(outcome.verdict, Verdict::Unexplained);
    let [nominal, refit, last] = [&outcome.nominal, &outcome.refit, &outcome.last].map(|sets| sets.fit.overall());
    // What the logs do not tell is as in the nominal model, where that is worse by less than a thousandth.
    assert!(
        refit < 0.2 * nominal && last < 1.001 * refit,
        "{nominal} {refit} {last}"
    );
    assert!(outcome.lacking[0].names.contains(&"temperature".to_owned()));
}
