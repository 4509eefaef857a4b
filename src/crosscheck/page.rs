//! `crosscheck.html`: the gates as one file that needs no other.

use std::fmt::Write as _;

use serde_json::Value;

use super::closed_loop::FIGURES;
use crate::report::html::{HEAD, STYLE, escaped};

/// The page about `result`, as `crosscheck.json` holds it.
pub fn page(result: &Value) -> String {
    let text = |key: &str| escaped(result[key].as_str().unwrap_or(""));
    let mut out = format!(
        "{HEAD}<style>{STYLE}.pass{{color:#2e7d32}}.fail{{color:#c62828}}</style>\n<h1>omniwalk cross-check: {}</h1>\n\
         <p>Gates: {}. {} on {} after {} steps; {} at {} Hz against MuJoCo {}; seed {}; settings changed: {}; omniwalk {}</p>\n",
        mark(&result["pass"]),
        result["gates"].as_object().map_or_else(String::new, |gates| gates
            .keys()
            .cloned()
            .collect::<Vec<_>>()
            .join(", ")),
        text("policy"),
        text("robot"),
        result["steps"],
        text("engine"),
        result["physics_hz"],
        text("mujoco"),
        result["seed"],
        changes(result),
        text("version"),
    );
    let gates = &result["gates"];
    for (name, title) in [("network", "Network"), ("physics", "Physics and observation")] {
        if let Some(gate) = gates.get(name) {
            let _ = writeln!(out, "<h2>{title}: {}</h2>", mark(&gate["pass"]));
            checks(gate, &mut out);
            left_out(gate, &mut out);
        }
    }
    let gates = gates.as_object().into_iter().flatten();
    for (_, gate) in gates.filter(|(name, _)| name.starts_with("closed_loop")) {
        closed_loop(gate, &mut out);
    }
    out + "</html>\n"
}

/// What `--set` changed.
fn changes(result: &Value) -> String {
    let set = strings(&result["set"]);
    if set.is_empty() {
        "none".into()
    } else {
        escaped(&set.join(", "))
    }
}

/// The strings of an array.
fn strings(array: &Value) -> Vec<&str> {
    let values = array.as_array().into_iter().flatten();
    values.filter_map(Value::as_str).collect()
}

fn mark(pass: &Value) -> &'static str {
    if *pass == true {
        "<span class=\"pass\">PASS</span>"
    } else {
        "<span class=\"fail\">FAIL</span>"
    }
}

/// The checks of a gate: what each found, and its bound.
fn checks(gate: &Value, out: &mut String) {
    *out += "<table><tr><th>check</th><th>found</th><th>bound</th><th></th></tr>\n";
    for check in gate["checks"].as_array().into_iter().flatten() {
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escaped(check["check"].as_str().unwrap_or("")),
            scientific(&check["found"]),
            scientific(&check["bound"]),
            mark(&check["pass"])
        );
    }
    *out += "</table>\n";
}

/// Effects that a gate has nothing to say of.
fn left_out(gate: &Value, out: &mut String) {
    let names = strings(&gate["left_out"]);
    if !names.is_empty() {
        let _ = writeln!(
            out,
            "<p>Left out, as actuators and encoders are the same code in every engine; the closed loop has them: {}</p>",
            escaped(&names.join(", "))
        );
    }
}

fn scientific(value: &Value) -> String {
    value.as_f64().map_or("-".into(), |x| format!("{x:.2e}"))
}

fn closed_loop(gate: &Value, out: &mut String) {
    let name = gate["engine"].as_str().unwrap_or("engine");
    let _ = writeln!(
        out,
        "<h2>Closed loop: {}</h2>\n<p>Survival in MuJoCo over that in {name}: {} (at least {}); velocity error: {} (at most {}).</p>\n\
         <table><tr><th></th><th>{name}</th><th>MuJoCo</th></tr>",
        mark(&gate["pass"]),
        short(&gate["survival_ratio"]),
        gate["bounds"]["survival_ratio"],
        short(&gate["velocity_error_ratio"]),
        gate["bounds"]["velocity_error_ratio"],
    );
    for (label, pointer) in FIGURES {
        let figure = |side: &str| short(gate[side].pointer(pointer).unwrap_or(&Value::Null));
        let _ = writeln!(
            out,
            "<tr><td>{label}</td><td>{}</td><td>{}</td></tr>",
            figure(name),
            figure("mujoco")
        );
    }
    *out += "</table>\n";
    for part in ["commands", "falls", "tracking"] {
        rows(gate, name, part, &COMMAND_ROWS, out);
    }
    rows(gate, name, "push", &PUSH_ROWS, out);
}

/// Columns of the rows that ask for a command, and of those that push: title and JSON pointer into a row.
const COMMAND_ROWS: [(&str, &str); 4] = [
    ("falls", "/falls"),
    ("error, m/s", "/error_xy_mps"),
    ("error, rad/s", "/error_yaw_radps"),
    ("slip, m/s", "/gait/slip_mps"),
];
const PUSH_ROWS: [(&str, &str); 2] = [("every push to, N", "/all_ten_n"), ("any push to, N", "/max_n")];

/// The rows of a part, the engine's and MuJoCo's side by side.
fn rows(gate: &Value, name: &str, part: &str, columns: &[(&str, &str)], out: &mut String) {
    let of = |side: &str| gate["details"][side][part]["rows"].as_array();
    let (Some(ours), Some(theirs)) = (of(name), of("mujoco")) else {
        return;
    };
    let _ = write!(out, "<h3>{part}</h3>\n<table><tr><th>command</th>");
    for (title, _) in columns {
        let _ = write!(out, "<th>{title}: {name}</th><th>MuJoCo</th>");
    }
    *out += "</tr>\n";
    for (ours, theirs) in ours.iter().zip(theirs) {
        let from = ours["direction"]
            .as_str()
            .map_or(String::new(), |from| format!(" from the {from}"));
        let _ = write!(out, "<tr><td>{}{}</td>", ours["command"], escaped(&from));
        for (_, pointer) in columns {
            let cell = |row: &Value| short(row.pointer(pointer).unwrap_or(&Value::Null));
            let _ = write!(out, "<td>{}</td><td>{}</td>", cell(ours), cell(theirs));
        }
        *out += "</tr>\n";
    }
    *out += "</table>\n";
}

fn short(value: &Value) -> String {
    match value.as_f64() {
        Some(x) if value.is_f64() => format!("{x:.3}"),
        Some(x) => format!("{x}"),
        None => "-".into(),
    }
}
