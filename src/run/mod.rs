//! The folder of a run: what training writes and what every later command reads.
//!
//! ```text
//! runs/NAME/config.toml       the whole effective configuration
//!           metrics.csv       one row an update
//!           events.out.*      the same for TensorBoard
//!           checkpoints/      the newest few, each written whole or not at all
//!           rollouts/         MCAP
//! ```

mod atomic;
pub mod checkpoint;
pub mod checkpoints;
pub mod events;
pub mod metrics;

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use thiserror::Error;

pub use atomic::write_atomic;
use checkpoints::Checkpoints;

/// Why a run folder cannot be used.
#[derive(Debug, Error, Diagnostic)]
pub enum RunError {
    /// Training would write over another run.
    #[error("{} already holds a run", .0.display())]
    #[diagnostic(help("go on with it by `--resume`, or choose another folder by `--run DIR`"))]
    Exists(PathBuf),
    /// There is nothing to go on with.
    #[error("{} holds no run: there is no config.toml in it", .0.display())]
    #[diagnostic(help("a run folder is what `omniwalk train` writes, such as runs/forward"))]
    NoRun(PathBuf),
    /// Another process trains in the folder.
    #[error("another omniwalk is training in {}", .0.display())]
    #[diagnostic(help("stop it first, or choose another folder by `--run DIR`"))]
    Busy(PathBuf),
    /// The file system said no.
    #[error("cannot use {}: {source}", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// A run folder.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    /// Held while training writes to the folder; the system lets it go when the process ends, however it ends.
    _lock: Option<File>,
}

impl RunFolder {
    /// Starts a run in `path` with its effective configuration. Nothing is written when this fails because of
    /// what is already there.
    ///
    /// # Errors
    /// [`RunError::Exists`] when the folder already holds a run, [`RunError::Busy`], [`RunError::Io`].
    pub fn create(path: &Path, config: &str) -> Result<Self, RunError> {
        let used = ["config.toml", "metrics.csv", "checkpoints"]
            .iter()
            .any(|name| path.join(name).exists());
        if used {
            return Err(RunError::Exists(path.to_owned()));
        }
        fs::create_dir_all(path).map_err(|source| RunError::Io {
            path: path.to_owned(),
            source,
        })?;
        let run = Self {
            path: path.to_owned(),
            _lock: Some(lock(path)?),
        };
        let io = |source| RunError::Io {
            path: run.config(),
            source,
        };
        write_atomic(&run.config(), config.as_bytes()).map_err(io)?;
        Ok(run)
    }

    /// Goes on writing to the run in `path`.
    ///
    /// # Errors
    /// [`RunError::NoRun`], [`RunError::Busy`], [`RunError::Io`].
    pub fn resume(path: &Path) -> Result<Self, RunError> {
        Self::open(path)?;
        Ok(Self {
            path: path.to_owned(),
            _lock: Some(lock(path)?),
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
                _lock: None,
            }),
            false => Err(RunError::NoRun(path.to_owned())),
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

    /// The metrics.
    pub fn metrics(&self) -> PathBuf {
        self.path.join("metrics.csv")
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

fn lock(path: &Path) -> Result<File, RunError> {
    let file = path.join(".lock");
    let io = |source| RunError::Io {
        path: file.clone(),
        source,
    };
    let handle = File::create(&file).map_err(io)?;
    match handle.try_lock() {
        Ok(()) => Ok(handle),
        Err(TryLockError::WouldBlock) => Err(RunError::Busy(path.to_owned())),
        Err(TryLockError::Error(source)) => Err(io(source)),
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
    fn a_folder_with_the_rest_of_a_run_counts_as_one() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("checkpoints")).unwrap();
        assert!(matches!(RunFolder::create(folder.path(), ""), Err(RunError::Exists(_))));
    }
}
