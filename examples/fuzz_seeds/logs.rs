//! Small logs: every topic, in CDR and JSON, compressed and not.

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use omniwalk_sim2real::log::messages::{Header, Imu, JointState, Odometry, Quaternion, Twist};
use omniwalk_sim2real::log::{LogWriter, Message};

/// Names and bytes of the files.
pub fn files() -> Vec<(String, Vec<u8>)> {
    let mut files = vec![("cdr.mcap".to_owned(), ours())];
    for (name, compression) in [
        ("zstd", Some(Compression::Zstd)),
        ("lz4", Some(Compression::Lz4)),
        ("json", None),
    ] {
        files.push((format!("{name}.mcap"), theirs(compression)));
    }
    files
}

fn joints(time: u64, position: f64) -> JointState {
    JointState {
        header: Header::new(time, ""),
        name: vec!["left_hip".into(), "right_hip".into()],
        position: vec![position, -position],
        velocity: vec![],
        effort: vec![0.1, 0.2],
    }
}

fn messages(step: u32) -> Vec<Message> {
    let time = 1_000_000_000 + u64::from(step) * 10_000_000;
    let position = 0.1 * f64::from(step);
    let orientation = Quaternion {
        w: 1.0,
        ..Quaternion::default()
    };
    vec![
        Message::JointStates(joints(time, position)),
        Message::JointCommands(joints(time, position + 0.1)),
        Message::Enabled(JointState {
            position: vec![1.0],
            ..JointState::default()
        }),
        Message::Imu(Imu {
            header: Header::new(time, "base"),
            orientation,
            ..Imu::default()
        }),
        Message::Odom(Box::new(Odometry {
            header: Header::new(time, "odom"),
            ..Odometry::default()
        })),
        Message::CmdVel(Twist::default()),
    ]
}

/// As this project writes it.
fn ours() -> Vec<u8> {
    let path = std::env::temp_dir().join(format!("omniwalk-seed-{}.mcap", std::process::id()));
    let mut log = LogWriter::create(&path).expect("a writable folder");
    let about = |key: &str, value: &str| BTreeMap::from([(key.to_owned(), value.to_owned())]);
    log.metadata("groups", about("trajectory", "chirp")).expect("room");
    log.metadata("robot_overrides", about("payload.mass", "0.5"))
        .expect("room");
    for step in 0..3 {
        for message in messages(step) {
            log.write(2_000_000_000 + u64::from(step) * 10_000_000, &message)
                .expect("room");
        }
    }
    log.finish().expect("room");
    let bytes = fs::read(&path).expect("what was written");
    fs::remove_file(path).expect("what was written");
    bytes
}

/// As others write it: compressed CDR, or JSON.
fn theirs(compression: Option<Compression>) -> Vec<u8> {
    let mut writer = WriteOptions::new()
        .compression(compression)
        .create(Cursor::new(Vec::new()))
        .expect("memory");
    let mut channels = BTreeMap::new();
    for step in 0..3 {
        for message in messages(step) {
            let schema = message.schema();
            let json = match &message {
                Message::JointStates(joints) if compression.is_none() => serde_json::to_vec(joints).ok(),
                Message::CmdVel(twist) if compression.is_none() => serde_json::to_vec(twist).ok(),
                _ => None,
            };
            let encoding = if json.is_some() {
                "json"
            } else {
                schema.message_encoding
            };
            let id = *channels.entry(message.topic()).or_insert_with(|| {
                let id = writer.add_schema(&schema.name, schema.encoding, b"").expect("memory");
                let channel = writer.add_channel(id, message.topic(), encoding, &BTreeMap::new());
                channel.expect("memory")
            });
            let header = MessageHeader {
                channel_id: id,
                sequence: step,
                log_time: 2_000_000_000 + u64::from(step) * 10_000_000,
                publish_time: 0,
            };
            let bytes = json.unwrap_or_else(|| message.bytes().expect("numbers"));
            writer.write_to_known_channel(&header, &bytes).expect("memory");
        }
    }
    writer.finish().expect("memory");
    writer.into_inner().into_inner()
}
