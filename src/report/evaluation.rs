//! Pictures of an evaluation, drawn from what `eval.json` says: by `omniwalk eval` when it has played, by `omniwalk report` at
//! any time after, of files whose pictures were not kept too.

use std::path::Path;

use miette::{Context, Diagnostic, IntoDiagnostic, Report};
use serde::Deserialize;
use serde_json::Value;
use thiserror::Error;

use super::canvas::Canvas;
use super::{ReportError, commands, polar};
use crate::eval::suites::{self, Suite};
use crate::files;

/// Largest file that is read, bytes.
pub const MAX_BYTES: u64 = 16 << 20;

/// Most commands of a suite.
const MOST: usize = 10_000;
/// Most pushes that are drawn, and values along an axis of the grid: more have no room.
const MOST_PUSHES: usize = 100;
const MOST_ALONG: usize = 25;
/// Largest velocity, m/s or rad/s, and force, N, that a picture has room for.
const LARGEST: f64 = 1e6;

/// Most sequences of a command.
const MOST_EPISODES: f64 = 1e9;

/// A picture and the name of its file.
pub type Picture = (&'static str, Canvas);

/// What pictures show of an `eval.json`; suites that were not played are none.
#[derive(Debug, Default, Deserialize)]
pub struct Evaluation {
    /// Control steps of the policy's training, if the file says.
    pub steps: Option<u64>,
    conditions: Option<String>,
    forward: Option<Rows<Held>>,
    falls: Option<Rows<Held>>,
    tracking: Option<Tracking>,
    push: Option<Rows<Pushed>>,
}

#[derive(Debug, Deserialize)]
struct Rows<T> {
    rows: Vec<T>,
}

#[derive(Debug, Deserialize)]
struct Tracking {
    rows: Vec<Held>,
    grid: Grid,
}

/// What came of a command that was held.
#[derive(Clone, Debug, Deserialize)]
pub struct Held {
    /// The command, m/s, m/s, rad/s.
    pub command: [f64; 3],
    /// Sequences that fell.
    pub falls: f64,
    /// Sequences.
    pub episodes: f64,
    /// Error along the ground, m/s; none if nothing held out for long enough.
    pub error_xy_mps: Option<f64>,
    /// Its 95 % interval; none of the suite `forward`.
    pub error_xy_ci95: Option<[Option<f64>; 2]>,
    /// Error of turning, rad/s.
    pub error_yaw_radps: Option<f64>,
    /// Its 95 % interval.
    pub error_yaw_ci95: Option<[Option<f64>; 2]>,
}

impl Held {
    /// Whether its figures can be ones that were counted and measured.
    fn is_plausible(&self) -> bool {
        let intervals = [self.error_xy_ci95, self.error_yaw_ci95];
        let bounds = intervals.into_iter().flatten().flatten().flatten();
        let errors = [self.error_xy_mps, self.error_yaw_radps].into_iter().flatten();
        let counted = 0.0 <= self.falls && self.falls <= self.episodes && self.episodes <= MOST_EPISODES;
        counted && errors.chain(bounds).all(|error| error.abs() <= LARGEST)
    }
}

/// The suite `tracking`'s grid.
#[derive(Debug, Deserialize)]
pub struct Grid {
    /// Values forward, m/s.
    pub v_x: Vec<f64>,
    /// Values to the left, m/s.
    pub v_y: Vec<f64>,
    /// Values of turning, rad/s.
    pub omega_z: Vec<f64>,
    /// Sequences of each cell.
    pub episodes: f64,
    /// What came of the cells.
    pub cells: Cells,
}

/// Quantities of a [`Grid`], as `[omega_z][v_y][v_x]`.
#[derive(Debug, Deserialize)]
pub struct Cells {
    /// Error along the ground, m/s.
    pub error_xy_mps: Vec<Vec<Vec<Option<f64>>>>,
    /// Error of turning, rad/s.
    pub error_yaw_radps: Vec<Vec<Vec<Option<f64>>>>,
    /// Sequences that fell.
    pub falls: Vec<Vec<Vec<Option<f64>>>>,
}

/// Pushes at a command from one side.
#[derive(Clone, Debug, Deserialize)]
pub struct Pushed {
    /// The command, m/s, m/s, rad/s.
    pub command: [f64; 3],
    /// Where they came from: front, back, right or left.
    pub direction: String,
    /// The highest force with every push recovered, N.
    pub all_ten_n: f64,
    /// The highest with any, N.
    pub max_n: f64,
    /// The same in table 7.2.
    pub thesis_all_ten_n: f64,
    /// The same in table 7.2.
    pub thesis_max_n: f64,
}

/// An `eval.json` that no picture can be drawn of.
#[derive(Debug, Error, Diagnostic)]
#[error("not an evaluation of omniwalk: {0}")]
#[diagnostic(help("`omniwalk eval` writes it anew"))]
pub struct NotAnEvaluation(String);

impl Evaluation {
    /// What the file at `path` says: all of it, and what is drawn of that.
    ///
    /// # Errors
    /// When it cannot be read, is no JSON or not an evaluation.
    pub fn load(path: &Path) -> Result<(Value, Self), Report> {
        let bytes = files::read(path, MAX_BYTES).into_diagnostic();
        let bytes = bytes.wrap_err_with(|| format!("cannot read {}", path.display()))?;
        let value = serde_json::from_slice(&bytes).map_err(|error| NotAnEvaluation(format!("no JSON: {error}")));
        let read = value.and_then(|value| Ok((Self::read(&value)?, value)));
        let (evaluation, value) = read.wrap_err_with(|| format!("cannot draw {}", path.display()))?;
        Ok((value, evaluation))
    }

    /// What `value` says.
    ///
    /// # Errors
    /// [`NotAnEvaluation`] when there is no suite, or rows, or the grid, are not what `omniwalk eval` writes.
    pub fn read(value: &Value) -> Result<Self, NotAnEvaluation> {
        let read =
            serde_path_to_error::deserialize::<_, Self>(value).map_err(|error| NotAnEvaluation(error.to_string()))?;
        let suites = || ["forward"].into_iter().chain(suites::ALL.map(Suite::name));
        if !suites().any(|name| value.get(name).is_some_and(Value::is_object)) {
            let names: Vec<&str> = suites().collect();
            return Err(NotAnEvaluation(format!(
                "it has no suite, none of {}",
                names.join(", ")
            )));
        }
        read.check().map_or(Ok(read), |what| Err(NotAnEvaluation(what)))
    }

    /// What cannot be drawn of it.
    fn check(&self) -> Option<String> {
        let drawn = |x: &f64| x.abs() <= LARGEST;
        let rows = [&self.forward, &self.falls]
            .into_iter()
            .flatten()
            .map(|rows| &rows.rows);
        let rows = rows.chain(self.tracking.iter().map(|tracking| &tracking.rows));
        if rows.clone().flatten().any(|row| !row.is_plausible()) {
            return Some("falls, episodes or errors that are none".into());
        }
        if rows
            .clone()
            .any(|rows| rows.len() > MOST || !rows.iter().flat_map(|row| &row.command).all(drawn))
        {
            return Some("commands that no robot walks".into());
        }
        let pushes = self.push.iter().flat_map(|push| &push.rows);
        let mut forces = pushes.flat_map(|row| [row.all_ten_n, row.max_n, row.thesis_all_ten_n, row.thesis_max_n]);
        let many = self.push.as_ref().is_some_and(|push| push.rows.len() > MOST_PUSHES);
        if many || forces.any(|force| !(0.0..=LARGEST).contains(&force)) {
            return Some("forces of pushes that are none".into());
        }
        let grid = &self.tracking.as_ref()?.grid;
        let cells = [&grid.cells.error_xy_mps, &grid.cells.error_yaw_radps, &grid.cells.falls];
        let axes = [&grid.v_x, &grid.v_y, &grid.omega_z];
        let is_full = |cells: &Vec<Vec<Vec<Option<f64>>>>| {
            let rows = || cells.iter().flatten();
            cells.len() == grid.omega_z.len()
                && cells.iter().all(|slice| slice.len() == grid.v_y.len())
                && rows().all(|row| row.len() == grid.v_x.len())
        };
        let few = axes.iter().all(|axis| (1..=MOST_ALONG).contains(&axis.len()));
        if !few || !axes.into_iter().flatten().all(drawn) || !cells.into_iter().all(is_full) {
            return Some("the cells of tracking.grid are not as many as its axes say".into());
        }
        None
    }

    /// Errors and falls command by command, over the grid, and the limits of pushes: of each, what was played.
    ///
    /// # Errors
    /// [`ReportError::Draw`].
    pub fn pictures(&self) -> Result<Vec<Picture>, ReportError> {
        let mut pictures = Vec::new();
        for played in [&self.forward, &self.falls] {
            if let Some(rows) = played.as_ref().filter(|played| !played.rows.is_empty()) {
                // Of both, the longer sequences say more.
                pictures.retain(|(name, _)| *name != "eval_falls.png");
                pictures.push(("eval_falls.png", commands::list(&rows.rows)?));
            }
        }
        if let Some(tracking) = &self.tracking {
            pictures.push(("eval_error.png", commands::along_axes(&tracking.rows)?));
            pictures.push(("eval_grid.png", commands::grid(&tracking.grid)?));
        }
        if let Some(push) = self.push.as_ref().filter(|push| !push.rows.is_empty()) {
            pictures.push(("eval_push.png", polar::pushes(&push.rows, self.conditions.as_deref())?));
        }
        Ok(pictures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn named(value: &Value) -> Vec<&'static str> {
        let pictures = Evaluation::read(value).unwrap().pictures().unwrap();
        pictures.into_iter().map(|(name, _)| name).collect()
    }

    fn held() -> Value {
        json!({"command": [0.4, 0.0, 0.0], "falls": 3, "episodes": 20, "error_xy_mps": null, "error_yaw_radps": 0.1})
    }

    #[test]
    fn what_was_played_is_drawn_and_nothing_else() {
        assert!(named(&json!({"engine": "rapier", "changes": {}})).is_empty());
        let rows = json!({"rows": [held()]});
        assert_eq!(named(&json!({"forward": rows})), ["eval_falls.png"]);
        assert_eq!(named(&json!({"forward": rows, "falls": rows})), ["eval_falls.png"]);
        let pushed = |direction: &str| json!({"command": [0.0, 0.0, 0.0], "direction": direction, "all_ten_n": 40.0, "max_n": 60.0, "thesis_all_ten_n": 40.0, "thesis_max_n": 60.0});
        let pushes = ["front", "back", "right", "left"].map(pushed);
        assert_eq!(named(&json!({"push": {"rows": pushes}})), ["eval_push.png"]);
        // A robot that was pushed from one side only.
        assert_eq!(named(&json!({"push": {"rows": [pushed("left")]}})), ["eval_push.png"]);
    }

    #[test]
    fn what_is_large_and_odd_is_drawn_all_the_same() {
        let pushed = |i: usize| json!({"command": [i, 0.0, 0.0], "direction": "up", "all_ten_n": 1e6, "max_n": 0.0, "thesis_all_ten_n": 0.0, "thesis_max_n": 0.0});
        assert_eq!(
            named(&json!({"push": {"rows": (0..MOST_PUSHES).map(pushed).collect::<Vec<_>>()}})),
            ["eval_push.png"]
        );
        let (axis, same) = (
            (0..MOST_ALONG).map(|i| i as f64).collect::<Vec<_>>(),
            vec![0.5; MOST_ALONG],
        );
        let cells = vec![vec![vec![1e300; MOST_ALONG]; MOST_ALONG]; MOST_ALONG];
        for (v_x, v_y) in [(&axis, &same), (&same, &axis)] {
            let grid = json!({"v_x": v_x, "v_y": v_y, "omega_z": axis, "episodes": 0, "cells": {"error_xy_mps": cells, "error_yaw_radps": cells, "falls": cells}});
            assert_eq!(
                named(&json!({"tracking": {"rows": [held(), held()], "grid": grid}})),
                ["eval_error.png", "eval_grid.png"]
            );
        }
        let mut odd = held();
        (odd["falls"], odd["episodes"], odd["error_xy_mps"]) = (json!(0), json!(0), json!(1e6));
        assert_eq!(named(&json!({"falls": {"rows": vec![odd.clone(); MOST]}, "tracking": {"rows": [odd], "grid": {"v_x": [1e6], "v_y": [-1e6], "omega_z": [0], "episodes": 1,
            "cells": {"error_xy_mps": [[[null]]], "error_yaw_radps": [[[null]]], "falls": [[[null]]]}}}})).len(), 3);
    }

    #[test]
    fn a_file_that_is_not_an_evaluation_is_refused() {
        let cell = json!([[[0.1]]]);
        let grid = |v_x: Value, cells: &Value| {
            json!({"tracking": {"rows": [], "grid": {"v_x": v_x, "v_y": [0.0], "omega_z": [0.0], "episodes": 1,
            "cells": {"error_xy_mps": cells, "error_yaw_radps": cells, "falls": cells}}}})
        };
        assert_eq!(named(&grid(json!([0.1]), &cell)), ["eval_error.png", "eval_grid.png"]);
        let mut far = held();
        far["command"] = json!([1e300, 0.0, 0.0]);
        let with = |key: &str, value: Value| {
            let mut row = held();
            row[key] = value;
            json!({"falls": {"rows": [row]}})
        };
        for (value, part) in [
            (json!([]), "struct Evaluation"),
            (json!({}), "it has no suite, none of forward, falls"),
            (json!({"falls": null}), "it has no suite"),
            (with("falls", json!(-1e300)), "falls, episodes or errors that are none"),
            (with("falls", json!(21)), "falls, episodes or errors that are none"),
            (
                with("episodes", json!(1e300)),
                "falls, episodes or errors that are none",
            ),
            (
                with("error_xy_mps", json!(1e308)),
                "falls, episodes or errors that are none",
            ),
            (
                with("error_xy_ci95", json!([0.1, 1e308])),
                "falls, episodes or errors that are none",
            ),
            (json!({"falls": {"rows": 3}}), "falls.rows: "),
            (
                json!({"falls": {"rows": [held(), {}]}}),
                "falls.rows[1]: missing field `command`",
            ),
            (json!({"falls": {"rows": [far]}}), "no robot walks"),
            (grid(json!([0.1, 0.2]), &cell), "tracking.grid"),
            (grid(json!([]), &json!([[[]]])), "tracking.grid"),
        ] {
            let error = Evaluation::read(&value).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
