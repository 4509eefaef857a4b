//! Sequences as figures with 95 % confidence intervals: JSON for programs, tables for people.

use std::fmt::Write as _;

use omniwalk_env::task::episode::End;
use omniwalk_env::task::tracking::Tracking;
use serde_json::{Value, json};

use super::hold::Row;
use super::meter::Record;
use super::stats::Estimate;
use super::table::number;

/// Errors of the velocity over sequences, which count once each.
pub struct Errors {
    /// Along the ground, m/s.
    pub xy: Estimate,
    /// Turning, rad/s.
    pub yaw: Estimate,
}

impl Errors {
    /// Of those that held a command for long enough.
    pub fn of<'a>(tracking: impl Iterator<Item = &'a Option<Tracking>>) -> Self {
        let held: Vec<&Tracking> = tracking.flatten().collect();
        let of = |value: fn(&Tracking) -> f64| Estimate::mean(&held.iter().map(|t| value(t)).collect::<Vec<_>>());
        Self {
            xy: of(|t| t.error_xy_mps),
            yaw: of(|t| t.error_yaw_radps),
        }
    }

    /// Of the sequences of a row.
    pub fn of_row(row: &Row) -> Self {
        Self::of(row.records.iter().map(|record| &record.tracking))
    }

    /// Adds them to `out`.
    pub fn write_to(&self, out: &mut Value) {
        out["error_xy_mps"] = number(self.xy.value);
        out["error_xy_ci95"] = interval(&self.xy);
        out["error_yaw_radps"] = number(self.yaw.value);
        out["error_yaw_ci95"] = interval(&self.yaw);
    }

    /// Both with half the width of their intervals, 32 characters wide.
    pub fn to_text(&self) -> String {
        format!(
            "{:>7.3} {:<7}  {:>7.3} {:<7}",
            self.xy.value,
            plus_minus(&self.xy),
            self.yaw.value,
            plus_minus(&self.yaw)
        )
    }
}

/// What stands above [`Errors::to_text`].
pub const ERRORS_HEAD: &str = " error m/s         error rad/s    ";

fn plus_minus(estimate: &Estimate) -> String {
    match estimate.half_width() {
        half if half.is_finite() => format!("±{half:.3}"),
        _ => String::new(),
    }
}

/// The interval as JSON.
pub fn interval(estimate: &Estimate) -> Value {
    json!([number(estimate.low), number(estimate.high)])
}

/// The interval of a share in per cent.
pub fn percent(share: &Estimate) -> String {
    format!("{:.0}-{:.0} %", 100.0 * share.low, 100.0 * share.high)
}

/// A command as tables show it, 22 characters wide.
pub fn name([x, y, turn]: [f64; 3]) -> String {
    format!("({x:>5.2}, {y:>5.2}, {turn:>5.2})")
}

/// A row as `eval --json` gives it.
pub fn row_json(row: &Row) -> Value {
    let (falls, n) = (row.falls(), row.records.len());
    let velocity = [0, 1, 2].map(|k| number(mean(&row.records, |r| r.tracking.map(|t| t.velocity[k]))));
    let mut out = json!({
        "command": row.command,
        "episodes": n,
        "falls": falls,
        "falls_share_ci95": interval(&Estimate::share(falls, n)),
        "velocity": velocity,
        "gait": gait_json(&row.records),
    });
    Errors::of_row(row).write_to(&mut out);
    if row.command == [0.0; 3] {
        let drift = Estimate::mean(&row.records.iter().map(|r| r.drift).collect::<Vec<_>>());
        out["drift_m"] = number(drift.value);
        out["drift_ci95"] = interval(&drift);
    }
    out
}

/// The rows with what came of them.
pub fn rows_text(rows: &[Row]) -> String {
    let mut out = format!(
        "{:<22}     falls        95 %  {ERRORS_HEAD}   v_x    v_y  omega  drift m\n",
        "command"
    );
    for row in rows {
        let (falls, n) = (row.falls(), row.records.len());
        let v = [0, 1, 2].map(|k| mean(&row.records, |r| r.tracking.map(|t| t.velocity[k])));
        let _ = writeln!(
            out,
            "{}  {falls:>3}/{n:<4} {:>9}  {}  {:>6.2} {:>6.2} {:>6.2}  {:>7.2}",
            name(row.command),
            percent(&Estimate::share(falls, n)),
            Errors::of_row(row).to_text(),
            v[0],
            v[1],
            v[2],
            mean(&row.records, |r| Some(r.drift)),
        );
    }
    out
}

/// Mean of `value` over the records that have it, weighted by their duration; NaN without any.
pub fn mean(records: &[Record], value: impl Fn(&Record) -> Option<f64>) -> f64 {
    let (sum, time) = records
        .iter()
        .filter_map(|r| Some((value(r)?, r.seconds)))
        .fold((0.0, 0.0), |(sum, time), (x, s)| (sum + x * s, time + s));
    sum / time
}

fn overlaps(records: &[Record]) -> usize {
    records.iter().filter(|r| r.end == Some(End::Overlap)).count()
}

fn fastest(records: &[Record]) -> f64 {
    records.iter().map(|r| r.effort.speed_max).fold(0.0, f64::max)
}

/// The gait over records as `eval --json` gives it.
pub fn gait_json(records: &[Record]) -> Value {
    let mean = |value: fn(&Record) -> Option<f64>| number(mean(records, value));
    json!({
        "alternation": mean(|r| Some(r.gait.alternation)),
        "touchdowns_per_second": mean(|r| Some(r.gait.touchdowns_per_second)),
        "clearance_m": mean(|r| Some(r.gait.clearance_m)),
        "air_time_s": mean(|r| Some(r.gait.air_time_s)),
        "double_support_share": mean(|r| Some(r.gait.double_support)),
        "flight_share": mean(|r| Some(r.gait.flight)),
        "slip_mps": mean(|r| Some(r.gait.slip_mps)),
        "leg_overlap": overlaps(records),
        "torque_rms_share": mean(|r| Some(r.effort.torque_rms)),
        "torque_saturated_share": mean(|r| Some(r.effort.torque_saturated)),
        "speed_max_share": fastest(records),
        "action_change": mean(|r| Some(r.effort.action_change)),
        "cost_of_transport": mean(|r| r.effort.cost_of_transport),
        "asymmetry_rad": mean(|r| r.effort.asymmetry),
    })
}

/// The gait of each of `rows`: what it is called, and its records.
pub fn gait_text<'a>(rows: impl IntoIterator<Item = (String, &'a [Record])>) -> String {
    let mut out = format!(
        "{:<22}  steps/s altern. clear. cm  air s double flight slip m/s overlap  torque limited  speed  change   CoT  \
         asym.\n",
        "gait"
    );
    for (name, records) in rows {
        let mean = |value: fn(&Record) -> Option<f64>| mean(records, value);
        let _ = writeln!(
            out,
            "{name:<22}  {:>7.2} {:>5.0} % {:>9.1} {:>6.2} {:>4.0} % {:>4.0} % {:>8.3} {:>7}  {:>4.0} % {:>5.1} % {:>4.0} % \
             {:>7.4} {:>5.2} {:>6.3}",
            mean(|r| Some(r.gait.touchdowns_per_second)),
            100.0 * mean(|r| Some(r.gait.alternation)),
            100.0 * mean(|r| Some(r.gait.clearance_m)),
            mean(|r| Some(r.gait.air_time_s)),
            100.0 * mean(|r| Some(r.gait.double_support)),
            100.0 * mean(|r| Some(r.gait.flight)),
            mean(|r| Some(r.gait.slip_mps)),
            overlaps(records),
            100.0 * mean(|r| Some(r.effort.torque_rms)),
            100.0 * mean(|r| Some(r.effort.torque_saturated)),
            100.0 * fastest(records),
            mean(|r| Some(r.effort.action_change)),
            mean(|r| r.effort.cost_of_transport),
            mean(|r| r.effort.asymmetry),
        );
    }
    out
}
