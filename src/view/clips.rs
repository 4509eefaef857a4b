//! The logs that the page may ask for, by number.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use omniwalk_env::robot::Robot;
use serde_json::{Value, json};

use super::row::write_frame;
use crate::report::motion::Motion;

/// Most logs that are offered.
const MOST: usize = 1000;

/// Logs of one robot; recordings join them while the program runs.
pub struct Clips {
    robot: Arc<Robot>,
    paths: Mutex<Vec<PathBuf>>,
}

impl Clips {
    /// The logs at `paths`, of `robot`; the first thousand of them.
    pub fn new(robot: &Arc<Robot>, mut paths: Vec<PathBuf>) -> Self {
        paths.truncate(MOST);
        Self {
            robot: robot.clone(),
            paths: Mutex::new(paths),
        }
    }

    /// Offers the log at `path` as well.
    pub fn add(&self, path: PathBuf) {
        let mut paths = self.lock();
        if paths.len() < MOST {
            paths.push(path);
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.lock().len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Names of the logs, in the order of their numbers.
    pub fn names(&self) -> Value {
        let name = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        json!(self.lock().iter().map(name).collect::<Vec<_>>())
    }

    /// Where log `index` is.
    pub fn path(&self, index: usize) -> Option<PathBuf> {
        self.lock().get(index).cloned()
    }

    /// The rows of the log at `path`.
    ///
    /// # Errors
    /// Those of [`Motion::read`].
    pub fn rows(&self, path: &Path) -> miette::Result<Vec<u8>> {
        let motion = Motion::read(path, &self.robot)?;
        let mut rows = Vec::new();
        motion.frames.iter().for_each(|frame| write_frame(frame, &mut rows));
        Ok(rows)
    }

    fn lock(&self) -> MutexGuard<'_, Vec<PathBuf>> {
        // A list of paths is whole whoever panicked.
        self.paths.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
