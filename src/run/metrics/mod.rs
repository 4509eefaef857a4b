//! `metrics.csv`: one row an update, the first column the step.

mod read;
mod write;

use std::io;
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use thiserror::Error;

pub use read::Metrics;
pub use write::MetricsWriter;

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
    /// This is no header of a run's metrics, or a row has no end.
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

/// Rows that are not what training writes.
#[derive(Clone, Debug, Default, PartialEq)]
struct Damage {
    /// How many.
    rows: usize,
    /// Line of the first, from 1, and what is wrong with it.
    first: Option<(usize, &'static str)>,
}

impl Damage {
    fn note(&mut self, line: usize, why: &'static str) {
        self.rows += 1;
        self.first.get_or_insert((line, why));
    }

    /// A warning, if there is any in the file at `path`.
    fn text(&self, path: &Path) -> Option<String> {
        let ((line, why), path) = (self.first?, path.display());
        let rows = match self.rows {
            1 => "it is left out".to_owned(),
            rows => format!("it and {} other damaged rows are left out", rows - 1),
        };
        Some(format!("{path}:{line}: {why}; {rows}, and the curves have a gap there"))
    }
}

/// A row's step and cells, or what is wrong with it where rows have `cells` of them and the one before is of step `before`.
fn row(text: &str, cells: usize, before: Option<u64>) -> Result<(u64, impl Iterator<Item = f64>), &'static str> {
    let (step, rest) = text.split_once(',').unwrap_or((text, ""));
    let step = step.parse().map_err(|_| "the step is not a whole number")?;
    let values = move || rest.split(',').take(if text.contains(',') { usize::MAX } else { 0 });
    let value = |cell: &str| if cell.is_empty() { Ok(f64::NAN) } else { cell.parse() };
    if values().any(|cell| value(cell).is_err()) {
        return Err("a cell is not a number");
    }
    if values().count() != cells {
        return Err("this row has another number of cells than the header");
    }
    if before.is_some_and(|before| step <= before) {
        return Err("the step is not after that of the row before");
    }
    Ok((step, values().map(move |cell| value(cell).unwrap_or(f64::NAN))))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;

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
        let damage = new.damage().unwrap();
        assert!(
            damage.contains("metrics.csv:4: a cell is not a number; it and 1 other"),
            "{damage}"
        );
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
    fn what_is_no_metrics_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        for (text, says) in [
            ("", "metrics.csv:1: there is no header"),
            ("time,a\n", "metrics.csv:1: the first column"),
        ] {
            fs::write(&path, text).unwrap();
            let message = Metrics::read(&path).unwrap_err().to_string();
            assert!(message.contains(says), "{message} for {text:?}");
        }
    }

    #[test]
    fn damaged_rows_are_left_out_and_the_first_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        for (row, says) in [
            (&b"3,x"[..], "metrics.csv:3: a cell is not a number; it is left out"),
            (b"3,1,2", "metrics.csv:3: this row has another number"),
            (b"3", "metrics.csv:3: this row has another number"),
            (b"1,2", "metrics.csv:3: the step is not after"),
            (b"3.5,2", "metrics.csv:3: the step is not a whole"),
            (b"3,\xff", "metrics.csv:3: "),
        ] {
            let text = [b"step,a\n1,2\n", row, b"\n4,5\n"].concat();
            fs::write(&path, text).unwrap();
            let metrics = Metrics::read(&path).unwrap();
            assert_eq!((metrics.rows, metrics.last.clone()), (2, Some((4, vec![5.0]))));
            let read = metrics.damage().unwrap();
            let written = MetricsWriter::resume(&path, &["a"], 4).unwrap().damage().unwrap();
            assert!(read.contains(says) && written.contains(says), "{read}, {written}");
            assert_eq!(fs::read_to_string(&path).unwrap(), "step,a\n1,2\n4,5\n");
        }
    }
}
