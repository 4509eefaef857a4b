//! Text files from outside: bounded reading, and errors that point at the place in the text.

use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

use miette::{Diagnostic, NamedSource, SourceSpan};
use thiserror::Error;

/// Largest URDF or TOML that is read, bytes. Real ones stay below 1 MiB.
const MAX_BYTES: u64 = 8 << 20;

/// Why a robot cannot be loaded.
#[derive(Debug, Error, Diagnostic)]
pub enum RobotError {
    /// A file cannot be found or read, or is not what a robot is made of.
    #[error("{file}: {message}")]
    File {
        /// The file or folder.
        file: String,
        /// What is wrong.
        message: String,
        /// What would be right.
        #[help]
        help: String,
    },
    /// A file is there, but something in it is wrong.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Content(Box<ContentError>),
}

/// A fault at a place in a file.
#[derive(Debug, Error, Diagnostic)]
#[error("{file}:{line}:{column}: {message}")]
pub struct ContentError {
    /// The file.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// What is wrong.
    pub message: String,
    /// What would be right.
    #[help]
    pub help: String,
    #[source_code]
    text: NamedSource<String>,
    #[label("here")]
    span: SourceSpan,
}

/// A text file in memory, with its name for errors.
pub struct Source {
    /// The file's name as the user knows it.
    pub file: String,
    /// What is in it.
    pub text: String,
}

impl Source {
    /// Reads a file of at most 8 MiB.
    ///
    /// # Errors
    /// [`RobotError::File`] for a file that cannot be read, is larger, or is not UTF-8.
    pub fn read(path: &Path) -> Result<Self, RobotError> {
        let file = path.display().to_string();
        let fail = |message: String, help: &str| RobotError::File {
            file: file.clone(),
            message,
            help: help.into(),
        };
        let unreadable = |error: std::io::Error| fail(error.to_string(), "give a file that can be read");
        let kind = std::fs::metadata(path).map_err(unreadable)?.file_type();
        if !kind.is_file() && !kind.is_dir() {
            return Err(fail(
                "a pipe or a device, not a regular file".into(),
                "give a file that can be read",
            ));
        }
        let mut bytes = Vec::new();
        File::open(path)
            .map_err(unreadable)?
            .take(MAX_BYTES + 1)
            .read_to_end(&mut bytes)
            .map_err(unreadable)?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(fail(
                format!("larger than {} MiB", MAX_BYTES >> 20),
                "text files that people write are small",
            ));
        }
        let text = String::from_utf8(bytes).map_err(|_| fail("not UTF-8 text".into(), "save the file as UTF-8"))?;
        Ok(Self { file, text })
    }

    /// An error at `range` (bytes) of the text: what is wrong, and what would be right.
    pub fn error(&self, range: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> RobotError {
        let start = self.text.floor_char_boundary(range.start);
        let end = self.text.floor_char_boundary(range.end);
        let before = &self.text[..start];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        // A whole element can span pages: the label marks its first line only.
        let line_end = self.text[start..].find('\n').map_or(self.text.len(), |at| start + at);
        RobotError::Content(Box::new(ContentError {
            file: self.file.clone(),
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
            message: message.into(),
            help: help.into(),
            text: NamedSource::new(&self.file, self.text.clone()),
            span: (start..end.clamp(start, line_end)).into(),
        }))
    }
}
