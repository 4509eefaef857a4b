//! Describes a checkpoint.

use std::path::Path;

use serde_json::Value;

use crate::run::checkpoint::{Checkpoint, CheckpointError};
use crate::run::tensor::Data;

pub(super) fn describe(path: &Path) -> Result<String, CheckpointError> {
    let checkpoint = Checkpoint::read(path)?;
    let mut text = format!("checkpoint at step {}\n", checkpoint.step);
    if !checkpoint.metadata.is_empty() {
        text += "  metadata\n";
    }
    for (key, value) in &checkpoint.metadata {
        text += &match value {
            Value::Object(entries) => format!("    {key}: {} values\n", entries.len()),
            value => format!("    {key} = {value}\n"),
        };
    }
    text += &format!("  {} tensors\n", checkpoint.tensors.len());
    let width = checkpoint
        .tensors
        .keys()
        .map(|name| name.chars().count())
        .max()
        .unwrap_or(0);
    for (name, tensor) in &checkpoint.tensors {
        let shape = tensor
            .shape
            .iter()
            .map(usize::to_string)
            .collect::<Vec<_>>()
            .join(" x ");
        let shape = if shape.is_empty() { "scalar".to_owned() } else { shape };
        text += &format!(
            "    {name:<width$}  {} {shape}{}\n",
            tensor.data.kind(),
            range(&tensor.data)
        );
    }
    Ok(text)
}

/// Smallest and largest value of floating-point elements, and how many are not finite.
fn range(data: &Data) -> String {
    let values: Vec<f64> = match data {
        Data::F32(values) => values.iter().map(|&value| f64::from(value)).collect(),
        Data::F64(values) => values.clone(),
        Data::U64(_) | Data::U8(_) => return String::new(),
    };
    let finite = values.iter().copied().filter(|value| value.is_finite());
    let bad = values.len() - finite.clone().count();
    let mut text = match (finite.clone().reduce(f64::min), finite.reduce(f64::max)) {
        (Some(min), Some(max)) => format!(", from {min:.4e} to {max:.4e}"),
        _ => String::new(),
    };
    if bad > 0 {
        text += &format!(", {bad} NOT FINITE");
    }
    text
}
