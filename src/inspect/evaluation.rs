//! Describes an evaluation, the `eval.json` of a run.

use std::path::Path;

use serde_json::Value;

use super::{InspectError, read};
use crate::eval::suites;
use crate::report::evaluation::{Evaluation, MAX_BYTES};

/// Longest name that is shown, characters.
const LONGEST: usize = 200;
/// Most of anything that is counted, but for steps.
const MOST: u64 = 1_000_000_000;
/// Most steps of a training.
const MOST_STEPS: u64 = 1_000_000_000_000_000;

pub(super) fn describe(path: &Path) -> Result<String, InspectError> {
    let damaged = |why: String| InspectError::Damaged {
        path: path.to_owned(),
        why,
    };
    let result: Value = serde_json::from_slice(&read(path, MAX_BYTES)?).map_err(|error| damaged(error.to_string()))?;
    let word = |key: &str| result.get(key).and_then(Value::as_str);
    let (Some(policy), Some(robot), Some(engine), Some(conditions)) =
        (word("policy"), word("robot"), word("engine"), word("conditions"))
    else {
        let why = "no evaluation: it does not say policy, robot, engine and conditions";
        return Err(damaged(why.to_owned()));
    };
    Evaluation::read(&result).map_err(|error| damaged(error.to_string()))?;
    if let Some(word) = [policy, robot, engine, conditions]
        .into_iter()
        .find(|word| word.chars().count() > LONGEST)
    {
        let start: String = word.chars().take(LONGEST / 4).collect();
        return Err(damaged(format!(
            "a name in it has more than {LONGEST} characters: {start}..."
        )));
    }
    if let Some(what) = absurd(&result) {
        return Err(damaged(what));
    }
    let count = |key: &str| result.get(key).and_then(Value::as_u64);
    let mut text = format!("evaluation of {policy}");
    text += &count("steps").map_or_else(String::new, |steps| format!(" after {steps} steps"));
    text += &format!("\n  robot {robot}, engine {engine}, {conditions} conditions");
    text += &count("seed").map_or_else(String::new, |seed| format!(", seed {seed}"));
    text += "\n";
    for name in ["forward"].into_iter().chain(suites::ALL.map(suites::Suite::name)) {
        if let Some(suite) = result.get(name) {
            text += &format!("  {name}: {}\n", played(suite));
        }
    }
    Ok(text)
}

/// A count that no evaluation has.
fn absurd(result: &Value) -> Option<String> {
    let of_suite = |key: &'static str| {
        result
            .as_object()
            .into_iter()
            .flatten()
            .map(move |(_, suite)| (key, suite.get(key)))
    };
    let counts = ["survived", "total"].into_iter().flat_map(of_suite);
    let counts = counts.map(|(key, count)| (key, count, MOST));
    let mut counts = counts.chain([("steps", result.get("steps"), MOST_STEPS)]);
    let wrong = counts.find(|(_, count, most)| count.is_some_and(|count| count.as_u64().is_none_or(|n| n > *most)));
    wrong.map(|(key, _, most)| format!("`{key}` is no number from 0 to {most}"))
}

/// How much of a suite was played, and how it ended.
fn played(suite: &Value) -> String {
    let count = |value: &Value, key: &str| value.get(key).and_then(Value::as_u64);
    let rows = suite
        .get("rows")
        .and_then(Value::as_array)
        .map_or(&[][..], Vec::as_slice);
    let sum = |key: &str| {
        let counts = rows.iter().filter_map(|row| count(row, key));
        counts.fold(0, u64::saturating_add)
    };
    let mut parts = Vec::new();
    if !rows.is_empty() {
        parts.push(format!("{} rows", rows.len()));
    }
    if rows.iter().any(|row| row.get("falls").is_some()) {
        parts.push(format!("{} of {} episodes fall", sum("falls"), sum("episodes")));
    }
    if let (Some(survived), Some(total)) = (count(suite, "survived"), count(suite, "total")) {
        parts.push(format!("{survived} of {total} survive"));
    }
    parts.join(", ")
}
