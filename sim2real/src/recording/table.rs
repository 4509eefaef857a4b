//! The wanted columns of a file of rows, before they mean anything.

use std::collections::{BTreeMap, BTreeSet};

use super::map::Map;

/// Rows that a file may have: a day at 1 kHz.
pub(super) const MAX_ROWS: usize = 100_000_000;
/// Fields of a header that are kept, and characters of one.
pub(super) const MAX_FIELDS: usize = 10_000;
pub(super) const MAX_FIELD_CHARS: usize = 10_000;

/// Columns of numbers and of texts, all equally long.
#[derive(Debug, Default)]
pub(super) struct Table {
    /// By name; NaN where a row gives no value.
    pub numbers: BTreeMap<String, Vec<f64>>,
    /// By name; empty where a row gives no text.
    pub texts: BTreeMap<String, Vec<String>>,
    /// Columns of numbers that may hold true or false.
    truths: BTreeSet<String>,
    /// What the file says before or beside its rows.
    pub fields: BTreeMap<String, String>,
    /// Where each row is: a line of the file, or a number of the row.
    pub places: Places,
    /// Rows that were begun.
    pub rows: usize,
}

/// How rows are called in errors.
#[derive(Debug, Default)]
pub(super) enum Places {
    /// Line of each row, from 1.
    Lines(Vec<u64>),
    /// Rows are counted from 0.
    #[default]
    Rows,
}

impl Table {
    /// A table with the columns that `map` wants and no rows.
    pub fn new(map: &Map) -> Self {
        Self {
            numbers: map.columns().into_iter().map(|name| (name, Vec::new())).collect(),
            texts: map.text_columns().into_iter().map(|name| (name, Vec::new())).collect(),
            truths: map.truth_columns(),
            ..Self::default()
        }
    }

    /// The name of a row in errors.
    pub fn place(&self, row: usize) -> String {
        match &self.places {
            Places::Lines(lines) => format!("line {}", lines.get(row).copied().unwrap_or_default()),
            Places::Rows => format!("row {row}"),
        }
    }

    /// Starts a row without values.
    pub fn begin_row(&mut self) {
        self.rows += 1;
        self.numbers.values_mut().for_each(|column| column.push(f64::NAN));
        self.texts.values_mut().for_each(|column| column.push(String::new()));
    }

    /// Takes the last row away.
    pub fn drop_row(&mut self) {
        self.rows -= 1;
        self.numbers.values_mut().for_each(|column| column.truncate(self.rows));
        self.texts.values_mut().for_each(|column| column.truncate(self.rows));
    }

    /// Puts a text into the last row of a column that wants it.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn put(&mut self, column: &str, text: &str) -> Result<(), String> {
        if let Some(last) = self.numbers.get_mut(column).and_then(|values| values.last_mut()) {
            let truth = || truth(text).filter(|_| self.truths.contains(column));
            *last = number(text).or_else(truth).ok_or_else(|| no_number(column, text))?;
        }
        if let Some(last) = self.texts.get_mut(column).and_then(|values| values.last_mut()) {
            *last = shortened(text);
        }
        Ok(())
    }

    /// Keeps a field of the header; of very many or long ones only what fits.
    pub fn field(&mut self, key: &str, value: &str) {
        if self.fields.len() < MAX_FIELDS {
            self.fields.insert(shortened(key), shortened(value));
        }
    }
}

/// The number in a cell: NaN for an empty one; `None` if it is none, or infinite.
pub(super) fn number(text: &str) -> Option<f64> {
    match text.trim() {
        "" | "null" | "None" | "NA" | "-" => Some(f64::NAN),
        text => text.parse().ok().filter(|number: &f64| !number.is_infinite()),
    }
}

/// 0 or 1 for a truth value.
fn truth(text: &str) -> Option<f64> {
    match text.trim() {
        "true" | "True" | "TRUE" => Some(1.0),
        "false" | "False" | "FALSE" => Some(0.0),
        _ => None,
    }
}

fn no_number(column: &str, text: &str) -> String {
    let only = match truth(text) {
        Some(_) => ": only columns of `enabled` and `extra` may be true or false",
        None => "",
    };
    format!("column `{column}`: `{}` is no number{only}", shortened(text))
}

fn shortened(text: &str) -> String {
    text.chars().take(MAX_FIELD_CHARS).collect()
}
