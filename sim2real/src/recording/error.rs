//! Why a log cannot be used, with the place in it.

use std::path::PathBuf;

use miette::Diagnostic;
use omniwalk_env::robot::RobotError;
use thiserror::Error;

use crate::log::LogError;

/// Why a log cannot be read as a recording.
#[derive(Debug, Error, Diagnostic)]
pub enum RecordingError {
    /// An MCAP file that cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Log(#[from] LogError),
    /// A column map that cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Map(#[from] RobotError),
    /// A file whose contents are not what they should be.
    #[error("{}: {place}: {why}", .path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Where in it: line, column, topic, message.
        place: String,
        /// What is wrong there.
        why: String,
        /// What would be right.
        #[help]
        help: String,
    },
}
