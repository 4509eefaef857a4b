//! `report.html`: pictures, evaluation and configuration of runs as one file that needs no other.

use std::fmt::Write as _;

use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::Value;

/// How pages look.
pub const STYLE: &str = "body{font:16px/1.5 sans-serif;max-width:80rem;margin:2rem auto;padding:0 1rem;color:#282c34}\
    img{max-width:100%}table{border-collapse:collapse;display:block;overflow-x:auto}td,th{padding:.2rem .8rem;text-align:right;border-bottom:1px solid \
    #ddd}pre{background:#f4f5f7;padding:1rem;overflow:auto}\
    .warning{background:#fdecea;border-left:4px solid #c62828;padding:.5rem 1rem}";

/// Columns of the evaluation tables: title and JSON pointer into a row. A table has those that one of its rows has.
const COLUMNS: [(&str, &str); 16] = [
    ("push from the", "/direction"),
    ("all recovered, N", "/all_ten_n"),
    ("any recovered, N", "/max_n"),
    ("falls", "/falls"),
    ("episodes", "/episodes"),
    ("v x, m/s", "/velocity/0"),
    ("v y, m/s", "/velocity/1"),
    ("turning, rad/s", "/velocity/2"),
    ("error, m/s", "/error_xy_mps"),
    ("error, rad/s", "/error_yaw_radps"),
    ("touchdowns, 1/s", "/gait/touchdowns_per_second"),
    ("alternation", "/gait/alternation"),
    ("air time, s", "/gait/air_time_s"),
    ("clearance, m", "/gait/clearance_m"),
    ("slip, m/s", "/gait/slip_mps"),
    ("drift, m", "/drift_m"),
];

/// What the page says of a run, a policy or an evaluation.
#[derive(Default)]
pub struct About {
    /// Name in the pictures.
    pub name: String,
    /// The effective configuration of a run.
    pub config: Option<String>,
    /// Seed of the training, if the configuration names one.
    pub seed: Option<i64>,
    /// `eval.json`, if the run was evaluated.
    pub eval: Option<Value>,
    /// What went wrong while it learned, and what of it cannot be read, a sentence each.
    pub warnings: Vec<String>,
    /// Why it is not known how it was trained.
    pub unrecorded: Option<String>,
    /// Commands that made the run, as far as they were recorded, and those that make its evaluation and this page again.
    pub commands: Vec<String>,
    /// Programs and machines that trained it.
    pub programs: Vec<String>,
    /// The command that draws what is not on the page yet.
    pub missing: Option<String>,
}

/// What every report begins with.
pub const HEAD: &str = "<!DOCTYPE html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\"><title>omniwalk report</title>\n";

/// The page with `pictures`, each with its title as PNG, about `runs`, made by version `version` of the program.
pub fn page(pictures: &[(&str, Vec<u8>)], runs: &[About], version: &str) -> String {
    let mut out = HEAD.to_owned();
    let _ = writeln!(
        out,
        "<style>{STYLE}</style>\n<h1>omniwalk report</h1>\n<p>drawn by omniwalk {}</p>",
        escaped(version)
    );
    runs.iter().for_each(|run| warnings(run, &mut out));
    for (title, png) in pictures {
        let data = BASE64_STANDARD.encode(png);
        let _ = writeln!(
            out,
            "<p><img alt=\"{0}\" src=\"data:image/png;base64,{data}\"></p>",
            escaped(title)
        );
    }
    runs.iter().for_each(|run| about(run, &mut out));
    out + "</html>\n"
}

/// Above the pictures: whoever opens the page of a run that came apart must not have to find it out by the curves.
fn warnings(run: &About, out: &mut String) {
    for warning in &run.warnings {
        let _ = writeln!(
            out,
            "<p class=\"warning\">WARNING: {}: {}</p>",
            escaped(&run.name),
            escaped(warning)
        );
    }
}

fn about(run: &About, out: &mut String) {
    let _ = writeln!(out, "<h2>{}</h2>", escaped(&run.name));
    if let Some(seed) = run.seed {
        let _ = writeln!(out, "<p>seed {seed}</p>");
    }
    for program in &run.programs {
        let _ = writeln!(out, "<p>trained by {}</p>", escaped(program));
    }
    if let Some(why) = &run.unrecorded {
        let _ = writeln!(out, "<p>How it was trained is not recorded: {}</p>", escaped(why));
    }
    if let Some(command) = &run.missing {
        let _ = writeln!(
            out,
            "<p>Gait, loads, errors and falls by command, and the limits of pushes are drawn by <code>{}</code>; then report again.</p>",
            escaped(command)
        );
    }
    match &run.eval {
        Some(eval) => table(eval, out),
        None => *out += "<p>not evaluated yet</p>\n",
    }
    let _ = writeln!(
        out,
        "<h3>Commands</h3>\n<pre>{}</pre>",
        escaped(&run.commands.join("\n"))
    );
    if let Some(config) = &run.config {
        let _ = writeln!(out, "<h3>Configuration</h3>\n<pre>{}</pre>", escaped(config));
    }
}

/// A table a suite: every member of the evaluation that has rows.
fn table(eval: &Value, out: &mut String) {
    let said = ["steps", "engine", "robot", "conditions", "seed"]
        .iter()
        .filter_map(|key| eval.get(*key).map(|value| format!("{key} {}", cell(value))));
    let _ = writeln!(
        out,
        "<h3>Evaluation</h3>\n<p>{}</p>",
        escaped(&said.collect::<Vec<_>>().join(", "))
    );
    for (suite, results) in eval.as_object().into_iter().flatten() {
        if let (Some(survived), Some(total)) = (results.get("survived"), results.get("total")) {
            let said = ["error_xy_mps", "error_yaw_radps"].map(|key| results.get(key).map_or(String::new(), cell));
            let line = format!(
                "{} of {} survived, error {} m/s, {} rad/s",
                cell(survived),
                cell(total),
                said[0],
                said[1]
            );
            let _ = writeln!(out, "<h4>{}</h4>\n<p>{}</p>", escaped(suite), escaped(&line));
        }
        let Some(rows) = results.get("rows").and_then(Value::as_array) else {
            continue;
        };
        let _ = write!(out, "<h4>{}</h4>\n<table><tr><th>command</th>", escaped(suite));
        let filled = |pointer: &str| {
            rows.iter()
                .any(|row| row.pointer(pointer).is_some_and(|x| !x.is_null()))
        };
        let columns: Vec<_> = COLUMNS.iter().filter(|(_, pointer)| filled(pointer)).collect();
        columns
            .iter()
            .for_each(|(title, _)| *out += &format!("<th>{title}</th>"));
        *out += "</tr>\n";
        for row in rows {
            let command = row.get("command").and_then(Value::as_array);
            let command: Vec<String> = command.into_iter().flatten().map(cell).collect();
            let _ = write!(out, "<tr><td>{}</td>", escaped(&command.join(", ")));
            for (_, pointer) in &columns {
                let _ = write!(
                    out,
                    "<td>{}</td>",
                    escaped(&row.pointer(pointer).map_or(String::new(), cell))
                );
            }
            *out += "</tr>\n";
        }
        *out += "</table>\n";
    }
}

fn cell(value: &Value) -> String {
    match value {
        Value::Number(number) if number.is_f64() => match number.as_f64().unwrap_or(f64::NAN) {
            // No figure of a walk: not in hundreds of digits.
            x if x.abs() >= 1e6 => format!("{x:.3e}"),
            x => format!("{x:.3}"),
        },
        Value::String(text) => text.clone(),
        Value::Null => String::new(),
        other => other.to_string(),
    }
}

/// `text` where markup is expected.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
