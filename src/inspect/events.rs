//! Describes a TensorBoard event file.

use std::collections::BTreeMap;
use std::path::Path;

use super::InspectError;
use crate::run::events::{EventReader, What};

pub(super) fn describe(path: &Path) -> Result<String, InspectError> {
    let io = |why| InspectError::Io {
        path: path.to_owned(),
        why,
    };
    let mut scalars: BTreeMap<String, (usize, i64, f32)> = BTreeMap::new();
    let mut events = 0;
    for event in EventReader::open(path).map_err(io)? {
        let event = event.map_err(io)?;
        events += 1;
        let Some(What::Summary(summary)) = event.what else {
            continue;
        };
        for value in summary.value {
            let Some(scalar) = value.simple_value else { continue };
            let entry = scalars.entry(value.tag).or_default();
            *entry = (entry.0 + 1, event.step, scalar);
        }
    }
    if events == 0 {
        return Err(InspectError::Damaged {
            path: path.to_owned(),
            why: "no TensorBoard events: not even the record that every file of them begins with".to_owned(),
        });
    }
    let mut text = format!("TensorBoard events: {events} records, {} scalars\n", scalars.len());
    let width = scalars.keys().map(|tag| tag.chars().count()).max().unwrap_or(0);
    for (tag, (count, step, last)) in scalars {
        text += &format!("  {tag:<width$}  {count} values, last {last:.6} at step {step}\n");
    }
    Ok(text)
}
