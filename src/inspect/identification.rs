//! Describes what `omniwalk identify` wrote: its `report.json`.

use std::path::Path;

use serde_json::Value;

use super::{InspectError, read};
use crate::report::identification::figure;

/// Largest report that is read, bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Effects, sets and joints that are listed.
const LISTED: usize = 40;
/// Longest word that is shown, characters.
const LONGEST: usize = 200;

/// Whether the file at `path` is such a report.
pub(super) fn is_one(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == "report.json")
}

pub(super) fn describe(path: &Path) -> Result<String, InspectError> {
    let damaged = |why: String| InspectError::Damaged {
        path: path.to_owned(),
        why,
    };
    let report: Value = serde_json::from_slice(&read(path, MAX_BYTES)?).map_err(|error| damaged(error.to_string()))?;
    let (Some(robot), Some(verdict)) = (report["robot"].as_str(), report["verdict"].as_str()) else {
        let why = "no report of an identification: it does not say robot and verdict";
        return Err(damaged(why.to_owned()));
    };
    let mut text = format!("identification of {}: {}\n", short(robot), short(verdict));
    for reason in list(&report["reasons"]) {
        text += &format!("  {}\n", word(reason));
    }
    for effect in list(&report["accepted"]) {
        text += &format!("  {} of {}\n", word(&effect["effect"]), word(&effect["target"]));
        for (name, parameter) in effect["parameters"].as_object().into_iter().flatten().take(LISTED) {
            text += &format!("    {} = {}\n", short(name), value(parameter));
        }
    }
    for set in list(&report["indistinguishable"]) {
        let names: Vec<String> = list(set).map(word).collect();
        text += &format!("  cannot be told apart: {}\n", names.join(", "));
    }
    let over: Vec<String> = list(&report["unexplained"]["depends_on"]).map(word).collect();
    if !over.is_empty() {
        text += &format!("  what effects leave depends on {}\n", over.join(", "));
    }
    for table in list(&report["tables"]) {
        let (over, joint) = (word(&table["over"]), word(&table["joint"]));
        text += &format!("  in the robot, a measured table over {over}, on {joint}\n");
    }
    let error = |model: &str| number(&report[model]["heldout"]["rmse"]["overall"]);
    text += &format!(
        "  position error on held-out logs: nominal {}, re-tuned {}, final {}; noise floor {}\n",
        error("nominal"),
        error("refit"),
        error("final"),
        number(&report["noise_floor"]["value"])
    );
    Ok(text)
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten().take(LISTED)
}

fn word(value: &Value) -> String {
    short(value.as_str().unwrap_or("-"))
}

fn short(text: &str) -> String {
    text.chars().take(LONGEST).collect()
}

fn number(value: &Value) -> String {
    figure(value.as_f64().unwrap_or(f64::NAN))
}

/// A parameter with its unit and interval.
fn value(parameter: &Value) -> String {
    let mut text = format!("{} {}", number(&parameter["value"]), word(&parameter["unit"]));
    if let [low, high] = list(&parameter["ci95"]).collect::<Vec<_>>().as_slice() {
        text += &format!(" ({} to {})", number(low), number(high));
    }
    text
}
