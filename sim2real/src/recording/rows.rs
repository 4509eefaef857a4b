//! From a table of rows to recordings, by the column map.

use std::ops::Range;
use std::path::Path;

use toml::Spanned;

use super::columns::{Column, JointColumns};
use super::labels::label;
use super::map::Map;
use super::repeats::fresh;
use super::table::Table;
use super::{CommandKind, JointRecord, Recording, RecordingError, Series, content, sender};

/// Joints of all segments of a file together: a thousand recordings of a humanoid.
const MAX_RECORDS: usize = 100_000;

/// Makes the recordings that `table` holds; the file at `path` is called `name`.
pub(super) fn recordings(path: &Path, name: &str, map: &Map, table: &Table) -> Result<Vec<Recording>, RecordingError> {
    let time = map.time.as_ref().map(Spanned::get_ref).ok_or_else(|| {
        let help = "add `time = { column = \"...\", unit = \"s\" }` to the map";
        content(path, "the file", "the map names no time column".into(), help)
    })?;
    let count = table.numbers.get(&time.column).map_or(0, Vec::len);
    if count == 0 {
        return Err(content(
            path,
            "the file",
            "it has no rows".into(),
            "give a log with rows",
        ));
    }
    let segments = segments(map, table, count);
    let joints: usize = map.joint.iter().map(|joint| joint.get_ref().names.len()).sum();
    if segments.len().saturating_mul(joints) > MAX_RECORDS {
        let why = format!("{} segments of {joints} joints", segments.len());
        let help = "`segment` names a column that stays the same for a whole recording";
        return Err(content(path, "the file", why, help));
    }
    segments
        .into_iter()
        .map(|(label, rows)| {
            let segment = Segment { path, map, table, rows };
            let name = label.map_or_else(|| name.to_owned(), |label| format!("{name}:{label}"));
            segment.recording(name, time)
        })
        .collect()
}

/// Label and rows of each segment.
fn segments(map: &Map, table: &Table, count: usize) -> Vec<(Option<String>, Range<usize>)> {
    let Some(labels) = map.segment.as_ref().and_then(|column| table.texts.get(column)) else {
        return vec![(None, 0..count)];
    };
    let mut segments: Vec<(Option<String>, Range<usize>)> = Vec::new();
    for (row, label) in labels.iter().enumerate() {
        match segments.last_mut() {
            Some((last, rows)) if last.as_ref() == Some(label) => rows.end = row + 1,
            _ => segments.push((Some(label.clone()), row..row + 1)),
        }
    }
    segments
}

/// Rows of a table that belong to one recording.
pub(super) struct Segment<'a> {
    path: &'a Path,
    map: &'a Map,
    pub table: &'a Table,
    rows: Range<usize>,
}

impl Segment<'_> {
    fn recording(&self, name: String, time: &Column) -> Result<Recording, RecordingError> {
        let clock = self.clock(time)?;
        let mut recording = Recording {
            name,
            ..Recording::default()
        };
        let mut unclear: Option<f64> = None;
        for joints in self.map.joint.iter().map(Spanned::get_ref) {
            for name in &joints.names {
                let (joint, within) = self.joint(joints, name, &clock);
                recording.joints.push(joint);
                unclear = unclear.or(within);
            }
        }
        recording.notes.extend(unclear.map(between_rows));
        if let Some(voltage) = &self.map.voltage {
            recording.voltage = self.series(&clock, voltage.get_ref(), "", None);
        }
        label(self.path, self.map, &self.table.fields, Some(self), &mut recording)?;
        Ok(recording)
    }

    /// Times of the rows, s from the first.
    fn clock(&self, column: &Column) -> Result<Vec<f64>, RecordingError> {
        let raw = self.numbers(&column.column);
        // The raw difference first: nanoseconds since 1970 do not fit a double, their differences do.
        let start = raw.first().copied().unwrap_or_default();
        let relative = Column {
            offset: 0.0,
            signed_bits: None,
            ..column.clone()
        };
        let clock: Vec<f64> = raw.iter().map(|raw| relative.value(raw - start)).collect();
        for (index, time) in clock.iter().enumerate() {
            let before = if index == 0 { *time } else { clock[index - 1] };
            let why = if time.is_finite() && *time >= before {
                continue;
            } else if time.is_finite() {
                format!(
                    "column `{}`: time goes backwards: {time:.6} s after {before:.6} s, from the start",
                    column.column
                )
            } else {
                format!("column `{}`: the row has no time", column.column)
            };
            let help = "time increases from row to row; name a `segment` column if the file holds several logs";
            return Err(content(
                self.path,
                &self.table.place(self.rows.start + index),
                why,
                help,
            ));
        }
        match clock[..] {
            [first, .., last] if last <= first && self.map.segment.is_none() => {
                let why = format!("column `{}`: the time is the same in every row", column.column);
                let help = "name the column that says when each row was read, with its unit";
                Err(content(self.path, &self.table.place(self.rows.start), why, help))
            }
            _ => Ok(clock),
        }
    }

    /// A joint, and within which time its targets were given, s, where rows do not say when.
    fn joint(&self, columns: &JointColumns, name: &str, clock: &[f64]) -> (JointRecord, Option<f64>) {
        let measured = [&columns.position, &columns.velocity, &columns.effort];
        let measured: Vec<&[f64]> = measured
            .into_iter()
            .flatten()
            .map(|column| self.numbers(&column.get_ref().of(name)))
            .collect();
        let position = columns.position.as_ref().map(Spanned::get_ref);
        let position = position.map(|column| self.numbers(&column.of(name)));
        let fresh = position.map_or_else(|| vec![true; clock.len()], |position| fresh(position, &measured));
        let series = |column: &Option<Spanned<Column>>, fresh| {
            let column = column.as_ref().map(Spanned::get_ref);
            column
                .map(|column| self.series(clock, column, name, fresh))
                .unwrap_or_default()
        };
        let extra = columns.extra.iter();
        let mut enabled: Series = series(&columns.enabled, None);
        enabled
            .value
            .iter_mut()
            .for_each(|value| *value = f64::from(u8::from(*value != 0.0)));
        let command = series(&columns.command, None);
        let sent = sender::between(&command);
        let within = sent.as_ref().map(|sent| sent.within);
        let (command, otherwise) =
            sent.map_or_else(|| (command, Series::default()), |sent| (sent.likely, sent.otherwise));
        let joint = JointRecord {
            name: name.to_owned(),
            command_kind: columns
                .command
                .as_ref()
                .map_or(CommandKind::Position, |column| column.get_ref().command_kind()),
            command,
            otherwise,
            position: series(&columns.position, Some(&fresh)),
            velocity: series(&columns.velocity, Some(&fresh)),
            effort: series(&columns.effort, Some(&fresh)),
            enabled,
            extra: extra
                .map(|(key, column)| (key.clone(), self.series(clock, column.get_ref(), name, None)))
                .collect(),
            repeated: fresh.iter().filter(|fresh| !**fresh).count(),
            outliers: 0,
            missing: position.map_or(0, |position| {
                position.iter().filter(|position| !position.is_finite()).count()
            }),
        };
        (joint, within)
    }

    /// The finite values of a column, of those rows that are wanted; of equal times the first counts.
    fn series(&self, clock: &[f64], column: &Column, joint: &str, wanted: Option<&[bool]>) -> Series {
        let mut series = Series::default();
        for (row, (&time, &raw)) in clock.iter().zip(self.numbers(&column.of(joint))).enumerate() {
            let value = column.value(raw);
            let later = series.time.last().is_none_or(|last| time > *last);
            if value.is_finite() && later && wanted.is_none_or(|wanted| wanted[row]) {
                series.push(time, value);
            }
        }
        series
    }

    fn numbers(&self, column: &str) -> &[f64] {
        self.table
            .numbers
            .get(column)
            .map_or(&[], |values| &values[self.rows.clone()])
    }

    /// The one value of a column.
    pub fn constant<'t, T: PartialEq + ToString>(
        &self,
        column: &str,
        values: &'t [T],
    ) -> Result<&'t T, RecordingError> {
        let first = &values[self.rows.start];
        match self.rows.clone().find(|&row| values[row] != *first) {
            None => Ok(first),
            Some(row) => {
                let why = format!(
                    "column `{column}` changes from {} to {}",
                    first.to_string(),
                    values[row].to_string()
                );
                let help = "a label or an override holds for a whole recording; name the column as `segment` as well";
                Err(content(self.path, &self.table.place(row), why, help))
            }
        }
    }
}

/// What had to be assumed of targets that were given some time `within` (s) before the row that they first stand in.
fn between_rows(within: f64) -> String {
    format!(
        "targets are of another clock than the rows: each was given some time in the {:.1} ms before the row it first stands in. Where many \
         follow each other that is worked out, and what is left open counts as noise; give targets rows of their own, with their time and the \
         other cells empty, or record MCAP",
        1000.0 * within
    )
}
