//! Reads MCAP from start to end, a record at a time: memory does not grow with the file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, parse_record};

use super::cdr::{self, Field};
use super::messages::{Bool, JointState};
use super::{LogError, Message, lengths};

/// Largest record (a chunk of messages is one) that is read, bytes.
const MAX_RECORD_BYTES: usize = 64 << 20;

/// Largest message of a topic that is read, bytes: a robot of 4000 joints stays below.
const MAX_MESSAGE_BYTES: usize = 1 << 20;
/// Most joints of a message.
const MAX_JOINTS: usize = 4096;
/// What compressed chunks may unpack to whatever the file's size, bytes, and how many times that size beyond. Logs of a robot that
/// stands still come to about fifty times.
const ALWAYS_UNPACKED: u64 = 32 << 20;
const MOST_UNPACKED: u64 = 200;

/// Why a log without its end is not read: whoever wants what it holds shall know that it is not all.
const CUT_OFF: &str = "it ends early, as when its writer was killed; `mcap recover` makes a whole log of what is there";

/// A message and where it was.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The topic.
    pub topic: String,
    /// Name of the schema, such as `sensor_msgs/msg/Imu`; empty if there is none.
    pub schema: String,
    /// When it was logged, ns.
    pub time: u64,
    /// The message; `None` on a topic that has no meaning here.
    pub message: Option<Message>,
}

/// Reads a log message by message; ends at the first error.
pub struct LogReader {
    file: File,
    path: PathBuf,
    reader: LinearReader,
    tables: Tables,
    /// Bytes of the file so far, and of the records in them.
    packed: u64,
    unpacked: u64,
    failed: bool,
}

/// What the records so far say of those that follow.
#[derive(Default)]
struct Tables {
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Messages so far.
    messages: u64,
    /// What follows is the summary, which repeats schemas and channels.
    at_summary: bool,
}

struct Channel {
    topic: String,
    schema: String,
    encoding: String,
}

/// A JSON object.
type Object = serde_json::Map<String, serde_json::Value>;

/// An error before it knows its file.
enum Fault {
    Damaged(String),
    Message { topic: String, index: u64, why: String },
}

impl LogReader {
    /// Opens the log at `path`.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let file = File::open(path).map_err(|source| LogError::Io {
            path: path.to_owned(),
            source,
        })?;
        let options = LinearReaderOptions::default()
            .with_record_length_limit(MAX_RECORD_BYTES)
            .with_validate_chunk_crcs(true)
            .with_validate_data_section_crc(true);
        let reader = LinearReader::new_with_options(options);
        Ok(Self {
            file,
            path: path.to_owned(),
            reader,
            tables: Tables::default(),
            packed: 0,
            unpacked: 0,
            failed: false,
        })
    }

    /// The metadata records met so far, by name.
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.tables.metadata
    }

    fn advance(&mut self) -> Result<Option<Entry>, LogError> {
        while let Some(event) = self.reader.next_event() {
            let taken = match event {
                Ok(LinearReadEvent::ReadRequest(need)) => {
                    let read = self.file.read(self.reader.insert(need));
                    let read = read.map_err(|source| LogError::Io {
                        path: self.path.clone(),
                        source,
                    })?;
                    self.reader.notify_read(read);
                    self.packed += read as u64;
                    continue;
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    self.unpacked += data.len() as u64;
                    let bomb = self.unpacked > ALWAYS_UNPACKED && self.unpacked / MOST_UNPACKED > self.packed;
                    match bomb {
                        true => Err(Fault::Damaged(format!("it unpacks to {MOST_UNPACKED} times its size"))),
                        false => self.tables.take(opcode, data),
                    }
                }
                Err(McapError::UnexpectedEof) => Err(Fault::Damaged(CUT_OFF.to_owned())),
                Err(error) => Err(Fault::Damaged(error.to_string())),
            };
            let path = || self.path.clone();
            match taken {
                Ok(None) => {}
                Ok(entry) => return Ok(entry),
                Err(Fault::Damaged(why)) => return Err(LogError::Damaged { path: path(), why }),
                Err(Fault::Message { topic, index, why }) => {
                    return Err(LogError::Message {
                        path: path(),
                        topic,
                        index,
                        why,
                    });
                }
            }
        }
        Ok(None)
    }
}

impl Iterator for LogReader {
    type Item = Result<Entry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let entry = self.advance();
        self.failed = entry.is_err();
        entry.transpose()
    }
}

impl Tables {
    /// Learns from a record; gives the entry if it is a message.
    fn take(&mut self, opcode: u8, data: &[u8]) -> Result<Option<Entry>, Fault> {
        // Attachments, indices and statistics are of no use here.
        let wanted = matches!(
            opcode,
            op::SCHEMA | op::CHANNEL | op::METADATA | op::MESSAGE | op::DATA_END
        );
        if !wanted || self.at_summary {
            return Ok(None);
        }
        if !lengths::fit(opcode, data) {
            return Err(Fault::Damaged("a text in it is longer than its record".to_owned()));
        }
        match parse_record(opcode, data).map_err(|error| Fault::Damaged(error.to_string()))? {
            Record::Schema { header, .. } => drop(self.schemas.insert(header.id, header.name)),
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let (topic, encoding) = (channel.topic, channel.message_encoding);
                self.channels.insert(
                    channel.id,
                    Channel {
                        topic,
                        schema,
                        encoding,
                    },
                );
            }
            Record::Metadata(record) => drop(self.metadata.insert(record.name, record.metadata)),
            Record::DataEnd(_) => self.at_summary = true,
            Record::Message { header, data } => return self.message(&header, &data).map(Some),
            _ => {}
        }
        Ok(None)
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<Entry, Fault> {
        let (index, id) = (self.messages, header.channel_id);
        self.messages += 1;
        let unknown = || Fault::Damaged(format!("message {index} is of the unknown channel {id}"));
        let channel = self.channels.get(&id).ok_or_else(unknown)?;
        let (topic, schema) = (channel.topic.clone(), channel.schema.clone());
        match channel.decode(data) {
            Ok(message) => Ok(Entry {
                topic,
                schema,
                time: header.log_time,
                message,
            }),
            Err(why) => Err(Fault::Message { topic, index, why }),
        }
    }
}

impl Channel {
    fn decode(&self, data: &[u8]) -> Result<Option<Message>, String> {
        let fits = || match data.len() {
            0..=MAX_MESSAGE_BYTES => Ok(data),
            len => Err(format!("it has {len} bytes, more than a robot has to say")),
        };
        Ok(Some(match self.topic.as_str() {
            "/joint_states" => Message::JointStates(self.joints(fits()?)?),
            "/joint_commands" => Message::JointCommands(self.joints(fits()?)?),
            "/imu" => Message::Imu(self.ros(fits()?)?),
            "/cmd_vel" => Message::CmdVel(self.ros(fits()?)?),
            "/odom" => Message::Odom(Box::new(self.ros(fits()?)?)),
            "/battery" => Message::Battery(Box::new(self.ros(fits()?)?)),
            "/actuator_enabled" => Message::Enabled(self.enabled(fits()?)?),
            "/policy" => Message::Policy(serde_json::from_slice(fits()?).map_err(|error| error.to_string())?),
            _ => return Ok(None),
        }))
    }

    /// Joint values, of which there must be as many as joints, or none.
    fn joints(&self, data: &[u8]) -> Result<JointState, String> {
        consistent(self.ros(data)?)
    }

    /// One truth value for all joints, or a position per joint.
    fn enabled(&self, data: &[u8]) -> Result<JointState, String> {
        let of_all = match self.encoding.as_str() {
            "json" => serde_json::from_slice::<Object>(data).is_ok_and(|object| object.contains_key("data")),
            _ => self.schema == "std_msgs/msg/Bool",
        };
        if of_all {
            let all: Bool = self.ros(data)?;
            return Ok(JointState {
                position: vec![f64::from(u8::from(all.data))],
                ..JointState::default()
            });
        }
        let joints: JointState = self.ros(data)?;
        if joints.name.is_empty() && joints.position.len() == 1 {
            return Ok(joints);
        }
        consistent(joints)
    }

    /// A ROS message in CDR or JSON.
    fn ros<T: Field + serde::de::DeserializeOwned>(&self, data: &[u8]) -> Result<T, String> {
        match self.encoding.as_str() {
            "json" => serde_json::from_slice(data).map_err(|error| error.to_string()),
            "cdr" => {
                let expected = T::type_name().replace('/', "/msg/");
                if self.schema != expected {
                    return Err(format!("it is {}, this topic carries {expected}", self.schema));
                }
                cdr::decode(data)
            }
            other => Err(format!("its encoding is `{other}`, this program reads cdr and json")),
        }
    }
}

/// The joints, if each quantity has as many values as there are names, or none.
fn consistent(joints: JointState) -> Result<JointState, String> {
    let names = joints.name.len();
    if names > MAX_JOINTS {
        return Err(format!("it has {names} names, more than a robot has joints"));
    }
    for (quantity, values) in [
        ("positions", &joints.position),
        ("velocities", &joints.velocity),
        ("efforts", &joints.effort),
    ] {
        if !values.is_empty() && values.len() != names {
            return Err(format!("it has {names} names and {} {quantity}", values.len()));
        }
    }
    Ok(joints)
}
