//! Reads `metrics.csv` row by row.

use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};

use super::{Damage, MetricsError, row};
use crate::files;

/// Longest row that is read, bytes.
const MAX_ROW_BYTES: u64 = 1 << 16;

/// What is in a `metrics.csv`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics {
    /// Names of the columns after `step`.
    pub columns: Vec<String>,
    /// Number of whole rows.
    pub rows: usize,
    /// Step and values of the last whole row; NaN where a cell is empty.
    pub last: Option<(u64, Vec<f64>)>,
    path: PathBuf,
    damage: Damage,
}

impl Metrics {
    /// Reads the file at `path` row by row.
    ///
    /// # Errors
    /// [`MetricsError::Io`], or [`MetricsError::Damaged`] for what is not the file of a run. Rows that are damaged are left out
    /// ([`Metrics::damage`]).
    pub fn read(path: &Path) -> Result<Self, MetricsError> {
        Self::scan(path, |_| {})
    }

    /// Reads the file at `path` and shows the metrics so far to `each` after every whole row.
    ///
    /// # Errors
    /// As [`Metrics::read`].
    pub fn scan(path: &Path, mut each: impl FnMut(&Self)) -> Result<Self, MetricsError> {
        let io = |why| MetricsError::Io {
            path: path.to_owned(),
            why,
        };
        let damaged = |line: usize, why: &str| MetricsError::Damaged {
            path: path.to_owned(),
            line,
            why: why.to_owned(),
        };
        let mut file = BufReader::new(files::open(path).map_err(io)?);
        let mut metrics = Self {
            path: path.to_owned(),
            ..Self::default()
        };
        let mut bytes = Vec::new();
        for line in 1.. {
            bytes.clear();
            let row = io::Read::take(&mut file, MAX_ROW_BYTES).read_until(b'\n', &mut bytes);
            if row.map_err(io)? == 0 {
                break;
            }
            let Some(row) = bytes.strip_suffix(b"\n") else {
                // A row that is being written, or that a kill cut off.
                if line > 1 && (bytes.len() as u64) < MAX_ROW_BYTES {
                    break;
                }
                return Err(damaged(line, "this row does not end"));
            };
            let text = std::str::from_utf8(row).map_err(|_| "this is not text");
            if line == 1 {
                let header = text.and_then(|text| metrics.header(text));
                header.map_err(|why| damaged(line, why))?;
            } else {
                match text.and_then(|text| metrics.take(text)) {
                    Ok(()) => each(&metrics),
                    Err(why) => metrics.damage.note(line, why),
                }
            }
        }
        match metrics.columns.is_empty() {
            true => Err(damaged(1, "there is no header")),
            false => Ok(metrics),
        }
    }

    /// What was left out, for a warning.
    pub fn damage(&self) -> Option<String> {
        self.damage.text(&self.path)
    }

    fn header(&mut self, text: &str) -> Result<(), &'static str> {
        let mut names = text.split(',');
        let first = names.next();
        self.columns = names.map(str::to_owned).collect();
        match first {
            Some("step") => Ok(()),
            _ => Err(
                "the first column of a run's metrics is `step`; of a log in CSV `omniwalk replay` says what it holds, by a column map (--map)",
            ),
        }
    }

    fn take(&mut self, text: &str) -> Result<(), &'static str> {
        let before = self.last.as_ref().map(|(step, _)| *step);
        let (step, values) = row(text, self.columns.len(), before)?;
        self.last = Some((step, values.collect()));
        self.rows += 1;
        Ok(())
    }
}
