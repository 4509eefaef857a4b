//! `sessions.toml`: how a run was made, one entry for each process that trained it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use miette::Diagnostic;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::atomic::write_atomic;
use crate::files;
use crate::terminal::quoted;

/// Largest record that is read, bytes: thousands of sessions.
const MAX_BYTES: u64 = 4 << 20;
/// Longest reason that is given, characters.
const LONGEST_WHY: usize = 200;
/// Longest session that is believed, s: a century.
const LONGEST: f64 = 3.2e9;

/// Why the record cannot be kept or read.
#[derive(Debug, Error, Diagnostic)]
pub enum SessionsError {
    /// The file system said no.
    #[error("cannot use {}: {why}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        why: io::Error,
    },
    /// The file is not what training wrote.
    #[error("{} is damaged: {why}", .path.display())]
    #[diagnostic(help(
        "it is a record only, of who trained when: move it away; `train --resume` does so by itself and goes on"
    ))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}

/// One process that trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Session {
    /// What was typed behind `omniwalk`.
    pub arguments: Vec<String>,
    /// Version of the program.
    pub version: String,
    /// Commit the program was built from, with `+` if files differed from it; not known outside a repository.
    pub commit: Option<String>,
    /// Processor, number of its cores, and system; not recorded by old versions.
    #[serde(default)]
    pub machine: Option<String>,
    /// Seed of everything random.
    pub seed: u64,
    /// Threads of the process.
    pub threads: usize,
    /// SIMD level of the learner.
    pub learner_simd: String,
    /// SIMD level of the engine; `rapier` has none to choose.
    pub engine_simd: Option<String>,
    /// Begin of the process, UTC, RFC 3339.
    pub started: String,
    /// Control steps done before.
    pub first_step: u64,
    /// Control steps done at the last checkpoint.
    pub last_step: u64,
    /// Wall time from the begin to the last checkpoint, s.
    pub seconds: f64,
    /// Whose weights the run began with.
    pub from: Option<Origin>,
}

impl Session {
    /// The command, as a shell takes it.
    pub fn command(&self) -> String {
        let words = self.arguments.iter().map(|word| quoted(word));
        ["omniwalk".to_owned()]
            .into_iter()
            .chain(words)
            .collect::<Vec<_>>()
            .join(" ")
    }

    /// Program and machine.
    pub fn program(&self) -> String {
        let commit = self.commit.as_ref().map(|commit| format!(", commit {commit}"));
        let engine = self.engine_simd.as_ref().map(|level| format!(", engine {level}"));
        let machine = self.machine.as_ref().map(|machine| format!(", on {machine}"));
        format!(
            "omniwalk {}{}, {} threads, learner {}{}{}",
            self.version,
            commit.unwrap_or_default(),
            self.threads,
            self.learner_simd,
            engine.unwrap_or_default(),
            machine.unwrap_or_default(),
        )
    }
}

/// The run whose weights another began with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// The run as it was typed.
    pub run: PathBuf,
    /// Control steps of its checkpoint.
    pub step: u64,
    /// Hash of what shaped it; not known of checkpoints of old versions.
    pub configuration: Option<String>,
    /// What was taken over.
    pub taken: Vec<String>,
}

/// The record of a run, open for its last session.
#[derive(Debug)]
pub struct Sessions {
    path: PathBuf,
    all: Record,
}

#[derive(Debug, Default, Serialize, Deserialize)]
struct Record {
    #[serde(default)]
    session: Vec<Session>,
}

impl Record {
    /// What a file says, or what is wrong with it.
    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let text = std::str::from_utf8(bytes).map_err(|_| "it is not text".to_owned())?;
        if text.trim().is_empty() {
            return Err("it is empty".to_owned());
        }
        // A message may repeat a value of any length.
        let short = |message: &str| message.chars().take(LONGEST_WHY).collect::<String>();
        let record: Self = toml::from_str(text).map_err(|error| short(error.message()))?;
        for (i, session) in (1..).zip(&record.session) {
            if !(0.0..=LONGEST).contains(&session.seconds) {
                return Err(format!(
                    "`seconds` of session {i} is {:e}, which no session lasts",
                    session.seconds
                ));
            }
            if session.first_step > session.last_step {
                return Err(format!(
                    "session {i} ends at step {}, before its first, {}",
                    session.last_step, session.first_step
                ));
            }
        }
        Ok(record)
    }
}

impl Sessions {
    /// The empty record of a new run; nothing is written yet, and what a start that was cut off wrote will go.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            all: Record::default(),
        }
    }

    /// The record at `path`, which need not exist yet.
    ///
    /// # Errors
    /// [`SessionsError`].
    pub fn open(path: &Path) -> Result<Self, SessionsError> {
        let damaged = |why: String| SessionsError::Damaged {
            path: path.to_owned(),
            why,
        };
        let all = match files::read(path, MAX_BYTES) {
            Ok(bytes) => Record::parse(&bytes).map_err(damaged)?,
            Err(error) => match error.kind() {
                io::ErrorKind::NotFound => Record::default(),
                // Nothing that training writes, and in its way.
                io::ErrorKind::FileTooLarge | io::ErrorKind::IsADirectory | io::ErrorKind::InvalidInput => {
                    return Err(damaged(error.to_string()));
                }
                _ => {
                    return Err(SessionsError::Io {
                        path: path.to_owned(),
                        why: error,
                    });
                }
            },
        };
        Ok(Self {
            path: path.to_owned(),
            all,
        })
    }

    /// The record at `path` to be gone on with. A damaged one is moved aside, and a new one begins; the second value says what
    /// is wrong and where the old one is.
    ///
    /// # Errors
    /// [`SessionsError::Io`].
    pub fn resume(path: &Path) -> Result<(Self, Option<String>), SessionsError> {
        let damage = match Self::open(path) {
            Ok(sessions) => return Ok((sessions, None)),
            Err(damage @ SessionsError::Damaged { .. }) => damage,
            Err(error) => return Err(error),
        };
        let aside = free_name(path);
        fs::rename(path, &aside).map_err(|why| SessionsError::Io {
            path: path.to_owned(),
            why,
        })?;
        let said = format!(
            "{damage}; it is kept as {}, and who trained until now, and when, is not recorded any more",
            aside.display()
        );
        Ok((Self::new(path), Some(said)))
    }

    /// The sessions, oldest first.
    pub fn list(&self) -> &[Session] {
        &self.all.session
    }

    /// Adds a session and writes the record.
    ///
    /// # Errors
    /// [`SessionsError::Io`]; the older record is then still there.
    pub fn push(&mut self, session: Session) -> Result<(), SessionsError> {
        self.all.session.push(session);
        self.write()
    }

    /// Notes how far the last session is, and writes the record.
    ///
    /// # Errors
    /// [`SessionsError::Io`]; the older record is then still there.
    pub fn progress(&mut self, step: u64, time: Duration) -> Result<(), SessionsError> {
        if let Some(session) = self.all.session.last_mut() {
            session.last_step = step;
            session.seconds = (time.as_secs_f64() * 10.0).round() / 10.0;
        }
        self.write()
    }

    fn write(&self) -> Result<(), SessionsError> {
        let io = |why| SessionsError::Io {
            path: self.path.clone(),
            why,
        };
        let text = toml::to_string(&self.all).map_err(|error| io(io::Error::other(error)))?;
        write_atomic(&self.path, text.as_bytes()).map_err(io)
    }
}

/// A name beside `path` that nothing has yet.
fn free_name(path: &Path) -> PathBuf {
    let mut number = 1;
    loop {
        let name = path.with_extension(format!("damaged-{number}.toml"));
        if name.symlink_metadata().is_err() {
            return name;
        }
        number += 1;
    }
}

/// Processor, number of its cores, and system.
pub fn machine() -> String {
    let information = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = information.lines().find_map(|line| line.strip_prefix("model name"));
    let model = model.map(|rest| rest.trim_start_matches([' ', '\t', ':']));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let (system, kind) = (std::env::consts::OS, std::env::consts::ARCH);
    format!("{}, {cores} cores, {system}", model.unwrap_or(kind))
}

/// `time` in UTC as RFC 3339, to the second.
pub fn utc(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (year, month, day) = date(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// The date `days` after 1970-01-01 in the Gregorian calendar, counted in years that begin in March, so that the leap
/// day is the last (Hinnant, "chrono-compatible low-level date algorithms", `civil_from_days`).
fn date(days: u64) -> (u64, u64, u64) {
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year + year / 4 - year / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    (era * 400 + year + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_is_said_in_few_words() {
        let long = format!("[[session]]\nseed = \"{}\"\n", "9".repeat(100_000));
        for text in [long.as_str(), "session = 1e308", "[[session]]\nseconds = 1", "", "\n"] {
            let why = Record::parse(text.as_bytes()).unwrap_err();
            assert!(!why.is_empty() && why.len() <= LONGEST_WHY, "{why}");
        }
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        let at = |seconds| utc(UNIX_EPOCH + Duration::from_secs(seconds));
        // From `date --utc --date=@SECONDS`.
        assert_eq!(at(0), "1970-01-01T00:00:00Z");
        assert_eq!(at(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(at(1_709_251_199), "2024-02-29T23:59:59Z");
        assert_eq!(at(4_107_542_400), "2100-03-01T00:00:00Z");
    }
}
