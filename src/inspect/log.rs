//! Describes an MCAP log: what is on which topic, how often and how long.

use std::collections::BTreeMap;
use std::path::Path;

use omniwalk_sim2real::log::{LogError, LogReader, Message};

/// What is known of a topic.
struct Topic {
    schema: String,
    count: u64,
    first: u64,
    last: u64,
    /// Names of the joints in its first message, if it has joints.
    joints: Vec<String>,
}

pub(super) fn describe(path: &Path) -> Result<String, LogError> {
    let mut topics: BTreeMap<String, Topic> = BTreeMap::new();
    let mut log = LogReader::open(path)?;
    for entry in log.by_ref() {
        let entry = entry?;
        let topic = topics.entry(entry.topic).or_insert_with(|| Topic {
            schema: entry.schema,
            count: 0,
            first: entry.time,
            last: entry.time,
            joints: joints(entry.message),
        });
        topic.count += 1;
        topic.first = topic.first.min(entry.time);
        topic.last = topic.last.max(entry.time);
    }
    let first = topics.values().map(|topic| topic.first).min().unwrap_or(0);
    let last = topics.values().map(|topic| topic.last).max().unwrap_or(0);
    let mut text = format!("log: {:.3} s, {} topics\n", seconds(last - first), topics.len());
    for (name, topic) in &topics {
        text += &format!("  {name} ({}): {} messages", topic.schema, topic.count);
        let span = seconds(topic.last - topic.first);
        if span > 0.0 {
            let rate = (topic.count - 1) as f64 / span;
            let from = seconds(topic.first - first);
            text += &format!(", {rate:.1} Hz, from {from:.3} s to {:.3} s", from + span);
        }
        text += "\n";
        if !topic.joints.is_empty() {
            text += &format!("    joints: {}\n", topic.joints.join(", "));
        }
    }
    for (name, entries) in log.metadata() {
        text += &format!("  metadata {name}\n");
        entries
            .iter()
            .for_each(|(key, value)| text += &format!("    {key} = {value}\n"));
    }
    Ok(text)
}

fn joints(message: Option<Message>) -> Vec<String> {
    match message {
        Some(Message::JointStates(joints) | Message::JointCommands(joints)) => joints.name,
        _ => Vec::new(),
    }
}

fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 * 1e-9
}
