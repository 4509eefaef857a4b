//! `push`: how strong a push the walking robot survives (table 7.2).
//!
//! [`super::pushing`] says what a push is. From 10 N on, the force grows by 10 N until none of the pushes of a command and direction is recovered.

use serde_json::{Value, json};

use super::meter::Record;
use super::pushing::{DIRECTIONS, Direction, Push};
use super::suites::{Plan, Results};
use super::summary::{gait_json, gait_text, name};
use super::trial::Stage;

/// The commands of table 7.2 (m/s, m/s, rad/s).
pub const COMMANDS: [[f64; 3]; 5] = [
    [0.0, 0.0, 0.0],
    [0.3, 0.0, 0.0],
    [0.6, 0.0, 0.0],
    [0.0, 0.25, 0.0],
    [0.0, 0.5, 0.0],
];

/// Table 7.2 by command and direction: the highest force with all ten pushes recovered and with any, N. Its first
/// three rows print one lateral value.
pub const THESIS: [[[f64; 2]; 4]; 5] = [
    [[40.0, 60.0], [20.0, 30.0], [50.0, 90.0], [50.0, 90.0]],
    [[30.0, 50.0], [20.0, 30.0], [50.0, 80.0], [50.0, 80.0]],
    [[30.0, 50.0], [10.0, 20.0], [40.0, 70.0], [40.0, 70.0]],
    [[40.0, 60.0], [20.0, 30.0], [40.0, 60.0], [40.0, 100.0]],
    [[40.0, 60.0], [20.0, 30.0], [20.0, 60.0], [50.0, 100.0]],
];

/// First force and step, N.
const STEP: f64 = 10.0;
/// Steps after which nobody pushes harder, whatever is recovered.
const MOST_STEPS: usize = 100;

/// Pushes at one command from one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Desired velocity (m/s, m/s, rad/s).
    pub command: [f64; 3],
    /// Where the pushes come from.
    pub direction: Direction,
    /// How many were recovered at each force: entry `i` at `i + 1` steps of 10 N.
    pub recovered: Vec<usize>,
    /// Of those that were not, how many ended in legs that passed through each other.
    pub overlapped: Vec<usize>,
    /// Pushes at each force.
    pub pushes: usize,
}

impl Cell {
    /// The highest force at which as many pushes as `enough` says were recovered, N; nought if none.
    fn highest(&self, enough: impl Fn(usize) -> bool) -> f64 {
        let steps = self.recovered.iter().rposition(|&n| enough(n)).map_or(0, |i| i + 1);
        steps as f64 * STEP
    }

    /// The highest force with every push recovered, N.
    pub fn all(&self) -> f64 {
        self.highest(|n| n == self.pushes)
    }

    /// The highest force with any push recovered, N.
    pub fn any(&self) -> f64 {
        self.highest(|n| n > 0)
    }

    /// Whether the pushes go on.
    fn open(&self) -> bool {
        self.recovered.last() != Some(&0) && self.recovered.len() < MOST_STEPS
    }
}

/// Pushes harder and harder, with `push` giving for each of the cells that are still open how many pushes of a force
/// were recovered, and in how many the legs passed through each other.
fn climb(
    cells: &mut [Cell],
    mut push: impl FnMut(f64, &[&Cell]) -> miette::Result<Vec<(usize, usize)>>,
) -> miette::Result<()> {
    for step in 1.. {
        let open: Vec<&Cell> = cells.iter().filter(|cell| cell.open()).collect();
        if open.is_empty() {
            break;
        }
        let results = push(step as f64 * STEP, &open)?;
        let open = cells.iter_mut().filter(|cell| cell.open());
        for (cell, (recovered, overlapped)) in open.zip(results) {
            cell.recovered.push(recovered);
            cell.overlapped.push(overlapped);
        }
    }
    Ok(())
}

/// What came of it.
pub struct Pushes {
    /// Command by command, directions in order.
    cells: Vec<Cell>,
    /// The gait before the pushes, for each command.
    before: Vec<Vec<Record>>,
}

impl Pushes {
    /// Plays the suite.
    ///
    /// # Errors
    /// Those of [`Stage::play`].
    pub fn play(stage: &mut Stage<'_>, part: u64, plan: &Plan) -> miette::Result<Self> {
        let n = plan.episodes;
        let mut cells: Vec<Cell> = COMMANDS
            .iter()
            .flat_map(|&command| {
                DIRECTIONS.map(|direction| Cell {
                    command,
                    direction,
                    recovered: Vec::new(),
                    overlapped: Vec::new(),
                    pushes: n,
                })
            })
            .collect();
        let mut before = vec![Vec::new(); COMMANDS.len()];
        climb(&mut cells, |force, open| {
            let pushes = open
                .iter()
                .flat_map(|cell| (0..n).map(move |k| (cell, k as f64 / n as f64)));
            let mut trials: Vec<Push> = pushes
                .map(|(cell, share)| Push::new(cell.command, cell.direction, force, share, stage, plan))
                .collect();
            stage.play(part, &mut trials, None)?;
            let count = |what: fn(&Push) -> bool| {
                let cells = trials.chunks(n);
                cells.map(move |pushes| pushes.iter().filter(|push| what(push)).count())
            };
            let results = count(Push::recovered).zip(count(Push::overlapped)).collect();
            if force == STEP {
                for (command, records) in trials.into_iter().map(Push::before) {
                    let row = COMMANDS.iter().position(|c| *c == command).unwrap_or(0);
                    before[row].extend(records);
                }
            }
            Ok(results)
        })?;
        Ok(Self { cells, before })
    }
}

impl Results for Pushes {
    fn json(&self) -> Value {
        let rows = self.cells.iter().enumerate().map(|(i, cell)| {
            let [all, any] = THESIS[i / DIRECTIONS.len()][i % DIRECTIONS.len()];
            json!({
                "command": cell.command,
                "direction": cell.direction.name(),
                "pushes": cell.pushes,
                "all_ten_n": cell.all(),
                "max_n": cell.any(),
                "thesis_all_ten_n": all,
                "thesis_max_n": any,
                "recovered": cell.recovered,
                "leg_overlap": cell.overlapped,
            })
        });
        let gaits = COMMANDS.iter().zip(&self.before).map(|(command, records)| {
            let falls = records.iter().filter(|r| r.end.is_some()).count();
            json!({ "command": command, "falls_before": falls, "gait": gait_json(records) })
        });
        json!({ "step_n": STEP, "rows": rows.collect::<Vec<_>>(), "before": gaits.collect::<Vec<_>>() })
    }

    fn text(&self) -> String {
        let mut out = format!("{:<22}", "push, N: all / any");
        for direction in DIRECTIONS {
            out += &format!(" {:>9} (thesis)", direction.name());
        }
        out += "  fell before\n";
        let rows = self.cells.chunks(DIRECTIONS.len()).zip(&THESIS).zip(&self.before);
        for ((cells, thesis), before) in rows {
            out += &name(cells[0].command);
            for (cell, [all, any]) in cells.iter().zip(thesis) {
                out += &format!(" {:>4}/{:<4} {:>8}", cell.all(), cell.any(), format!("({all}/{any})"));
            }
            let falls = before.iter().filter(|r| r.end.is_some()).count();
            out += &format!("  {falls:>4}/{}\n", before.len());
        }
        let gaits = COMMANDS.iter().zip(&self.before);
        out + &gait_text(gaits.map(|(&command, records)| (name(command), &records[..])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(direction: Direction) -> Cell {
        Cell {
            command: [0.0; 3],
            direction,
            recovered: Vec::new(),
            overlapped: Vec::new(),
            pushes: 10,
        }
    }

    #[test]
    fn pushes_grow_until_none_is_recovered_and_each_cell_stops_by_itself() {
        let mut cells = [cell(Direction::Front), cell(Direction::Back), cell(Direction::Left)];
        let mut asked = Vec::new();
        climb(&mut cells, |force, open| {
            asked.push((force, open.len()));
            Ok(open
                .iter()
                .map(|cell| match cell.direction {
                    // All up to 20 N, nine at 30 N, all again at 40 N, then one, then none.
                    Direction::Front => [10, 10, 9, 10, 1, 0][(force / STEP) as usize - 1],
                    _ if force > 10.0 => 0,
                    Direction::Back => 4,
                    _ => 0,
                })
                .map(|recovered| (recovered, usize::from(recovered == 9)))
                .collect())
        })
        .unwrap();
        assert_eq!(
            asked,
            [(10.0, 3), (20.0, 2), (30.0, 1), (40.0, 1), (50.0, 1), (60.0, 1)]
        );
        assert_eq!([cells[0].all(), cells[0].any()], [40.0, 50.0]);
        assert_eq!(cells[0].overlapped, [0, 0, 1, 0, 0, 0]);
        assert_eq!([cells[1].all(), cells[1].any()], [0.0, 10.0]);
        assert_eq!([cells[2].all(), cells[2].any()], [0.0, 0.0]);
    }

    #[test]
    fn a_robot_that_nothing_topples_is_not_pushed_for_ever() {
        let mut cells = [cell(Direction::Right)];
        climb(&mut cells, |_, open| Ok(vec![(10, 0); open.len()])).unwrap();
        assert_eq!(cells[0].all(), MOST_STEPS as f64 * STEP);
    }
}
