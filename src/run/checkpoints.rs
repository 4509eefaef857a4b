//! The checkpoints of a run: a folder in which the newest few are kept.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::checkpoint::{Checkpoint, CheckpointError};

/// The folder `checkpoints/` of a run.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    folder: PathBuf,
}

/// The newest checkpoint that is whole.
#[derive(Debug)]
pub struct Latest {
    /// The checkpoint.
    pub checkpoint: Checkpoint,
    /// Its file.
    pub path: PathBuf,
    /// Newer files that are damaged; the user should hear of them.
    pub skipped: Vec<CheckpointError>,
}

impl Checkpoints {
    /// The checkpoints in `folder`, which need not exist yet; the one above it must when one is saved.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Files and their steps, oldest first.
    pub fn list(&self) -> Vec<(u64, PathBuf)> {
        let Ok(entries) = fs::read_dir(&self.folder) else {
            return Vec::new();
        };
        let mut files: Vec<_> = entries
            .flatten()
            .filter_map(|entry| Some((step_of(&entry.path())?, entry.path())))
            .collect();
        files.sort();
        files
    }

    /// Writes `checkpoint` whole or not at all, then removes all but the newest `keep` (at least one).
    ///
    /// Files of a later step go too: training went on from here, so they were damaged or given up.
    ///
    /// # Errors
    /// [`CheckpointError::Io`]; the older checkpoints are then still there.
    pub fn save(&self, checkpoint: &Checkpoint, keep: usize) -> Result<PathBuf, CheckpointError> {
        let path = self.folder.join(format!("step-{:012}.safetensors", checkpoint.step));
        let io = |path: &Path, why| CheckpointError::Io {
            action: "write",
            path: path.to_owned(),
            why,
        };
        // Only this folder: that of the run is there, or somebody has removed it.
        match fs::create_dir(&self.folder) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(io(&self.folder, error)),
            _ => {}
        }
        checkpoint.write(&path)?;
        let (earlier, later): (Vec<_>, Vec<_>) =
            self.list().into_iter().partition(|(step, _)| *step <= checkpoint.step);
        let surplus = earlier.len().saturating_sub(keep.max(1));
        for (_, old) in earlier.iter().take(surplus).chain(&later) {
            fs::remove_file(old).map_err(|error| io(old, error))?;
        }
        Ok(path)
    }

    /// The newest checkpoint that can be read, or `None` when there is no file at all.
    ///
    /// # Errors
    /// [`CheckpointError::NoneWhole`] when there are files but every one is damaged.
    pub fn latest(&self) -> Result<Option<Latest>, CheckpointError> {
        let mut skipped = Vec::new();
        for (_, path) in self.list().into_iter().rev() {
            match Checkpoint::read(&path) {
                Ok(checkpoint) => {
                    return Ok(Some(Latest {
                        checkpoint,
                        path,
                        skipped,
                    }));
                }
                Err(error) => skipped.push(error),
            }
        }
        let files = skipped.len();
        let newest = skipped.into_iter().next().map(Box::new);
        newest.map_or(Ok(None), |newest| {
            let folder = self.folder.clone();
            Err(CheckpointError::NoneWhole { folder, files, newest })
        })
    }
}

/// The step in a checkpoint's file name.
fn step_of(path: &Path) -> Option<u64> {
    path.file_name()?
        .to_str()?
        .strip_prefix("step-")?
        .strip_suffix(".safetensors")?
        .parse()
        .ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(checkpoints: &Checkpoints) -> Vec<u64> {
        checkpoints.list().into_iter().map(|(step, _)| step).collect()
    }

    #[test]
    fn the_last_few_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path().join("checkpoints"));
        assert!(checkpoints.latest().unwrap().is_none());
        for step in [5, 10, 999, 1_000_000_000_000] {
            checkpoints.save(&Checkpoint::new(step), 2).unwrap();
        }
        assert_eq!(steps(&checkpoints), [999, 1_000_000_000_000]);
        assert_eq!(
            checkpoints.latest().unwrap().unwrap().checkpoint.step,
            1_000_000_000_000
        );
    }

    #[test]
    fn a_damaged_newest_checkpoint_is_skipped_and_later_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path());
        for step in [10, 20, 30] {
            checkpoints.save(&Checkpoint::new(step), 3).unwrap();
        }
        let newest = checkpoints.list().pop().unwrap().1;
        fs::write(&newest, &fs::read(&newest).unwrap()[..20]).unwrap();
        let latest = checkpoints.latest().unwrap().unwrap();
        assert_eq!((latest.checkpoint.step, latest.skipped.len()), (20, 1));
        assert!(
            latest.skipped[0]
                .to_string()
                .contains("step-000000000030.safetensors is not a whole checkpoint")
        );
        checkpoints.save(&Checkpoint::new(25), 3).unwrap();
        assert_eq!(steps(&checkpoints), [10, 20, 25]);
    }

    #[test]
    fn only_damaged_checkpoints_are_an_error_and_not_a_fresh_start() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("step-000000000010.safetensors"), b"rubbish").unwrap();
        Checkpoints::new(folder.path()).latest().unwrap_err();
    }
}
