//! Results of a suite as a table for people and as JSON for programs.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::forward::Row;

/// The rows as `eval --json` gives them.
pub fn to_json(rows: &[Row]) -> Value {
    Value::Array(rows.iter().map(row_json).collect())
}

fn row_json(row: &Row) -> Value {
    let velocity = [0, 1, 2].map(|k| number(row.mean(|e| e.tracking.map(|t| t.velocity[k]))));
    let mut out = json!({
        "command": row.command,
        "episodes": row.episodes.len(),
        "falls": row.falls(),
        "error_xy_mps": number(row.mean(|e| e.tracking.map(|t| t.error_xy_mps))),
        "error_yaw_radps": number(row.mean(|e| e.tracking.map(|t| t.error_yaw_radps))),
        "velocity": velocity,
        "torque_nm": number(row.mean(|e| Some(e.torque))),
        "estimator_error_mps": number(row.mean(|e| Some(e.estimator_error))),
    });
    let gait = json!({
        "alternation": number(row.mean(|e| Some(e.gait.alternation))),
        "touchdowns_per_second": number(row.mean(|e| Some(e.gait.touchdowns_per_second))),
        "clearance_m": number(row.mean(|e| Some(e.gait.clearance_m))),
        "air_time_s": number(row.mean(|e| Some(e.gait.air_time_s))),
        "slip_mps": number(row.mean(|e| Some(e.gait.slip_mps))),
        "leg_overlap": row.overlaps(),
    });
    out["gait"] = gait;
    if !row.moves() {
        out["drift_m"] = number(row.mean(|e| Some(e.drift)));
        out["drift_max_m"] = number(row.episodes.iter().map(|e| e.drift).fold(0.0, f64::max));
    }
    out
}

/// JSON has no NaN: a figure nothing was measured for is null.
pub fn number(x: f64) -> Value {
    if x.is_finite() { json!(x) } else { Value::Null }
}

/// A table in which figures nothing was measured for are dashes.
pub fn dashed(table: &str) -> String {
    table.replace("NaN", "  -")
}

/// The rows as a table.
pub fn to_text(rows: &[Row]) -> String {
    let mut out = String::from(
        "command (m/s, m/s, rad/s)   falls   v_x    v_y  omega  error m/s rad/s  steps/s left right  altern.  air s  \
         clear. cm  slip m/s  torque N m  drift m\n",
    );
    for row in rows {
        let v = [0, 1, 2].map(|k| row.mean(|e| e.tracking.map(|t| t.velocity[k])));
        let foot = |i: usize| row.mean(|e| Some(e.touchdowns_per_second[i]));
        let command = format!("({:.2}, {:.2}, {:.2})", row.command[0], row.command[1], row.command[2]);
        let _ = writeln!(
            out,
            "{command:<27} {:>2}/{:<3} {:>5.2} {:>6.2} {:>6.2}  {:>9.3} {:>5.3}  {:>12.2} {:>5.2}  {:>6.0} %  {:>5.2}  \
             {:>9.1}  {:>8.3}  {:>10.2}  {:>7.2}",
            row.falls(),
            row.episodes.len(),
            v[0],
            v[1],
            v[2],
            row.mean(|e| e.tracking.map(|t| t.error_xy_mps)),
            row.mean(|e| e.tracking.map(|t| t.error_yaw_radps)),
            foot(0),
            foot(1),
            100.0 * row.mean(|e| Some(e.gait.alternation)),
            row.mean(|e| Some(e.gait.air_time_s)),
            100.0 * row.mean(|e| Some(e.gait.clearance_m)),
            row.mean(|e| Some(e.gait.slip_mps)),
            row.mean(|e| Some(e.torque)),
            row.mean(|e| Some(e.drift)),
        );
    }
    out
}
