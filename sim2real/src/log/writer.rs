//! Writes MCAP.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use super::{LogError, Message};
use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions, Writer};

/// Writes a log message by message.
pub struct LogWriter {
    writer: Writer<BufWriter<File>>,
    channels: BTreeMap<&'static str, Channel>,
    path: PathBuf,
}

struct Channel {
    id: u16,
    sequence: u32,
}

impl LogWriter {
    /// Starts a log at `path`, over whatever is there.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn create(path: &Path) -> Result<Self, LogError> {
        let io = |source| LogError::Io {
            path: path.to_owned(),
            source,
        };
        let file = BufWriter::new(File::create(path).map_err(io)?);
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("omniwalk ", env!("CARGO_PKG_VERSION")))
            // A quarter of the size: names of frames and joints repeat in every message.
            .compression(Some(Compression::Zstd))
            // Chunks are gathered in memory and written whole, so that a killed process leaves no half of one.
            .disable_seeking(true);
        let writer = options.create(file).map_err(|error| io(into_io(error)))?;
        Ok(Self {
            writer,
            channels: BTreeMap::new(),
            path: path.to_owned(),
        })
    }

    /// Appends `message` at `time`, ns.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn write(&mut self, time: u64, message: &Message) -> Result<(), LogError> {
        self.append(time, message).map_err(|error| self.error(error))
    }

    /// Adds a metadata record, such as the policy and seed of a rollout.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), LogError> {
        let record = mcap::records::Metadata {
            name: name.to_owned(),
            metadata,
        };
        self.writer.write_metadata(&record).map_err(|error| self.error(error))
    }

    /// Hands all messages so far to the system as a whole chunk: should the process be killed, they are in the file, which lacks
    /// its end then and is made whole by `mcap recover`.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.writer.flush().map_err(|error| self.error(error))
    }

    /// Completes the file; a log that is dropped without it may be cut off.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn finish(mut self) -> Result<(), LogError> {
        self.writer.finish().map(drop).map_err(|error| self.error(error))
    }

    fn append(&mut self, time: u64, message: &Message) -> Result<(), McapError> {
        let data = message.bytes().map_err(std::io::Error::from)?;
        if !self.channels.contains_key(message.topic()) {
            let id = self.add_channel(message)?;
            self.channels.insert(message.topic(), Channel { id, sequence: 0 });
        }
        let channel = self
            .channels
            .entry(message.topic())
            .or_insert(Channel { id: 0, sequence: 0 });
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.sequence,
            log_time: time,
            publish_time: time,
        };
        channel.sequence += 1;
        self.writer.write_to_known_channel(&header, &data)
    }

    fn add_channel(&mut self, message: &Message) -> Result<u16, McapError> {
        let schema = message.schema();
        let id = self
            .writer
            .add_schema(&schema.name, schema.encoding, schema.text.as_bytes())?;
        self.writer
            .add_channel(id, message.topic(), schema.message_encoding, &BTreeMap::new())
    }

    fn error(&self, error: McapError) -> LogError {
        LogError::Io {
            path: self.path.clone(),
            source: into_io(error),
        }
    }
}

fn into_io(error: McapError) -> std::io::Error {
    match error {
        McapError::Io(error) => error,
        error => std::io::Error::other(error),
    }
}
