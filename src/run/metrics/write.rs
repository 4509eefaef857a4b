//! Appends to `metrics.csv`, and goes on with one.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use super::{Damage, MetricsError, row};
use crate::files;
use crate::run::write_atomic;

/// Writes `metrics.csv` row by row.
#[derive(Debug)]
pub struct MetricsWriter {
    file: File,
    path: PathBuf,
    columns: usize,
    row: String,
    /// What was left out when the file was gone on with.
    damage: Damage,
}

impl MetricsWriter {
    /// Starts a new file at `path` with the column `step` and then `columns`.
    ///
    /// # Errors
    /// [`MetricsError::Io`], also when the file is already there.
    pub fn create(path: &Path, columns: &[&str]) -> Result<Self, MetricsError> {
        let io = |why| MetricsError::Io {
            path: path.to_owned(),
            why,
        };
        if path.exists() {
            return Err(io(io::ErrorKind::AlreadyExists.into()));
        }
        // A file without its whole first line could not be gone on with.
        write_atomic(path, header(columns).as_bytes()).map_err(io)?;
        Self::over(path, OpenOptions::new().append(true).open(path), columns)
    }

    /// Goes on with the file at `path` after a stop: rows after `step`, and one that is cut off, go. So do damaged ones
    /// ([`MetricsWriter::damage`]). Columns that it does not have yet, an older program having begun it, are empty in its rows.
    /// Starts a new file if there is none.
    ///
    /// # Errors
    /// [`MetricsError::OtherColumn`], or [`MetricsError::Io`].
    pub fn resume(path: &Path, columns: &[&str], step: u64) -> Result<Self, MetricsError> {
        let io = |why| MetricsError::Io {
            path: path.to_owned(),
            why,
        };
        let text = match files::open(path).and_then(read_all) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Self::create(path, columns),
            // A full disk leaves one like that.
            Ok(text) if text.is_empty() => header(columns),
            text => text.map_err(io)?,
        };
        let (first, rows) = text.split_once('\n').unwrap_or_default();
        let known: Vec<&str> = first.split(',').collect();
        let places = places(&known, columns).map_err(|column| MetricsError::OtherColumn {
            path: path.to_owned(),
            column: column.chars().take(40).collect(),
        })?;
        let (kept, damage) = kept(rows, &known, &places, step);
        write_atomic(path, (header(columns) + &kept).as_bytes()).map_err(io)?;
        let writer = Self::over(path, OpenOptions::new().append(true).open(path), columns)?;
        Ok(Self { damage, ..writer })
    }

    /// What the file lost when it was gone on with, for a warning.
    pub fn damage(&self) -> Option<String> {
        self.damage.text(&self.path)
    }

    /// Appends the row of `step`: one value per column. What was not measured is NaN and leaves its cell empty.
    ///
    /// # Errors
    /// [`MetricsError::Io`].
    ///
    /// # Panics
    /// When there are not as many values as columns: that is a mistake of the caller, not of an input.
    pub fn append(&mut self, step: u64, values: &[f64]) -> Result<(), MetricsError> {
        use std::fmt::Write;
        assert_eq!(values.len(), self.columns, "a row has one value per column");
        self.row.clear();
        // Writing to a string does not fail.
        let _ = write!(self.row, "{step}");
        for value in values {
            let _ = if value.is_nan() {
                write!(self.row, ",")
            } else {
                write!(self.row, ",{value}")
            };
        }
        self.row.push('\n');
        self.flush_row()
    }

    fn over(path: &Path, file: io::Result<File>, columns: &[&str]) -> Result<Self, MetricsError> {
        let file = file.map_err(|why| MetricsError::Io {
            path: path.to_owned(),
            why,
        })?;
        Ok(Self {
            file,
            path: path.to_owned(),
            columns: columns.len(),
            row: String::new(),
            damage: Damage::default(),
        })
    }

    /// One write a row, so that whoever follows the file sees whole rows.
    fn flush_row(&mut self) -> Result<(), MetricsError> {
        let written = self.file.write_all(self.row.as_bytes());
        written.map_err(|why| MetricsError::Io {
            path: self.path.clone(),
            why,
        })
    }
}

fn header(columns: &[&str]) -> String {
    format!("step,{}\n", columns.join(","))
}

/// Where each of `columns` stands in a file with the header `known`, which begins with the step; the first column of it that is
/// none of them, or there twice.
fn places<'a>(known: &[&'a str], columns: &[&str]) -> Result<Vec<Option<usize>>, &'a str> {
    let wrong = known.iter().enumerate().find(|(at, name)| match at {
        0 => **name != "step",
        _ => !columns.contains(name) || known[..*at].contains(name),
    });
    let place = |column: &&str| known.iter().position(|name| name == column);
    wrong.map_or_else(|| Ok(columns.iter().map(place).collect()), |(_, name)| Err(*name))
}

/// Of `rows` those up to `step` with their cells at `places`, and what is damaged.
fn kept(rows: &str, known: &[&str], places: &[Option<usize>], step: u64) -> (String, Damage) {
    let (mut kept, mut damage, mut before) = (String::new(), Damage::default(), None);
    let whole = rows.split_inclusive('\n').filter_map(|row| row.strip_suffix('\n'));
    for (text, line) in whole.zip(2..) {
        match row(text, known.len() - 1, before).map(|(of, _)| of) {
            Ok(of) if of <= step => {
                kept.push_str(&rearranged(text, places));
                before = Some(of);
            }
            Ok(_) => {}
            Err(why) => damage.note(line, why),
        }
    }
    (kept, damage)
}

/// What is not text becomes a sign that no number has.
fn read_all(mut file: File) -> io::Result<String> {
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// The row, which ends with a new line then, with the cells at `places` after its step; empty where there is none.
fn rearranged(row: &str, places: &[Option<usize>]) -> String {
    let cells: Vec<&str> = row.split(',').collect();
    let cell = |place: &Option<usize>| place.map_or("", |place| cells[place]);
    let rest: String = places.iter().map(|place| format!(",{}", cell(place))).collect();
    format!("{}{rest}\n", cells[0])
}
