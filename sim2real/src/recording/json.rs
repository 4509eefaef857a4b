//! The wanted columns of a JSON file, without holding the rest of it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::{fmt, mem};

use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::map::Map;
use super::table::{MAX_ROWS, Table};
use super::{RecordingError, content};

/// Reads the columns that `map` wants from the file at `path`.
pub(super) fn read(path: &Path, map: &Map) -> Result<Table, RecordingError> {
    let refused = |place: &str, why: String, help: &str| content(path, place, why, help);
    let file =
        File::open(path).map_err(|error| refused("the file", error.to_string(), "give a file that can be read"))?;
    let mut sink = Sink {
        given: map
            .columns()
            .into_iter()
            .chain(map.text_columns())
            .map(|name| (name, 0))
            .collect(),
        table: Table::new(map),
        rows_at: map.rows.clone(),
        columns: Vec::new(),
    };
    let mut json = serde_json::Deserializer::from_reader(BufReader::new(file));
    let walk = Walk {
        sink: &mut sink,
        path: String::new(),
        place: Place::Header,
    };
    let whole = walk.deserialize(&mut json).and_then(|()| json.end());
    whole.map_err(|error| {
        let place = format!("line {}, column {}", error.line(), error.column());
        let text = error.to_string();
        let why = text.split(" at line ").next().unwrap_or(&text).to_owned();
        refused(&place, why, "JSON of numbers; where nothing was measured write null")
    })?;
    sink.finish().map_err(|(why, help)| refused("the file", why, &help))
}

/// What is being filled.
struct Sink {
    table: Table,
    /// Dotted path of the list of rows; without it each column is a list.
    rows_at: Option<String>,
    /// Columns that are lists, as they are met.
    columns: Vec<String>,
    /// The last row, counted from 1, that gave a column.
    given: BTreeMap<String, usize>,
}

/// Where in the file a value is.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    Header,
    Row,
    Column,
}

/// Reads one value at `path`.
struct Walk<'s> {
    sink: &'s mut Sink,
    path: String,
    place: Place,
}

impl Sink {
    fn wants(&self, column: &str) -> bool {
        self.table.numbers.contains_key(column) || self.table.texts.contains_key(column)
    }

    /// Whether a wanted column lies at or below `path` of a row.
    fn wants_below(&self, path: &str) -> bool {
        let below = |column: &String| {
            let rest = column.strip_prefix(path);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        self.table.numbers.keys().chain(self.table.texts.keys()).any(below)
    }

    fn finish(self) -> Result<Table, (String, String)> {
        if let Some(rows_at) = &self.rows_at {
            if self.table.rows == 0 {
                let why = format!("there are no rows at `{rows_at}`");
                return Err((why, "`rows` in the map is the key of a list of rows".into()));
            }
            let missing = self
                .table
                .numbers
                .iter()
                .find(|(_, values)| values.iter().all(|value| value.is_nan()));
            let help = "check the column names in the map";
            if let Some((name, _)) = missing {
                return Err((format!("no row has a number in `{name}`"), help.into()));
            }
            let mut texts = self.table.texts.iter();
            if let Some((name, _)) = texts.find(|(_, values)| values.iter().all(String::is_empty)) {
                return Err((format!("no row has a text in `{name}`"), help.into()));
            }
            return Ok(self.table);
        }
        let missing = self
            .table
            .numbers
            .keys()
            .chain(self.table.texts.keys())
            .find(|name| !self.columns.contains(name));
        if let Some(name) = missing {
            let help = "without `rows` in the map, each column is a list; for a list of rows name it there".into();
            return Err((format!("there is no list `{name}`"), help));
        }
        let numbers = self.table.numbers.iter().map(|(name, values)| (name, values.len()));
        let lengths: Vec<(&String, usize)> = numbers
            .chain(self.table.texts.iter().map(|(name, values)| (name, values.len())))
            .collect();
        if let Some(pair) = lengths.windows(2).find(|pair| pair[0].1 != pair[1].1) {
            let [(a, of_a), (b, of_b)] = [pair[0], pair[1]];
            let why = format!("`{a}` has {of_a} values and `{b}` has {of_b}");
            return Err((why, "columns are equally long".into()));
        }
        Ok(self.table)
    }
}

impl Walk<'_> {
    /// What is below `key` of an object or list; paths of a row start at the row.
    fn child(&mut self, key: &str) -> Walk<'_> {
        let separator = if self.path.is_empty() { "" } else { "." };
        Walk {
            path: format!("{}{separator}{key}", self.path),
            place: self.place,
            sink: self.sink,
        }
    }

    /// An entry of a column that is a list, or of the list of rows.
    fn entry(&mut self, path: String, place: Place) -> Walk<'_> {
        Walk {
            sink: self.sink,
            path,
            place,
        }
    }

    fn scalar<E: Error>(self, text: &str) -> Result<(), E> {
        match self.place {
            Place::Header => self.sink.table.field(&self.path, text),
            Place::Row => {
                let rows = self.sink.table.rows;
                let row = rows.saturating_sub(1);
                if self.sink.given.get_mut(&self.path).map(|last| mem::replace(last, rows)) == Some(rows) {
                    return Err(E::custom(format_args!("row {row} gives `{}` twice", self.path)));
                }
                let put = self.sink.table.put(&self.path, text);
                put.map_err(|why| E::custom(format_args!("row {row}: {why}")))?;
            }
            Place::Column => self.append(text)?,
        }
        Ok(())
    }

    /// Adds to a column that is a list.
    fn append<E: Error>(self, text: &str) -> Result<(), E> {
        let table = &mut self.sink.table;
        if let Some(values) = table.numbers.get_mut(&self.path) {
            values.push(f64::NAN);
        }
        if let Some(values) = table.texts.get_mut(&self.path) {
            values.push(String::new());
        }
        table.put(&self.path, text).map_err(E::custom)
    }
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, a text, a list or an object")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        self.scalar(if value { "true" } else { "false" })
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.scalar(&value.to_string())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        self.scalar(&value.to_string())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        // Rust prints the shortest text that reads back as the same number.
        self.scalar(&value.to_string())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<(), E> {
        self.scalar(value)
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        self.scalar("")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut access: A) -> Result<(), A::Error> {
        while let Some(key) = access.next_key::<String>()? {
            if self.place == Place::Column {
                return Err(A::Error::custom(format_args!(
                    "`{}` holds objects, not numbers",
                    self.path
                )));
            }
            let child = self.child(&key);
            if child.place == Place::Row && !child.sink.wants_below(&child.path) {
                access.next_value::<IgnoredAny>()?;
            } else {
                access.next_value_seed(child)?;
            }
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut access: A) -> Result<(), A::Error> {
        let is_rows = self.place == Place::Header && self.sink.rows_at.as_ref() == Some(&self.path);
        let is_column = self.place == Place::Header && self.sink.rows_at.is_none() && self.sink.wants(&self.path);
        let again = (is_rows && self.sink.table.rows > 0) || (is_column && self.sink.columns.contains(&self.path));
        if again {
            return Err(A::Error::custom(format_args!(
                "the list `{}` is there twice",
                self.path
            )));
        }
        if is_column {
            self.sink.columns.push(self.path.clone());
        }
        let mut index = 0;
        loop {
            let more = if is_rows {
                self.sink.table.begin_row();
                access
                    .next_element_seed(self.entry(String::new(), Place::Row))?
                    .is_some()
            } else if is_column {
                let path = self.path.clone();
                access.next_element_seed(self.entry(path, Place::Column))?.is_some()
            } else if self.place == Place::Row {
                access.next_element_seed(self.child(&index.to_string()))?.is_some()
            } else {
                access.next_element::<IgnoredAny>()?.is_some()
            };
            if !more {
                break;
            }
            index += 1;
            if index > MAX_ROWS {
                return Err(A::Error::custom(format_args!("more than {MAX_ROWS} rows")));
            }
        }
        if is_rows {
            // The row that was begun for the end of the list.
            self.sink.table.drop_row();
        }
        Ok(())
    }
}
