//! Recordings of MCAP files hold what the messages say, on one clock.

use std::path::{Path, PathBuf};

use super::*;
use crate::log::messages::{BatteryState, Header, Imu, JointState, Twist};
use crate::log::{LogWriter, Message};

const MS: u64 = 1_000_000;

fn joints(stamp: u64, position: &[f64]) -> JointState {
    JointState {
        header: Header::new(stamp, ""),
        name: ["knee", "hip"][..position.len()]
            .iter()
            .map(ToString::to_string)
            .collect(),
        position: position.to_vec(),
        ..JointState::default()
    }
}

/// Writes messages (log time in ns) and reads the recording.
fn record(folder: &Path, messages: &[(u64, Message)]) -> Result<Recording, RecordingError> {
    let path: PathBuf = folder.join("walk.mcap");
    let mut log = LogWriter::create(&path).unwrap();
    for (time, message) in messages {
        log.write(*time, message).unwrap();
    }
    log.metadata(
        "robot_overrides",
        [("joint.knee.kp".to_owned(), "2.5".to_owned())].into(),
    )
    .unwrap();
    log.metadata("groups", [("gain".to_owned(), "low".to_owned())].into())
        .unwrap();
    log.finish().unwrap();
    read(&path, None).map(|mut recordings| recordings.remove(0))
}

#[test]
fn every_quantity_keeps_its_own_clock() {
    let folder = tempfile::tempdir().unwrap();
    let mut messages = Vec::new();
    for i in 1..=50 {
        let time = i * 10 * MS;
        messages.push((time, Message::JointStates(joints(time, &[i as f64 * 0.01, 0.5]))));
        if i % 2 == 1 {
            messages.push((time + MS, Message::JointCommands(joints(time + MS, &[1.0]))));
        }
    }
    messages.push((200 * MS, Message::CmdVel(Twist::default())));
    let battery = BatteryState {
        header: Header::new(300 * MS, ""),
        voltage: 12.5,
        ..BatteryState::default()
    };
    messages.push((300 * MS, Message::Battery(Box::new(battery))));
    // Above nothing is on.
    for (time, on) in [(350 * MS, 0.4), (400 * MS, 0.0)] {
        let enabled = JointState {
            header: Header::new(time, ""),
            position: vec![on],
            ..JointState::default()
        };
        messages.push((time, Message::Enabled(enabled)));
    }
    let recording = record(folder.path(), &messages).unwrap();
    assert_eq!(
        (recording.name.as_str(), recording.groups["gain"].as_str()),
        ("walk", "low")
    );
    assert_eq!(recording.overrides["joint.knee.kp"], 2.5);
    let knee = recording.joint("knee").unwrap();
    assert_eq!((knee.position.len(), knee.command.len()), (50, 25));
    assert!((knee.position.time[49] - 0.49).abs() < 1e-12 && (knee.command.time[0] - 0.001).abs() < 1e-12);
    assert_eq!(knee.velocity, Series::default());
    assert_eq!(
        (knee.enabled.value.clone(), knee.enabled.time[1]),
        (vec![1.0, 0.0], 0.39)
    );
    assert_eq!(recording.joint("hip").unwrap().position.len(), 50);
    assert_eq!(recording.voltage.held_at(1.0), Some(&12.5));
    assert_eq!(recording.voltage.held_at(0.28), None);
    assert_eq!(recording.velocity_command.time, [0.19]);
    assert!((recording.duration() - 0.49).abs() < 1e-12);
}

#[test]
fn stamps_of_a_robot_with_its_own_clock_are_aligned_by_log_time() {
    let folder = tempfile::tempdir().unwrap();
    let uptime = 3_600_000 * MS;
    let mut messages = Vec::new();
    for i in 0..20_u64 {
        let time = 1_000_000 * MS + i * 10 * MS;
        messages.push((time, Message::JointStates(joints(uptime + i * 10 * MS, &[i as f64]))));
        let imu = Imu {
            header: Header::new(time - 2 * MS, ""),
            ..Imu::default()
        };
        messages.push((time, Message::Imu(imu)));
    }
    let recording = record(folder.path(), &messages).unwrap();
    let imu = recording.imu.unwrap();
    assert_eq!(imu.orientation.len(), 0, "a quaternion of zeros is no orientation");
    assert!((imu.angular_velocity.time[5] - recording.joints[0].position.time[5]).abs() < 1e-9);
    assert!(recording.notes[0].contains("/imu") && recording.notes[0].contains("another clock"));
}

#[test]
fn a_map_labels_an_mcap_file_and_columns_that_it_has_none_of_are_remarked() {
    let folder = tempfile::tempdir().unwrap();
    let at = |time: u64| (time, Message::JointStates(joints(time, &[0.1])));
    record(folder.path(), &[at(30 * MS), at(40 * MS)]).unwrap();
    let labels = "[groups]\nload = { field = \"groups.gain\" }\n[overrides]\nkp = 0.5\n";
    let columns = "[[joint]]\nnames = [\"hinge\"]\nposition = { column = \"knee\" }\n";
    for (text, remarks) in [(labels.to_owned(), 0), (labels.to_owned() + columns, 1)] {
        let map = Map::parse(&omniwalk_env::robot::Source {
            file: "map.toml".into(),
            text,
        })
        .unwrap();
        let own = read(&folder.path().join("walk.mcap"), Some(&map)).unwrap().remove(0);
        assert_eq!((own.groups["load"].as_str(), own.overrides["kp"]), ("low", 0.5));
        let remarked = own.notes.iter().filter(|note| note.contains("the map's columns"));
        assert_eq!(remarked.count(), remarks, "{:?}", own.notes);
        assert!(own.joint("knee").is_some());
    }
}

#[test]
fn time_that_goes_backwards_and_overrides_that_cannot_be_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |time: u64| (time, Message::JointStates(joints(time, &[0.1])));
    let error = record(folder.path(), &[at(30 * MS), at(40 * MS), at(20 * MS)]).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("message 2 of /joint_states") && text.contains("time goes backwards"),
        "{text}"
    );

    let path = folder.path().join("a.mcap");
    for (key, text, why) in [
        ("kp", "high", "`high` is no number"),
        ("kp", "inf", "`inf` is no number"),
        ("joint.knee.kp", "-2.5", "override `joint.knee.kp` cannot be -2.5"),
        ("supply_voltage", "0", "override `supply_voltage` cannot be 0"),
    ] {
        let mut log = LogWriter::create(&path).unwrap();
        log.metadata("robot_overrides", [(key.to_owned(), text.to_owned())].into())
            .unwrap();
        log.finish().unwrap();
        let said = read(&path, None).unwrap_err().to_string();
        let place = format!("robot_overrides, key `{key}`");
        assert!(said.contains(&place) && said.contains(why), "{said}");
    }
}
