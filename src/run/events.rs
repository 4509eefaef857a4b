//! TensorBoard event files: records of protobuf messages.
//!
//! A record is the length (u64), its masked CRC-32C, the message, its masked CRC-32C, all little-endian (TFRecord).
//! The messages are the few fields of TensorFlow's `event.proto` and `summary.proto` that scalars need.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use prost::{Message, Oneof};

/// Largest record that is read, bytes.
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// `tensorflow.Event`.
#[derive(Clone, PartialEq, Message)]
pub struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    pub wall_time: f64,
    /// Policy steps done.
    #[prost(int64, tag = "2")]
    pub step: i64,
    /// The content.
    #[prost(oneof = "What", tags = "3, 5, 7")]
    pub what: Option<What>,
}

/// Content of an [`Event`].
#[derive(Clone, PartialEq, Oneof)]
pub enum What {
    /// The first record of a file.
    #[prost(string, tag = "3")]
    FileVersion(String),
    /// Scalars of one step.
    #[prost(message, tag = "5")]
    Summary(Summary),
    /// A start after a stop.
    #[prost(message, tag = "7")]
    SessionLog(SessionLog),
}

/// `tensorflow.Summary`.
#[derive(Clone, PartialEq, Message)]
pub struct Summary {
    /// The scalars.
    #[prost(message, repeated, tag = "1")]
    pub value: Vec<SummaryValue>,
}

/// `tensorflow.Summary.Value` with a scalar.
#[derive(Clone, PartialEq, Message)]
pub struct SummaryValue {
    /// Name; what stands before a `/` groups the plots.
    #[prost(string, tag = "1")]
    pub tag: String,
    /// Value.
    #[prost(float, optional, tag = "2")]
    pub simple_value: Option<f32>,
}

/// `tensorflow.SessionLog`.
#[derive(Clone, PartialEq, Message)]
pub struct SessionLog {
    /// 1 is START: TensorBoard then forgets events of this step and later.
    #[prost(int32, tag = "1")]
    pub status: i32,
}

const SESSION_START: i32 = 1;

/// Writes one event file.
#[derive(Debug)]
pub struct EventWriter {
    file: BufWriter<File>,
}

impl EventWriter {
    /// Starts a new event file in `folder`. After a stop, `resumed_at` is the step training goes on from: TensorBoard
    /// forgets what older files of the folder say of later steps.
    ///
    /// # Errors
    /// Whatever the file system says.
    pub fn create(folder: &Path, resumed_at: Option<u64>) -> io::Result<Self> {
        let mut writer = Self {
            file: BufWriter::new(new_file(folder)?),
        };
        writer.write(0, What::FileVersion("brain.Event:2".to_owned()))?;
        if let Some(step) = resumed_at {
            writer.write(step + 1, What::SessionLog(SessionLog { status: SESSION_START }))?;
        }
        writer.file.flush()?;
        Ok(writer)
    }

    /// Writes the scalars of `step`; those that were not measured (NaN) are left out.
    ///
    /// # Errors
    /// Whatever the file system says.
    pub fn scalars<'a>(&mut self, step: u64, scalars: impl IntoIterator<Item = (&'a str, f64)>) -> io::Result<()> {
        let measured = scalars.into_iter().filter(|(_, value)| !value.is_nan());
        let value = measured
            .map(|(tag, value)| SummaryValue {
                tag: tag.to_owned(),
                simple_value: Some(value as f32),
            })
            .collect();
        self.write(step, What::Summary(Summary { value }))?;
        self.file.flush()
    }

    fn write(&mut self, step: u64, what: What) -> io::Result<()> {
        let wall_time = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or(Duration::ZERO)
            .as_secs_f64();
        let message = Event {
            wall_time,
            step: step as i64,
            what: Some(what),
        }
        .encode_to_vec();
        let length = (message.len() as u64).to_le_bytes();
        self.file.write_all(&length)?;
        self.file.write_all(&masked_crc(&length))?;
        self.file.write_all(&message)?;
        self.file.write_all(&masked_crc(&message))
    }
}

/// A file that TensorBoard takes for events and reads after those that are there: it goes by time, then name.
fn new_file(folder: &Path) -> io::Result<File> {
    let seconds = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or(Duration::ZERO)
        .as_secs();
    for number in 0.. {
        let path = folder.join(format!("events.out.tfevents.{seconds:010}.{number:04}.omniwalk"));
        match OpenOptions::new().write(true).create_new(true).open(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
            result => return result,
        }
    }
    unreachable!("there are more numbers than files")
}

/// TFRecord's masked CRC-32C: rotated and shifted, because a CRC of data that holds CRCs is weak.
fn masked_crc(bytes: &[u8]) -> [u8; 4] {
    crc32c::crc32c(bytes)
        .rotate_right(15)
        .wrapping_add(0xa282_ead8)
        .to_le_bytes()
}

/// The event files in `folder`, oldest first.
pub fn event_files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else {
        return Vec::new();
    };
    let is_events = |path: &PathBuf| {
        path.file_name()
            .and_then(|name| name.to_str())
            .is_some_and(|name| name.contains("tfevents"))
    };
    let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).filter(is_events).collect();
    files.sort();
    files
}

/// Reads an event file record by record.
#[derive(Debug)]
pub struct EventReader {
    file: BufReader<File>,
}

impl EventReader {
    /// Opens the file at `path`.
    ///
    /// # Errors
    /// Whatever the file system says.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self {
            file: BufReader::new(File::open(path)?),
        })
    }

    fn record(&mut self) -> io::Result<Option<Event>> {
        let mut length = [0; 8];
        match self.file.read(&mut length[..1])? {
            0 => return Ok(None),
            _ => self.file.read_exact(&mut length[1..])?,
        }
        self.check(&length)?;
        let size = u64::from_le_bytes(length);
        if size > MAX_RECORD_BYTES {
            return Err(damaged("a record is larger than 1 MiB"));
        }
        let mut message = vec![0; size as usize];
        self.file.read_exact(&mut message)?;
        self.check(&message)?;
        Event::decode(message.as_slice())
            .map(Some)
            .map_err(|error| damaged(&error.to_string()))
    }

    fn check(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut crc = [0; 4];
        self.file.read_exact(&mut crc)?;
        if crc == masked_crc(bytes) {
            Ok(())
        } else {
            Err(damaged("a checksum is wrong"))
        }
    }
}

fn damaged(why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, why)
}

impl Iterator for EventReader {
    type Item = io::Result<Event>;

    fn next(&mut self) -> Option<io::Result<Event>> {
        self.record().transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_tfrecord() {
        // CRC-32C of "123456789" is 0xe3069283 (RFC 3720); rotated right by 15 bits and shifted by 0xa282ead8.
        assert_eq!(masked_crc(b"123456789"), 0xc78a_b0e5_u32.to_le_bytes());
    }

    #[test]
    fn scalars_come_back_and_a_resumed_file_says_where_it_starts() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = EventWriter::create(folder.path(), None).unwrap();
        first
            .scalars(100, [("return/total", 1.5), ("gait/alternation", f64::NAN)])
            .unwrap();
        EventWriter::create(folder.path(), Some(100))
            .unwrap()
            .scalars(200, [("return/total", 2.5)])
            .unwrap();
        let files = event_files(folder.path());
        assert_eq!(files.len(), 2);
        let read = |path: &PathBuf| EventReader::open(path).unwrap().collect::<Result<Vec<_>, _>>().unwrap();
        let scalar = |value| {
            let tag = "return/total".to_owned();
            Some(What::Summary(Summary {
                value: vec![SummaryValue {
                    tag,
                    simple_value: Some(value),
                }],
            }))
        };
        let version = Some(What::FileVersion("brain.Event:2".to_owned()));
        let contents = |path| {
            read(path)
                .into_iter()
                .map(|event| (event.step, event.what))
                .collect::<Vec<_>>()
        };
        assert_eq!(contents(&files[0]), [(0, version.clone()), (100, scalar(1.5))]);
        let start = Some(What::SessionLog(SessionLog { status: SESSION_START }));
        assert_eq!(contents(&files[1]), [(0, version), (101, start), (200, scalar(2.5))]);
    }

    #[test]
    fn damaged_files_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        EventWriter::create(folder.path(), None)
            .unwrap()
            .scalars(1, [("a", 1.0)])
            .unwrap();
        let path = event_files(folder.path()).remove(0);
        let whole = fs::read(&path).unwrap();
        let fails = || EventReader::open(&path).unwrap().any(|event| event.is_err());
        assert!(!fails());
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            fs::write(&path, bytes).unwrap();
            assert!(fails(), "byte {at}");
        }
        fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        assert!(fails());
    }
}
