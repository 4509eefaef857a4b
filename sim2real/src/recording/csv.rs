//! The wanted columns of a CSV file.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use ::csv::{ReaderBuilder, StringRecord, Trim};

use super::map::Map;
use super::table::{MAX_ROWS, Places, Table};
use super::{RecordingError, content};

/// Longest line of a header, bytes.
const MAX_HEADER_LINE: u64 = 1 << 20;
/// Most comment lines above the names.
const MAX_COMMENTS: u64 = 100_000;

/// Reads the columns that `map` wants from the file at `path`.
pub(super) fn read(path: &Path, map: &Map) -> Result<Table, RecordingError> {
    let unreadable = |error: io::Error| content(path, "the file", error.to_string(), "give a file that can be read");
    let mut input = BufReader::new(File::open(path).map_err(unreadable)?);
    let mut table = Table::new(map);
    let mut lines = Vec::new();
    let comments = comments(&mut input, &mut table).map_err(unreadable)?;
    let mut reader = ReaderBuilder::new()
        .delimiter(map.separator as u8)
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(Trim::All)
        .from_reader(input);
    let mut record = StringRecord::new();
    let mut names: Option<Vec<String>> = None;
    let mut columns = Vec::new();
    loop {
        let more = reader.read_record(&mut record).map_err(|error| {
            let line = comments + error.position().map_or(0, ::csv::Position::line);
            content(
                path,
                &format!("line {line}"),
                error.to_string(),
                "a CSV file is UTF-8 text with one row a line",
            )
        })?;
        if !more {
            break;
        }
        let line = comments + record.position().map_or(0, ::csv::Position::line);
        if names.is_none() {
            let found = header(&record, map.header);
            columns = wanted(path, &table, &found)?;
            names = Some(found);
            if map.header {
                continue;
            }
        }
        let known = names.as_ref().map_or(0, Vec::len);
        surplus(path, line, &record, known)?;
        if lines.len() >= MAX_ROWS {
            let why = format!("more than {MAX_ROWS} rows");
            return Err(content(path, &format!("line {line}"), why, "split the log"));
        }
        lines.push(line);
        fill(path, line, &record, &columns, &mut table)?;
    }
    table.places = Places::Lines(lines);
    Ok(table)
}

/// Takes the cells of a row into the columns of `table` that want them.
fn fill(
    path: &Path,
    line: u64,
    record: &StringRecord,
    columns: &[(usize, String)],
    table: &mut Table,
) -> Result<(), RecordingError> {
    let refused = |why: String, help: &str| content(path, &format!("line {line}"), why, help);
    table.begin_row();
    for (index, name) in columns {
        let cell = record.get(*index).ok_or_else(|| {
            let why = format!("the row ends before column `{name}`: it has {} cells", record.len());
            refused(why, "give every row as many cells as there are names")
        })?;
        let help = "write numbers with a point, and leave a cell empty where nothing was measured";
        table.put(name, cell).map_err(|why| refused(why, help))?;
    }
    Ok(())
}

/// Takes the comment lines at the start as fields; gives their number.
fn comments(input: &mut BufReader<File>, table: &mut Table) -> io::Result<u64> {
    if input.fill_buf()?.starts_with(b"\xef\xbb\xbf") {
        input.consume(3);
    }
    let mut count = 0;
    while input.fill_buf()?.first() == Some(&b'#') && count < MAX_COMMENTS {
        let mut line = Vec::new();
        input.by_ref().take(MAX_HEADER_LINE).read_until(b'\n', &mut line)?;
        let line = String::from_utf8_lossy(&line);
        let line = line.trim_start_matches('#').trim();
        if let Some((key, value)) = line.split_once([':', '=']) {
            table.field(key.trim(), value.trim());
        }
        count += 1;
    }
    Ok(count)
}

/// The names in the first row, or numbers from 1.
fn header(first: &StringRecord, has_names: bool) -> Vec<String> {
    let number = |(index, name): (usize, &str)| {
        if has_names {
            name.to_owned()
        } else {
            (index + 1).to_string()
        }
    };
    first.iter().enumerate().map(number).collect()
}

/// A row may end in empty cells, as separators at its end make; more values than names are of no column.
fn surplus(path: &Path, line: u64, record: &StringRecord, names: usize) -> Result<(), RecordingError> {
    if record.iter().skip(names).all(str::is_empty) {
        return Ok(());
    }
    let why = format!("the row has {} cells, and there are {names} names", record.len());
    let help = "write numbers with a point, not a comma, or name another `separator` in the map: what is left over belongs to no column";
    Err(content(path, &format!("line {line}"), why, help))
}

/// Position and name of each column that the table wants.
fn wanted(path: &Path, table: &Table, names: &[String]) -> Result<Vec<(usize, String)>, RecordingError> {
    let all: BTreeSet<&String> = table.numbers.keys().chain(table.texts.keys()).collect();
    let mut places: BTreeMap<&String, Vec<usize>> = BTreeMap::new();
    for (at, name) in names.iter().enumerate() {
        places.entry(name).or_default().push(at);
    }
    let refused = |why: String, help: &str| content(path, "the first row", why, help);
    let find = |name: &String| match places.get(name).map(Vec::as_slice) {
        Some([at]) => Ok((*at, name.clone())),
        Some([one, other, ..]) => Err(refused(
            format!("columns {} and {} are both called `{name}`", one + 1, other + 1),
            "give each column that the map names a name of its own",
        )),
        _ => {
            let known: Vec<&str> = names.iter().take(200).map(String::as_str).collect();
            let help = match known[..] {
                [one] if one.contains([';', '\t', ' ']) => {
                    format!(
                        "the file has one column, `{one}`: say with `separator = \";\"` in the map what is between its cells"
                    )
                }
                _ => format!("the file has {}", known.join(", ")),
            };
            Err(refused(format!("there is no column `{name}`"), &help))
        }
    };
    all.into_iter().map(find).collect()
}
