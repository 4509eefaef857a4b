//! The folder of a run: what training writes and what every later command reads.
//!
//! ```text
//! runs/NAME/config.toml       the whole effective configuration; written last when a run starts, so that a folder
//!                             with it holds everything a run needs to be resumed
//!           robot/            the robot's files
//!           sessions.toml     how it was made: one entry for the start and for each resume; a resume moves a damaged one
//!                             to sessions.damaged-N.toml
//!           metrics.csv       one row an update
//!           events.out.*      the same for TensorBoard
//!           checkpoints/      the newest few, each written whole or not at all
//!           crosscheck.csv    how checkpoints walk in MuJoCo, and crosscheck/ with the best of them
//!           rollouts/         MCAP
//! ```

mod atomic;
pub mod checkpoint;
pub mod checkpoints;
pub mod events;
pub mod metrics;
pub mod sessions;
pub mod tensor;
pub mod transfer;

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use thiserror::Error;

use crate::files;
pub use atomic::write_atomic;
use checkpoints::Checkpoints;

/// Largest configuration that is read, bytes.
pub const MAX_CONFIG_BYTES: u64 = 1 << 20;

/// Why a run folder cannot be used.
#[derive(Debug, Error, Diagnostic)]
pub enum RunError {
    /// Training would write over another run.
    #[error("{} already holds a run", .0.display())]
    #[diagnostic(help("go on with it by `--resume`, or choose another folder by `--run DIR`"))]
    Exists(PathBuf),
    /// There are files that training would write over, and they are no run.
    #[error("{} already holds `{name}`", .path.display())]
    #[diagnostic(help("choose another folder by `--run DIR`"))]
    Taken {
        /// The folder.
        path: PathBuf,
        /// What is in the way.
        name: &'static str,
    },
    /// There is nothing to go on with.
    #[error("{} holds no run: there is no config.toml in it", .0.display())]
    #[diagnostic(help(
        "a run folder is what `omniwalk train` writes, such as runs/forward-1; one whose start was cut off can be started again; \
         eval, report, export and rehearse take a policy file too, such as a policy.omni in the folder"
    ))]
    NoRun(PathBuf),
    /// Another process trains in the folder.
    #[error("another omniwalk is training in {}", .0.display())]
    #[diagnostic(help("stop it first, or choose another folder by `--run DIR`"))]
    Busy(PathBuf),
    /// Somebody has taken it away while training wrote to it.
    #[error("the run folder {} was removed or replaced while training wrote to it", .0.display())]
    #[diagnostic(help("training stops, as nothing could be gone on with; begin again, in a folder that stays"))]
    Gone(PathBuf),
    /// Nothing can be written there.
    #[error("cannot write to the run folder {}: {why}", .path.display())]
    #[diagnostic(help("training writes there: make it writable, or choose another folder by `--run DIR`"))]
    NotWritable {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        why: io::Error,
    },
    /// The file system said no.
    #[error("cannot use {}: {why}", .path.display())]
    #[diagnostic(help("{}", remedy(.why)))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        why: io::Error,
    },
}

/// What a user can do about a file of a run that the file system refuses.
pub(crate) fn remedy(why: &io::Error) -> &'static str {
    match why.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "make room on its disk and type the same again; what was there before is as it was"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "training writes there: make it writable, or choose another folder by `--run DIR`"
        }
        io::ErrorKind::InvalidData => "it is damaged: move it away and type the same again",
        _ => "what was there before is as it was",
    }
}

/// A run folder.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    /// Held while training writes to the folder; the system lets it go when the process ends, however it ends.
    lock: Option<File>,
}

impl RunFolder {
    /// Takes `path` for a new run, which begins with [`RunFolder::begin`]. What a start that was cut off before left
    /// there is removed; nothing is written when this fails because of what is already there.
    ///
    /// # Errors
    /// [`RunError::Exists`] when the folder already holds a run, [`RunError::Taken`], [`RunError::Busy`],
    /// [`RunError::NotWritable`], [`RunError::Io`].
    pub fn prepare(path: &Path) -> Result<Self, RunError> {
        let io = |why| RunError::Io {
            path: path.to_owned(),
            why,
        };
        let run = Self {
            path: path.to_owned(),
            lock: None,
        };
        let learned = run.checkpoints().list().iter().any(|(step, _)| *step > 0);
        if learned || run.config().exists() || run.metrics().exists() {
            return Err(RunError::Exists(path.to_owned()));
        }
        // The lock is the first file of a start: without it, what is there is not ours. An empty one may be anybody's.
        let began = fs::read(path.join(LOCK)).is_ok_and(|content| content == LOCK_CONTENT);
        let rest = ["checkpoints", "robot"]
            .into_iter()
            .filter(|name| path.join(name).exists());
        if !began && let Some(name) = rest.clone().next() {
            return Err(RunError::Taken {
                path: path.to_owned(),
                name,
            });
        }
        create_folder(path).map_err(|why| RunError::NotWritable {
            path: path.to_owned(),
            why,
        })?;
        let lock = Some(lock(path)?);
        for name in rest {
            fs::remove_dir_all(path.join(name)).map_err(io)?;
        }
        Ok(Self { lock, ..run })
    }

    /// Writes the effective configuration. From now on the folder holds a run: whatever is needed to go on with it
    /// is there already.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn begin(&self, config: &str) -> Result<(), RunError> {
        let path = self.config();
        write_atomic(&path, config.as_bytes()).map_err(|why| RunError::Io { path, why })
    }

    /// [`RunFolder::prepare`] and [`RunFolder::begin`], for a run without anything else.
    ///
    /// # Errors
    /// Theirs.
    pub fn create(path: &Path, config: &str) -> Result<Self, RunError> {
        let run = Self::prepare(path)?;
        run.begin(config)?;
        Ok(run)
    }

    /// Goes on writing to the run in `path`.
    ///
    /// # Errors
    /// [`RunError::NoRun`], [`RunError::Busy`], [`RunError::NotWritable`], [`RunError::Io`].
    pub fn resume(path: &Path) -> Result<Self, RunError> {
        Self::open(path)?;
        Ok(Self {
            path: path.to_owned(),
            lock: Some(lock(path)?),
        })
    }

    /// Opens the run in `path` for reading.
    ///
    /// # Errors
    /// [`RunError::NoRun`].
    pub fn open(path: &Path) -> Result<Self, RunError> {
        match path.join("config.toml").is_file() {
            true => Ok(Self {
                path: path.to_owned(),
                lock: None,
            }),
            false => Err(RunError::NoRun(path.to_owned())),
        }
    }

    /// Says whether the folder is still the one that was taken for training: files are written into a folder that was removed, or in
    /// the place of one, without a word of the system.
    ///
    /// # Errors
    /// [`RunError::Gone`].
    pub fn check(&self) -> Result<(), RunError> {
        let held = self.lock.as_ref().and_then(|lock| lock.metadata().ok());
        let there = fs::metadata(self.path.join(LOCK)).ok();
        match held.zip(there) {
            Some((held, there)) if is_same(&held, &there) => Ok(()),
            _ => Err(RunError::Gone(self.path.clone())),
        }
    }

    /// The folder itself, where TensorBoard's event files are.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The effective configuration.
    pub fn config(&self) -> PathBuf {
        self.path.join("config.toml")
    }

    /// Says that nothing is in the configuration, of which training writes every value.
    pub fn emptied(&self) -> Option<String> {
        let path = self.config();
        let text = files::read(&path, MAX_CONFIG_BYTES).ok()?;
        let table: toml::Table = toml::from_slice(&text).ok()?;
        let empty = format!("{} is empty: it is no run's configuration", path.display());
        table.is_empty().then_some(empty)
    }

    /// The metrics.
    pub fn metrics(&self) -> PathBuf {
        self.path.join("metrics.csv")
    }

    /// The copy of the robot's files.
    pub fn robot(&self) -> PathBuf {
        self.path.join("robot")
    }

    /// How checkpoints walk in MuJoCo.
    pub fn transfer(&self) -> PathBuf {
        self.path.join("crosscheck.csv")
    }

    /// How the run was made.
    pub fn sessions(&self) -> PathBuf {
        self.path.join("sessions.toml")
    }

    /// The checkpoints.
    pub fn checkpoints(&self) -> Checkpoints {
        Checkpoints::new(self.path.join("checkpoints"))
    }

    /// Folder of the rollouts.
    pub fn rollouts(&self) -> PathBuf {
        self.path.join("rollouts")
    }
}

/// Creates the folder `path` and those above it.
///
/// # Errors
/// Whatever the file system says; a file in the way is named.
pub fn create_folder(path: &Path) -> io::Result<()> {
    fs::create_dir_all(path).map_err(|error| match path.ancestors().find(|ancestor| ancestor.is_file()) {
        Some(file) => io::Error::new(error.kind(), format!("{} is a file, not a folder", file.display())),
        None => error,
    })
}

/// The files of a folder that have this extension, in the order of their names.
///
/// # Errors
/// When the folder cannot be read.
pub fn files_of(folder: &Path, extension: &str) -> io::Result<Vec<PathBuf>> {
    let paths = fs::read_dir(folder)?.flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = paths
        .filter(|path| path.extension().is_some_and(|own| own == extension))
        .collect();
    files.sort();
    Ok(files)
}

#[cfg(unix)]
fn is_same(one: &fs::Metadata, other: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// A file that is open cannot be removed here.
#[cfg(not(unix))]
fn is_same(_: &fs::Metadata, _: &fs::Metadata) -> bool {
    true
}

/// Name of the file that is locked while a process trains.
const LOCK: &str = ".lock";
/// What is in it, so that another program's lock is not taken for the sign of a start that was cut off.
const LOCK_CONTENT: &[u8] = b"omniwalk\n";

fn lock(path: &Path) -> Result<File, RunError> {
    let file = path.join(LOCK);
    let io = |why| RunError::Io {
        path: file.clone(),
        why,
    };
    let options = || File::options().create(true).truncate(false).write(true).open(&file);
    let mut handle = options().map_err(|why| RunError::NotWritable {
        path: path.to_owned(),
        why,
    })?;
    match handle.try_lock() {
        Ok(()) => {
            let written = handle.set_len(0).and_then(|()| handle.write_all(LOCK_CONTENT));
            written.map_err(|why| {
                // What an empty one would say about the folder is not known.
                let _ = fs::remove_file(&file);
                io(why)
            })?;
            Ok(handle)
        }
        Err(TryLockError::WouldBlock) => Err(RunError::Busy(path.to_owned())),
        Err(TryLockError::Error(why)) => Err(io(why)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs/a");
        assert!(matches!(RunFolder::resume(&path), Err(RunError::NoRun(_))));
        assert!(!path.exists());
        let run = RunFolder::create(&path, "seed = 1\n").unwrap();
        assert_eq!(fs::read_to_string(run.config()).unwrap(), "seed = 1\n");
        assert!(matches!(
            RunFolder::create(&path, "seed = 2\n"),
            Err(RunError::Exists(_))
        ));
        assert!(matches!(RunFolder::resume(&path), Err(RunError::Busy(_))));
        drop(run);
        RunFolder::resume(&path).unwrap();
    }

    #[test]
    fn a_folder_with_checkpoints_counts_as_a_run() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::create(folder.path(), "").unwrap();
        run.checkpoints().save(&checkpoint::Checkpoint::new(10), 1).unwrap();
        fs::remove_file(run.config()).unwrap();
        drop(run);
        assert!(matches!(RunFolder::prepare(folder.path()), Err(RunError::Exists(_))));
    }

    #[test]
    fn a_start_that_was_cut_off_can_be_repeated_and_nothing_else_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let robot = folder.path().join("robot");
        fs::create_dir(&robot).unwrap();
        fs::write(robot.join("a.urdf"), "mine").unwrap();
        fs::write(folder.path().join(LOCK), "").unwrap();
        let taken = RunFolder::prepare(folder.path()).unwrap_err();
        assert!(matches!(taken, RunError::Taken { name: "robot", .. }), "{taken}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        fs::remove_dir_all(&robot).unwrap();
        let run = RunFolder::prepare(folder.path()).unwrap();
        run.checkpoints().save(&checkpoint::Checkpoint::new(0), 1).unwrap();
        fs::create_dir(run.robot()).unwrap();
        drop(run);
        let run = RunFolder::prepare(folder.path()).unwrap();
        assert!(!run.robot().exists() && run.checkpoints().list().is_empty());
    }
}
