//! What is special about a recording: labels to group it by, and parameters of the robot that are different in it.

use std::collections::BTreeMap;
use std::path::Path;

use super::map::{Label, Map, Number, Origin, Scaled};
use super::overrides;
use super::rows::Segment;
use super::table::number;
use super::{Recording, RecordingError, content};

/// Sets the groups and overrides that the map gives, from `fields` of the file and columns of `segment`.
pub(super) fn label(
    path: &Path,
    map: &Map,
    fields: &BTreeMap<String, String>,
    segment: Option<&Segment<'_>>,
    recording: &mut Recording,
) -> Result<(), RecordingError> {
    let field = |key: &str| {
        fields.get(key).ok_or_else(|| {
            let known: Vec<&str> = fields.keys().take(100).map(String::as_str).collect();
            let help = if known.is_empty() {
                "it has no header with fields: in CSV those are lines `# key: value` above the names".to_owned()
            } else {
                format!("its header has the fields {}", known.join(", "))
            };
            content(path, "the header", format!("there is no field `{key}`"), &help)
        })
    };
    let no_columns = || {
        content(
            path,
            "the map",
            "an MCAP file has no columns".into(),
            "use `field` with its metadata",
        )
    };
    for (group, from) in &map.groups {
        let text = match from {
            Label::Constant(text) => text.clone(),
            Label::From(Origin::Field(key)) => field(key)?.clone(),
            Label::From(Origin::Column(column)) => {
                let segment = segment.ok_or_else(no_columns)?;
                segment.constant(column, &segment.table.texts[column])?.clone()
            }
        };
        recording.groups.insert(group.clone(), text);
    }
    for (parameter, from) in &map.overrides {
        let value = match from.get_ref() {
            Number::Constant(value) => *value,
            Number::From(scaled) => {
                let raw = match (&scaled.field, &scaled.column) {
                    (Some(key), _) => number(field(key)?),
                    (None, Some(column)) => {
                        let segment = segment.ok_or_else(no_columns)?;
                        Some(*segment.constant(column, &segment.table.numbers[column])?)
                    }
                    (None, None) => None,
                };
                let value = raw
                    .map(|raw| raw * scaled.scale + scaled.offset)
                    .filter(|value| value.is_finite());
                let why = || format!("override `{parameter}` is no number here");
                let place = place(scaled);
                let value =
                    value.ok_or_else(|| content(path, &place, why(), "name a field or column with a finite number"))?;
                possible(path, &place, parameter, value)?;
                value
            }
        };
        recording.overrides.insert(parameter.clone(), value);
    }
    Ok(())
}

/// Where in a file a number is.
fn place(scaled: &Scaled) -> String {
    match (&scaled.field, &scaled.column) {
        (Some(key), _) => format!("the header, field `{key}`"),
        (None, Some(column)) => format!("column `{column}`"),
        (None, None) => "the header".to_owned(),
    }
}

/// That the parameter `key` can have `value`, which stands at `place`.
pub(super) fn possible(path: &Path, place: &str, key: &str, value: f64) -> Result<(), RecordingError> {
    overrides::right_instead(key, value).map_or(Ok(()), |right| {
        let why = format!("override `{key}` cannot be {value}");
        Err(content(path, place, why, &right))
    })
}
