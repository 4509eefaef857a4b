//! `metrics.csv`: one row an update, the first column the step.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use thiserror::Error;

use super::atomic::write_atomic;

/// Longest row that is read, bytes.
const MAX_ROW_BYTES: u64 = 1 << 16;

/// Why `metrics.csv` cannot be written or read.
#[derive(Debug, Error, Diagnostic)]
pub enum MetricsError {
    /// The file system said no.
    #[error("cannot use {}: {why}", .path.display())]
    #[diagnostic(help("{}", super::remedy(.why)))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        why: io::Error,
    },
    /// The file has a column that this run does not write.
    #[error("{}:1: this run writes no column {column:?}", .path.display())]
    #[diagnostic(help("go on with the version of omniwalk that wrote it, or move the file away: it then begins anew"))]
    OtherColumn {
        /// The file.
        path: PathBuf,
        /// The column's name, shortened.
        column: String,
    },
    /// A row is not numbers, or not as many as there are columns.
    #[error("{}:{line}: {why}", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        why: String,
    },
}

/// Writes `metrics.csv` row by row.
#[derive(Debug)]
pub struct MetricsWriter {
    file: File,
    path: PathBuf,
    columns: usize,
    row: String,
    /// Lines of the rows that were left out because they are damaged.
    damaged: Vec<usize>,
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
        let text = match fs::read_to_string(path) {
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
        let (kept, damaged) = kept(rows, &known, &places, step);
        write_atomic(path, (header(columns) + &kept).as_bytes()).map_err(io)?;
        let writer = Self::over(path, OpenOptions::new().append(true).open(path), columns)?;
        Ok(Self { damaged, ..writer })
    }

    /// What the file lost when it was gone on with, for a warning.
    pub fn damage(&self) -> Option<String> {
        let (first, rows) = (self.damaged.first()?, self.damaged.len());
        let s = if rows == 1 { "" } else { "s" };
        let path = self.path.display();
        Some(format!(
            "{path}:{first}: damaged; {rows} such row{s} left out, the curves have a gap there"
        ))
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
            damaged: Vec::new(),
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

/// Of `rows` those up to `step` with their cells at `places`, and the lines of those that are damaged.
fn kept(rows: &str, known: &[&str], places: &[Option<usize>], step: u64) -> (String, Vec<usize>) {
    let (mut kept, mut damaged, mut before) = (String::new(), Vec::new(), None);
    let whole = rows.split_inclusive('\n').filter_map(|row| row.strip_suffix('\n'));
    for (row, line) in whole.zip(2..) {
        let cells = row.split(',').count() == known.len() && row.split(',').all(is_cell);
        match step_of(row).filter(|of| cells && before.is_none_or(|before| *of > before)) {
            Some(of) if of <= step => {
                kept.push_str(&rearranged(row, places));
                before = Some(of);
            }
            Some(_) => {}
            None => damaged.push(line),
        }
    }
    (kept, damaged)
}

/// The row, which ends with a new line then, with the cells at `places` after its step; empty where there is none.
fn rearranged(row: &str, places: &[Option<usize>]) -> String {
    let cells: Vec<&str> = row.split(',').collect();
    let cell = |place: &Option<usize>| place.map_or("", |place| cells[place]);
    let rest: String = places.iter().map(|place| format!(",{}", cell(place))).collect();
    format!("{}{rest}\n", cells[0])
}

/// Whether a cell is a number, or empty: others could not be read again.
fn is_cell(cell: &str) -> bool {
    cell.is_empty() || cell.parse::<f64>().is_ok()
}

fn step_of(row: &str) -> Option<u64> {
    row.split(',').next()?.parse().ok()
}

/// What is in a `metrics.csv`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics {
    /// Names of the columns after `step`.
    pub columns: Vec<String>,
    /// Number of rows.
    pub rows: usize,
    /// Step and values of the last row; NaN where a cell is empty.
    pub last: Option<(u64, Vec<f64>)>,
}

impl Metrics {
    /// Reads the file at `path` row by row.
    ///
    /// # Errors
    /// [`MetricsError::Io`], or [`MetricsError::Damaged`] for what is not the file of a run.
    pub fn read(path: &Path) -> Result<Self, MetricsError> {
        Self::scan(path, |_| {})
    }

    /// Reads the file at `path` and shows the metrics so far to `each` after every row.
    ///
    /// # Errors
    /// As [`Metrics::read`].
    pub fn scan(path: &Path, mut each: impl FnMut(&Self)) -> Result<Self, MetricsError> {
        let io = |why| MetricsError::Io {
            path: path.to_owned(),
            why,
        };
        let mut file = BufReader::new(File::open(path).map_err(io)?);
        let mut metrics = Self::default();
        let mut row = Vec::new();
        for line in 1.. {
            row.clear();
            if io::Read::take(&mut file, MAX_ROW_BYTES)
                .read_until(b'\n', &mut row)
                .map_err(io)?
                == 0
            {
                break;
            }
            let damaged = |why: &str| MetricsError::Damaged {
                path: path.to_owned(),
                line,
                why: why.to_owned(),
            };
            let text = std::str::from_utf8(&row).map_err(|_| damaged("this is not text"))?;
            let text = match text.strip_suffix('\n') {
                Some(text) => text,
                // A row that is being written, or that a kill cut off.
                None if line > 1 && (row.len() as u64) < MAX_ROW_BYTES => break,
                None => return Err(damaged("this row does not end")),
            };
            metrics.take(line, text).map_err(damaged)?;
            if line > 1 {
                each(&metrics);
            }
        }
        match metrics.columns.is_empty() {
            true => Err(MetricsError::Damaged {
                path: path.to_owned(),
                line: 1,
                why: "there is no header".to_owned(),
            }),
            false => Ok(metrics),
        }
    }

    fn take(&mut self, line: usize, row: &str) -> Result<(), &'static str> {
        let mut cells = row.split(',');
        let first = cells.next().unwrap_or_default();
        if line == 1 {
            self.columns = cells.map(str::to_owned).collect();
            return if first == "step" {
                Ok(())
            } else {
                Err("the first column of a run's metrics is `step`")
            };
        }
        let step = first.parse().map_err(|_| "the step is not a whole number")?;
        let value = |cell: &str| if cell.is_empty() { Ok(f64::NAN) } else { cell.parse() };
        let values: Vec<f64> = cells
            .map(value)
            .collect::<Result<_, _>>()
            .map_err(|_| "a cell is not a number")?;
        if values.len() != self.columns.len() {
            return Err("this row has another number of cells than the header");
        }
        if self.last.as_ref().is_some_and(|(before, _)| step <= *before) {
            return Err("the step is not after that of the row before");
        }
        self.rows += 1;
        self.last = Some((step, values));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_file_equals_an_uninterrupted_one() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a.csv"), folder.path().join("b.csv"));
        let write = |writer: &mut MetricsWriter, steps: std::ops::RangeInclusive<u64>| {
            steps.for_each(|step| writer.append(step * 100, &[step as f64 / 3.0, f64::NAN]).unwrap());
        };
        write(&mut MetricsWriter::create(&a, &["return", "gait"]).unwrap(), 1..=6);
        write(&mut MetricsWriter::create(&b, &["return", "gait"]).unwrap(), 1..=5);
        fs::OpenOptions::new()
            .append(true)
            .open(&b)
            .unwrap()
            .write_all(b"600,0.1")
            .unwrap();
        write(&mut MetricsWriter::resume(&b, &["return", "gait"], 300).unwrap(), 4..=6);
        assert_eq!(fs::read_to_string(&a).unwrap(), fs::read_to_string(&b).unwrap());
        let metrics = Metrics::read(&b).unwrap();
        assert_eq!(
            (metrics.rows, metrics.columns),
            (6, vec!["return".to_owned(), "gait".to_owned()])
        );
        let (step, values) = metrics.last.unwrap();
        assert_eq!((step, values[0]), (600, 2.0));
        assert!(values[1].is_nan());
    }

    #[test]
    fn other_columns_are_not_appended_to() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        MetricsWriter::create(&path, &["return"]).unwrap();
        assert!(matches!(
            MetricsWriter::create(&path, &["return"]),
            Err(MetricsError::Io { .. })
        ));
        let other = |columns: &[&str], named: &str| {
            let error = MetricsWriter::resume(&path, columns, 0).unwrap_err();
            assert!(
                matches!(&error, MetricsError::OtherColumn { column, .. } if column == named),
                "{error}"
            );
        };
        other(&["falls"], "return");
        other(&[], "return");
        fs::write(&path, "time,return\n1,2\n").unwrap();
        other(&["time", "return"], "time");
        fs::write(&path, "step,return,return\n1,2,3\n").unwrap();
        other(&["return", "falls"], "return");
    }

    #[test]
    fn a_file_that_an_older_program_began_gets_the_columns_that_were_added() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let mut old = MetricsWriter::create(&path, &["return", "falls"]).unwrap();
        old.append(1, &[0.1, f64::NAN]).unwrap();
        old.append(2, &[0.3, 4.0]).unwrap();
        fs::OpenOptions::new()
            .append(true)
            .open(&path)
            .unwrap()
            .write_all(b"3,zz,1\n2,0,1\n9,1,1\n")
            .unwrap();
        let mut new = MetricsWriter::resume(&path, &["level", "falls", "return"], 2).unwrap();
        // One that is no number, one that is there twice; not the one of a later step.
        assert_eq!(new.damaged, [4, 5]);
        assert!(new.damage().unwrap().contains("metrics.csv:4: damaged; 2 such rows"));
        new.append(3, &[0.5, 6.0, 0.7]).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text, "step,level,falls,return\n1,,,0.1\n2,,4,0.3\n3,0.5,6,0.7\n");
    }

    #[test]
    fn an_empty_file_is_begun_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        fs::write(&path, "").unwrap();
        MetricsWriter::resume(&path, &["a"], 5)
            .unwrap()
            .append(6, &[0.5])
            .unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "step,a\n6,0.5\n");
    }

    #[test]
    fn a_row_that_is_being_written_is_not_there_yet() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        fs::write(&path, "step,a,b\n1,2,3\n4,5").unwrap();
        let metrics = Metrics::read(&path).unwrap();
        assert_eq!((metrics.rows, metrics.last), (1, Some((1, vec![2.0, 3.0]))));
    }

    #[test]
    fn damaged_rows_are_named_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        for (text, says) in [
            ("", "metrics.csv:1: there is no header"),
            ("time,a\n", "metrics.csv:1: the first column"),
            ("step,a\n1,2\n3,x\n", "metrics.csv:3: a cell is not a number"),
            ("step,a\n1,2,3\n", "metrics.csv:2: this row has another number"),
            ("step,a\n1,2\n1,2\n", "metrics.csv:3: the step is not after"),
        ] {
            fs::write(&path, text).unwrap();
            let message = Metrics::read(&path).unwrap_err().to_string();
            assert!(message.contains(says), "{message} for {text:?}");
        }
    }
}
