//! The commands that make an evaluation again, or play what is missing of it.

use serde_json::Value;

use crate::eval::suites::Suite;
use crate::terminal::quoted;

/// Smallest and largest command that a policy was trained for; not every configuration says.
pub struct Range(pub Option<[[f64; 3]; 2]>);

impl Range {
    /// The bounds in a run's configuration.
    pub fn of(config: &toml::Table) -> Self {
        let bound = |key: &str, axis: usize| config.get("command")?.get(key)?.get(axis)?.as_float();
        let bounds = |key: &str| Some([bound(key, 0)?, bound(key, 1)?, bound(key, 2)?]);
        let both = || Some([bounds("lower")?, bounds("upper")?]);
        Self(both())
    }

    fn holds(&self, command: &[f64; 3]) -> bool {
        let inside = |[lower, upper]: &[[f64; 3]; 2]| (0..3).all(|k| (lower[k]..=upper[k]).contains(&command[k]));
        self.0.as_ref().is_none_or(inside)
    }
}

/// The arguments with which `omniwalk eval` plays what the page has no pictures of yet, if there is something that a policy trained
/// for `range` can be asked.
pub fn missing(range: &Range, eval: Option<&Value>) -> Option<String> {
    let played = |suite: &str| eval.is_some_and(|eval| eval.get(suite).is_some());
    let suites = [Suite::Falls, Suite::Tracking, Suite::Push];
    let takes = |suite: &Suite| suite.commands().iter().all(|command| range.holds(command));
    if !suites.iter().all(takes) {
        return eval.is_none().then(String::new);
    }
    let open = suites.iter().map(|suite| suite.name()).filter(|name| !played(name));
    let open: Vec<&str> = open.collect();
    (!open.is_empty()).then(|| format!(" --suite {}", open.join(",")))
}

/// The command of the evaluation `eval` of the run or policy `subject`, from what it wrote.
pub fn evaluated_by(subject: &str, eval: &Value) -> String {
    let mut command = format!("omniwalk eval {subject}");
    if let Some(engine) = eval.get("engine").and_then(Value::as_str) {
        command += &format!(" --engine {engine}");
    }
    if let Some(seed) = eval.get("seed").and_then(Value::as_u64) {
        command += &format!(" --seed {seed}");
    }
    let words = |key: &str| {
        let list = eval.get(key).and_then(Value::as_array);
        list.into_iter().flatten().filter_map(Value::as_str)
    };
    let suites: Vec<&str> = words("suites").collect();
    if !suites.is_empty() {
        let forward = eval.get("forward").map(|_| "forward");
        let names: Vec<&str> = forward.into_iter().chain(suites).collect();
        command += &format!(" --suite {}", names.join(","));
    }
    let episodes = eval
        .get("episodes")
        .or_else(|| eval.pointer("/forward/rows/0/episodes"));
    if let Some(episodes) = episodes.and_then(Value::as_u64) {
        command += &format!(" --episodes {episodes}");
    }
    if let Some(seconds) = eval.get("seconds").and_then(Value::as_f64) {
        command += &format!(" --seconds {seconds}");
    }
    if eval.get("conditions").and_then(Value::as_str) == Some("nominal") {
        command += " --nominal";
    }
    for change in words("set") {
        command += &format!(" --set {}", quoted(change));
    }
    command
}
