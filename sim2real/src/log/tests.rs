//! Logs come back as they were written, are CDR by the letter, and nothing in a file makes the reader panic.

use std::fs;

use proptest::prelude::*;

use super::messages::*;
use super::*;

fn joints(time: u64) -> JointState {
    JointState {
        header: Header::new(time, "base"),
        name: vec!["left_knee".into(), "right_knee_pitch".into(), "neck".into()],
        position: vec![0.1, -0.2, 1e-300],
        velocity: vec![f64::MAX, -0.0, 3.0],
        effort: vec![],
    }
}

fn messages(time: u64) -> Vec<Message> {
    let imu = Imu {
        header: Header::new(time, "imu"),
        orientation: Quaternion {
            x: 0.1,
            y: 0.2,
            z: 0.3,
            w: 0.9,
        },
        linear_acceleration: Vector3 {
            x: 0.0,
            y: 0.5,
            z: 9.81,
        },
        ..Imu::default()
    };
    let mut odom = Odometry {
        header: Header::new(time, "world"),
        child_frame_id: "base".into(),
        ..Default::default()
    };
    odom.pose.pose.position = Point { x: 1.0, y: 2.0, z: 0.9 };
    odom.twist.covariance.0[35] = 0.25;
    let reward = [("velocity".to_owned(), 0.75.into())].into_iter().collect();
    vec![
        Message::JointStates(joints(time)),
        Message::JointCommands(joints(time)),
        Message::Imu(imu),
        Message::CmdVel(Twist {
            linear: Vector3 { x: 0.4, y: 0.0, z: 0.0 },
            ..Default::default()
        }),
        Message::Odom(Box::new(odom)),
        Message::Battery(Box::new(BatteryState {
            header: Header::new(time, "base"),
            voltage: 14.8,
            present: true,
            cell_voltage: vec![3.7; 4],
            serial_number: "7".into(),
            ..BatteryState::default()
        })),
        Message::Enabled(joints(time)),
        Message::Policy(PolicyStep {
            observation: vec![0.1 + 0.2, -1.0],
            action: vec![0.5],
            reward,
        }),
    ]
}

fn write(path: &std::path::Path, entries: &[(u64, Message)]) {
    let mut log = LogWriter::create(path).unwrap();
    for (time, message) in entries {
        log.write(*time, message).unwrap();
    }
    log.metadata("omniwalk", [("seed".to_owned(), "7".to_owned())].into())
        .unwrap();
    log.finish().unwrap();
}

#[test]
fn a_log_comes_back_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let entries: Vec<_> = (0..50)
        .flat_map(|step| {
            messages(step * 25_000_000)
                .into_iter()
                .map(move |m| (step * 25_000_000, m))
        })
        .collect();
    write(&path, &entries);
    let mut log = LogReader::open(&path).unwrap();
    let read: Vec<_> = log
        .by_ref()
        .map(|entry| entry.map(|e| (e.time, e.message.unwrap())).unwrap())
        .collect();
    assert_eq!(read, entries);
    assert_eq!(log.metadata()["omniwalk"]["seed"], "7");
}

#[test]
fn the_bytes_are_cdr_by_the_letter() {
    let message = JointState {
        name: vec!["ab".into()],
        position: vec![1.0],
        ..joints(1_000_000_002)
    };
    let mut expected = vec![0, 1, 0, 0]; // plain CDR, little-endian
    expected.extend([1, 0, 0, 0, 2, 0, 0, 0]); // stamp: 1 s, 2 ns
    expected.extend([5, 0, 0, 0, b'b', b'a', b's', b'e', 0]); // frame_id, 17 bytes so far
    expected.extend([0, 0, 0]); // to a multiple of 4
    expected.extend([1, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0]); // one name, 31 bytes so far
    expected.extend([0, 1, 0, 0, 0]); // padding, then one position, 36 bytes so far
    expected.extend([0; 4]); // to a multiple of 8
    expected.extend(1.0_f64.to_le_bytes());
    expected.extend([3, 0, 0, 0]); // three velocities, 52 bytes so far
    expected.extend([0; 4]); // to a multiple of 8
    message
        .velocity
        .iter()
        .for_each(|velocity| expected.extend(velocity.to_le_bytes()));
    expected.extend([0, 0, 0, 0]); // no effort
    assert_eq!(cdr::encode(&message), expected);
    assert_eq!(cdr::decode::<JointState>(&expected).unwrap(), message);
}

#[test]
fn schemas_hold_every_message_they_need_once() {
    let schema = cdr::schema::<JointState>();
    let own = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n";
    assert!(schema.starts_with(own), "{schema}");
    assert_eq!(
        schema
            .matches("MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n")
            .count(),
        1
    );
    let odometry = cdr::schema::<Odometry>();
    assert!(odometry.contains("float64[36] covariance"));
    assert_eq!(odometry.matches("MSG: geometry_msgs/Twist\n").count(), 1);
}

/// A log with one message of one channel, as another program might have written it.
fn foreign(path: &std::path::Path, topic: &str, schema: &str, encoding: &str, data: &[u8]) {
    let mut writer = mcap::Writer::new(std::io::BufWriter::new(fs::File::create(path).unwrap())).unwrap();
    let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
    let channel_id = writer
        .add_channel(schema, topic, encoding, &Default::default())
        .unwrap();
    let header = mcap::records::MessageHeader {
        channel_id,
        sequence: 0,
        log_time: 5,
        publish_time: 5,
    };
    writer.write_to_known_channel(&header, data).unwrap();
    writer.finish().unwrap();
}

#[test]
fn json_messages_and_unknown_topics_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let first = || LogReader::open(&path).unwrap().next().unwrap().unwrap();
    let json = br#"{"header": {"stamp": {"sec": 2, "nanosec": 5}}, "name": ["a"], "position": [0.5]}"#;
    foreign(&path, "/joint_states", "sensor_msgs/msg/JointState", "json", json);
    let Some(Message::JointStates(joints)) = first().message else {
        panic!("no joint states")
    };
    assert_eq!(
        (joints.header.stamp.nanoseconds(), joints.position),
        (2_000_000_005, vec![0.5])
    );
    foreign(&path, "/camera", "sensor_msgs/msg/Image", "cdr", b"anything");
    assert_eq!(first().message, None);
}

#[test]
fn messages_that_do_not_fit_their_topic_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (state, imu) = ("sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu");
    let two_positions = cdr::encode(&JointState {
        position: vec![1.0; 2],
        ..joints(0)
    });
    let long = [&[0, 1, 0, 0][..], &[0; 8], &u32::MAX.to_le_bytes()].concat();
    for (schema, encoding, data, says) in [
        (imu, "cdr", &two_positions[..], "it is sensor_msgs/msg/Imu"),
        (state, "ros1", &two_positions, "its encoding is `ros1`"),
        (state, "cdr", &two_positions, "3 names and 2 positions"),
        (state, "cdr", &two_positions[..40], "the message ends at byte 36"),
        (state, "cdr", &long, "the message ends at byte 12"),
        (state, "cdr", &[0, 0, 0, 0, 1], "little-endian"),
        (state, "json", b"{\"name\": 5}", "invalid type"),
    ] {
        foreign(&path, "/joint_states", schema, encoding, data);
        let message = LogReader::open(&path).unwrap().next().unwrap().unwrap_err().to_string();
        assert!(
            message.contains("message 0 of /joint_states") && message.contains(says),
            "{message}"
        );
    }
}

#[test]
fn a_small_file_that_unpacks_to_very_much_and_a_message_of_megabytes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let all = || {
        LogReader::open(&path)
            .unwrap()
            .collect::<Result<Vec<_>, _>>()
            .unwrap_err()
            .to_string()
    };
    foreign(&path, "/camera", "sensor_msgs/msg/Image", "cdr", &vec![0; 60 << 20]);
    assert!(fs::metadata(&path).unwrap().len() < 100_000);
    assert!(all().contains("unpacks to 200 times its size"), "{}", all());
    foreign(
        &path,
        "/joint_states",
        "sensor_msgs/msg/JointState",
        "cdr",
        &vec![0; 2 << 20],
    );
    assert!(all().contains("more than a robot has to say"), "{}", all());
    let names = cdr::encode(&JointState {
        name: vec![String::new(); 5000],
        ..JointState::default()
    });
    foreign(&path, "/joint_states", "sensor_msgs/msg/JointState", "cdr", &names);
    assert!(all().contains("more than a robot has joints"), "{}", all());
}

proptest! {
    #[test]
    fn damaged_logs_end_in_an_error_or_as_they_were(position: prop::sample::Index, bit in 0_u8..8, cut: bool) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let entries: Vec<_> = messages(7).into_iter().map(|message| (7, message)).collect();
        write(&path, &entries);
        let mut bytes = fs::read(&path).unwrap();
        let at = position.index(bytes.len());
        if cut { bytes.truncate(at) } else { bytes[at] ^= 1 << bit }
        fs::write(&path, &bytes).unwrap();
        let read: Result<Vec<_>, _> = LogReader::open(&path).unwrap().collect();
        prop_assert!(!cut || read.is_err());
        if let Ok(read) = read {
            // A flip in the summary, in the header or in a spare field does no harm.
            prop_assert_eq!(read.len(), entries.len());
        }
    }

    #[test]
    fn any_bytes_are_decoded_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let bytes = [&[0, 1, 0, 0][..], &bytes].concat();
        let _ = cdr::decode::<JointState>(&bytes);
        let _ = cdr::decode::<Odometry>(&bytes);
    }
}
