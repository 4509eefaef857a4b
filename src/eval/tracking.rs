//! `tracking`: the command sequence of figure 7.9, the error by commanded velocity of figure 7.8, and a grid over the
//! bounds the policy was trained for.

use omniwalk_env::task::tracking::Tracking;
use serde_json::{Value, json};

use super::forward::Watch;
use super::hold::{self, Row};
use super::meter::Record;
use super::pictures;
use super::stats::Estimate;
use super::suites::{Plan, Results};
use super::summary::{ERRORS_HEAD, Errors, gait_json, gait_text, name, row_json, rows_text};
use super::table::number;
use super::tour::{Leg, Moment, Tour};
use super::trial::Stage;
use crate::report::evaluation::Picture;

/// The commands of figure 7.9 in its order: in place, forward, backward, left, right, turning, diagonal in all four
/// directions, turning while walking forward and sideways.
pub const SEQUENCE: [[f64; 3]; 20] = [
    [0.0, 0.0, 0.0],
    [0.3, 0.0, 0.0],
    [0.6, 0.0, 0.0],
    [-0.15, 0.0, 0.0],
    [-0.5, 0.0, 0.0],
    [0.0, 0.15, 0.0],
    [0.0, 0.5, 0.0],
    [0.0, -0.15, 0.0],
    [0.0, -0.5, 0.0],
    [0.0, 0.0, 0.5],
    [0.0, 0.0, -0.5],
    [0.3, 0.3, 0.0],
    [0.3, -0.3, 0.0],
    [-0.3, 0.3, 0.0],
    [-0.3, -0.3, 0.0],
    [0.3, 0.0, 0.3],
    [0.3, 0.0, -0.3],
    [0.0, 0.3, 0.3],
    [0.0, -0.3, -0.3],
    [0.0, 0.0, 0.0],
];

/// Time at each command, s.
const SECONDS: f64 = 10.0;

/// Distance between commands along one axis, m/s or rad/s.
const STEP: f64 = 0.1;

/// Values of the grid along v_x, v_y and omega_z.
const GRID: [usize; 3] = [7, 7, 5];

/// What came of it.
pub struct Tracked {
    /// The first of the sequences of figure 7.9, step by step.
    pub trace: Vec<Moment>,
    /// Duration of a step, s.
    pub dt: f64,
    sequences: Vec<Vec<Leg>>,
    records: Vec<Record>,
    /// Commands along one axis, axis by axis.
    rows: Vec<Row>,
    /// Values of the grid along each axis.
    axes: [Vec<f64>; 3],
    /// Its rows: omega_z outermost, v_x innermost.
    grid: Vec<Row>,
}

impl Tracked {
    /// Plays the suite; `watch` sees the sequences of figure 7.9.
    ///
    /// # Errors
    /// Those of [`Stage::play`].
    pub fn play(stage: &mut Stage<'_>, part: u64, plan: &Plan, watch: Option<&mut dyn Watch>) -> miette::Result<Self> {
        let seconds = plan.seconds.unwrap_or(SECONDS);
        let (steps, hz) = (stage.steps(seconds), stage.config.engine.control_hz);
        let mut tours: Vec<Tour> = (0..plan.episodes)
            .map(|i| Tour::new(SEQUENCE.to_vec(), steps, hz, i == 0))
            .collect();
        stage.play(part, &mut tours, watch)?;
        let (lower, upper) = (stage.config.command.lower, stage.config.command.upper);
        let rows = hold::play(stage, part + 1, &along_axes(lower, upper), plan.episodes, seconds)?;
        let axes = [0, 1, 2].map(|k| spread(lower[k], upper[k], GRID[k]));
        let grid = hold::play(stage, part + 2, &over(&axes), plan.episodes, seconds)?;
        Ok(Self {
            trace: tours[0].trace().to_vec(),
            dt: stage.config.control_dt(),
            records: tours.iter().flat_map(|tour| tour.records().to_vec()).collect(),
            sequences: tours.iter().map(|tour| tour.legs().to_vec()).collect(),
            rows,
            axes,
            grid,
        })
    }

    /// Error and falls of command `i` of the sequence.
    fn leg(&self, i: usize) -> (Errors, usize) {
        let legs = || self.sequences.iter().map(move |legs| &legs[i]);
        let errors = Errors::of(legs().map(|leg| &leg.tracking));
        (errors, legs().filter(|leg| leg.end.is_some()).count())
    }

    /// The value of each cell of the grid, nested as `[omega_z][v_y][v_x]`.
    fn cells(&self, value: impl Fn(&Row) -> Value) -> Value {
        let [x, y, _] = [0, 1, 2].map(|k| self.axes[k].len());
        let line = |rows: &[Row]| rows.iter().map(&value).collect::<Value>();
        let slice = |rows: &[Row]| rows.chunks(x).map(line).collect::<Value>();
        self.grid.chunks(x * y).map(slice).collect()
    }
}

/// Every multiple of [`STEP`] along each axis alone within the bounds; standing once.
fn along_axes(lower: [f64; 3], upper: [f64; 3]) -> Vec<[f64; 3]> {
    let mut commands = Vec::new();
    for axis in 0..3 {
        let reach = |bound: f64| (bound / STEP + 1e-9).floor() as i32;
        for step in -reach(-lower[axis])..=reach(upper[axis]) {
            let mut command = [0.0; 3];
            command[axis] = f64::from(step) / (1.0 / STEP);
            if step != 0 || axis == 0 {
                commands.push(command);
            }
        }
    }
    commands
}

/// `n` values from `lower` to `upper`; a single one if they are the same.
fn spread(lower: f64, upper: f64, n: usize) -> Vec<f64> {
    if lower == upper {
        return vec![lower];
    }
    let share = |i: usize| i as f64 / (n - 1) as f64;
    // Both ends exactly, and nought where it is the middle.
    (0..n).map(|i| lower * (1.0 - share(i)) + upper * share(i)).collect()
}

/// All combinations, the first axis innermost.
fn over([x, y, turn]: &[Vec<f64>; 3]) -> Vec<[f64; 3]> {
    let line = |turn: f64, y: f64| x.iter().map(move |&x| [x, y, turn]);
    turn.iter()
        .flat_map(|&turn| y.iter().flat_map(move |&y| line(turn, y)))
        .collect()
}

/// Mean error over commands, each of which counts once: what a bound on the error is held against.
fn overall(rows: &[Row]) -> [f64; 2] {
    let mean = |value: fn(&Tracking) -> f64| {
        let of_row = |row: &Row| {
            let held: Vec<f64> = row
                .records
                .iter()
                .filter_map(|r| r.tracking.as_ref().map(value))
                .collect();
            Estimate::mean(&held).value
        };
        let values: Vec<f64> = rows.iter().map(of_row).filter(|x| x.is_finite()).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    [mean(|t| t.error_xy_mps), mean(|t| t.error_yaw_radps)]
}

fn falls(rows: &[Row]) -> [usize; 2] {
    let sequences = rows.iter().map(|row| row.records.len()).sum();
    [rows.iter().map(Row::falls).sum(), sequences]
}

impl Results for Tracked {
    fn json(&self) -> Value {
        let sequence = (0..SEQUENCE.len()).map(|i| {
            let (errors, falls) = self.leg(i);
            let mut out = json!({ "command": SEQUENCE[i], "episodes": self.sequences.len(), "falls": falls });
            errors.write_to(&mut out);
            out
        });
        let errors = |row: &Row| Errors::of_row(row);
        let ([xy, yaw], [grid_xy, grid_yaw]) = (overall(&self.rows), overall(&self.grid));
        json!({
            "error_xy_mps": number(xy),
            "error_yaw_radps": number(yaw),
            "rows": self.rows.iter().map(row_json).collect::<Vec<_>>(),
            "sequence": { "rows": sequence.collect::<Vec<_>>(), "gait": gait_json(&self.records) },
            "grid": {
                "order": "[omega_z][v_y][v_x]",
                "v_x": self.axes[0], "v_y": self.axes[1], "omega_z": self.axes[2],
                "episodes": self.grid[0].records.len(),
                "error_xy_mps": number(grid_xy),
                "error_yaw_radps": number(grid_yaw),
                "falls": falls(&self.grid)[0],
                "cells": {
                    "error_xy_mps": self.cells(|row| number(errors(row).xy.value)),
                    "error_yaw_radps": self.cells(|row| number(errors(row).yaw.value)),
                    "falls": self.cells(|row| json!(row.falls())),
                },
            },
        })
    }

    fn text(&self) -> String {
        let mut out = format!("{:<22}     falls  {ERRORS_HEAD}\n", "sequence of fig. 7.9");
        for (i, &command) in SEQUENCE.iter().enumerate() {
            let (errors, falls) = self.leg(i);
            let n = self.sequences.len();
            out += &format!("{}  {falls:>3}/{n:<4}  {}\n", name(command), errors.to_text());
        }
        let [xy, yaw] = overall(&self.rows);
        let [grid_xy, grid_yaw] = overall(&self.grid);
        let ([fell, n], [grid_fell, grid_n]) = (falls(&self.rows), falls(&self.grid));
        let gaits = self.rows.iter().map(|row| (name(row.command), &row.records[..]));
        let sequence = ("sequence of fig. 7.9".to_owned(), &self.records[..]);
        out += &rows_text(&self.rows);
        out += &format!("along the axes: {xy:.3} m/s, {yaw:.3} rad/s, {fell} of {n} fell\n");
        out += &format!(
            "grid of {} commands: {grid_xy:.3} m/s, {grid_yaw:.3} rad/s, {grid_fell} of {grid_n} fell\n",
            self.grid.len()
        );
        out + &gait_text(std::iter::once(sequence).chain(gaits))
    }

    fn pictures(&self) -> miette::Result<Vec<Picture>> {
        Ok(vec![("eval_velocity.png", pictures::velocity(self)?)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_along_the_axes_reach_the_bounds_and_no_farther() {
        let commands = along_axes([-0.3, -0.25, 0.0], [0.6, 0.0, 0.1]);
        assert_eq!(commands.len(), (3 + 1 + 6) + 2 + 1);
        assert!(commands.contains(&[0.6, 0.0, 0.0]) && commands.contains(&[-0.3, 0.0, 0.0]));
        assert!(commands.contains(&[0.0, -0.2, 0.0]) && commands.contains(&[0.0, 0.0, 0.1]));
        assert_eq!(commands.iter().filter(|c| **c == [0.0; 3]).count(), 1);
    }

    #[test]
    fn the_grid_spans_the_bounds_with_nought_in_its_middle() {
        let axes = [spread(-0.6, 0.6, 7), spread(-0.6, 0.6, 7), spread(0.2, 0.2, 5)];
        assert_eq!((axes[0][0], axes[0][3], axes[0][6]), (-0.6, 0.0, 0.6));
        assert_eq!(axes[2], [0.2]);
        let commands = over(&axes);
        assert_eq!(commands.len(), 49);
        assert_eq!(commands[1], [axes[0][1], -0.6, 0.2]);
    }
}
