//! `falls`: the test of table 7.1, sequences of 60 s at ten commands.

use serde_json::{Value, json};

use super::hold::{self, Row};
use super::stats::Estimate;
use super::suites::{Plan, Results};
use super::summary::{gait_text, interval, name, percent, row_json, rows_text};
use super::trial::Stage;

/// The commands of table 7.1 (m/s, m/s, rad/s).
pub const COMMANDS: [[f64; 3]; 10] = [
    [0.0, 0.0, 0.0],
    [0.6, 0.0, 0.0],
    [-0.6, 0.0, 0.0],
    [0.0, 0.6, 0.0],
    [0.0, -0.6, 0.0],
    [0.0, 0.0, 0.6],
    [0.0, 0.0, -0.6],
    [0.4, 0.4, 0.0],
    [0.4, 0.3, 0.0],
    [0.0, 0.4, 0.3],
];

/// Length of a sequence, s.
const SECONDS: f64 = 60.0;

/// What came of it.
pub struct Falls {
    rows: Vec<Row>,
}

impl Falls {
    /// Plays the suite.
    ///
    /// # Errors
    /// Those of [`Stage::play`].
    pub fn play(stage: &mut Stage<'_>, part: u64, plan: &Plan) -> miette::Result<Self> {
        let seconds = plan.seconds.unwrap_or(SECONDS);
        let rows = hold::play(stage, part, &COMMANDS, plan.episodes, seconds)?;
        Ok(Self { rows })
    }

    fn total(&self) -> (usize, usize) {
        let sequences = self.rows.iter().map(|row| row.records.len()).sum();
        (self.rows.iter().map(Row::falls).sum(), sequences)
    }
}

impl Results for Falls {
    fn json(&self) -> Value {
        let (falls, n) = self.total();
        json!({
            "episodes": n,
            "falls": falls,
            "falls_share_ci95": interval(&Estimate::share(falls, n)),
            "rows": self.rows.iter().map(row_json).collect::<Vec<_>>(),
        })
    }

    fn text(&self) -> String {
        let (falls, n) = self.total();
        let gaits = self.rows.iter().map(|row| (name(row.command), &row.records[..]));
        format!(
            "{}falls in all: {falls} of {n} ({})\n{}",
            rows_text(&self.rows),
            percent(&Estimate::share(falls, n)),
            gait_text(gaits)
        )
    }
}
