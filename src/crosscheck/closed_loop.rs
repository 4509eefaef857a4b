//! The third gate: the policy walks in MuJoCo what it walks in an engine of the project.
//!
//! The evaluation's suites are played twice, with the same seeds: commands, friction, latency, noise, the joints' response and
//! the pushes are the same numbers in both. In an engine of the project legs that touch end a sequence; in MuJoCo they
//! collide, and the sequence goes on until the robot falls.

use std::fmt::Write as _;

use miette::miette;
use omniwalk_env::EnvConfig;
use omniwalk_env::engine::Maker;
use serde_json::{Map, Value, json};

use super::subject::Subject;
use crate::eval::hold;
use crate::eval::player::Player;
use crate::eval::suites::{Plan, Suite};
use crate::eval::summary::row_json;
use crate::eval::table::number;
use crate::eval::trial::Stage;

/// Least share of the engine's survivals that must be there in MuJoCo.
pub const LEAST_SURVIVAL: f64 = 0.95;
/// Largest velocity error in MuJoCo over the engine's.
pub const LARGEST_ERROR: f64 = 1.3;

/// What is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The commands of the run's `[eval]` section.
    Commands,
    /// A suite of the evaluation.
    Suite(Suite),
}

/// Every part, in the order they are played.
pub const PARTS: [Part; 4] = [
    Part::Commands,
    Part::Suite(Suite::Falls),
    Part::Suite(Suite::Tracking),
    Part::Suite(Suite::Push),
];

impl Part {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Commands => "commands",
            Self::Suite(suite) => suite.name(),
        }
    }

    /// What the policy must have been trained for.
    pub fn commands(self, subject: &Subject) -> &[[f64; 3]] {
        match self {
            Self::Commands => &subject.settings.eval.commands,
            Self::Suite(suite) => suite.commands(),
        }
    }
}

/// Plays `parts` with the policy of `subject` under `config`; the results by part.
///
/// # Errors
/// When robot, configuration and engine do not fit together.
pub fn play(
    subject: &Subject,
    config: &EnvConfig,
    engines: &dyn Maker,
    parts: &[Part],
    plan: &Plan,
    seed: u64,
) -> miette::Result<Map<String, Value>> {
    let mut player = Player::Controller(Box::new(subject.controller()?));
    let mut stage = Stage {
        robot: subject.robot.clone(),
        config: config.clone(),
        seed,
        engines,
        policy: &mut |observations, actions| player.mode(observations, actions),
    };
    let mut results = Map::new();
    for part in parts {
        let result = match part {
            Part::Suite(suite) => suite.play(&mut stage, plan, None)?.json(),
            Part::Commands => {
                let commands = &subject.settings.eval.commands;
                let seconds = plan.seconds.unwrap_or(subject.settings.eval.seconds);
                let rows = hold::play(&mut stage, 0, commands, plan.episodes, seconds)?;
                json!({ "rows": rows.iter().map(row_json).collect::<Vec<_>>() })
            }
        };
        results.insert(part.name().into(), result);
    }
    Ok(results)
}

/// How the policy walks in one engine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Walk {
    /// Sequences, and how many of them were walked to their end.
    pub sequences: u64,
    /// See above.
    pub survived: u64,
    /// Mean error over the commands that were held in both engines, m/s.
    pub error_xy: f64,
    /// The same of turning, rad/s.
    pub error_yaw: f64,
    /// Mean distance of the mean velocity from the command along each axis, m/s, m/s, rad/s.
    pub error_axes: [f64; 3],
    /// Means over commands and directions of the strongest push that was always, and at times, recovered, N.
    pub push: Option<[f64; 2]>,
}

impl Walk {
    /// Share of the sequences that were walked to their end.
    pub fn survival(&self) -> f64 {
        self.survived as f64 / self.sequences as f64
    }

    fn json(&self) -> Value {
        json!({
            "sequences": self.sequences,
            "survived": self.survived,
            "survival": number(self.survival()),
            "error_xy_mps": number(self.error_xy),
            "error_yaw_radps": number(self.error_yaw),
            "error_by_axis": self.error_axes.map(number),
            "push_all_n": self.push.map(|[all, _]| number(all)),
            "push_any_n": self.push.map(|[_, any]| number(any)),
        })
    }
}

/// The walks in an engine of the project and in MuJoCo.
pub fn walks(engine: &Map<String, Value>, mujoco: &Map<String, Value>) -> [Walk; 2] {
    let held = |row: &Value| row["error_xy_mps"].is_number();
    let both: Vec<bool> = rows(engine)
        .zip(rows(mujoco))
        .map(|(a, b)| held(a) && held(b))
        .collect();
    [engine, mujoco].map(|results| {
        let mut walk = Walk::default();
        let grid = results.get("tracking").map(|tracking| &tracking["grid"]);
        for row in rows(results) {
            add_sequences(&mut walk, row["episodes"].as_u64(), row["falls"].as_u64());
        }
        if let Some(grid) = grid {
            let cells = ["v_x", "v_y", "omega_z"].map(|axis| grid[axis].as_array().map_or(0, Vec::len) as u64);
            let each = grid["episodes"].as_u64().unwrap_or(0);
            add_sequences(
                &mut walk,
                Some(each * cells.iter().product::<u64>()),
                grid["falls"].as_u64(),
            );
        }
        let rows = || rows(results).zip(&both).filter_map(|(row, &both)| both.then_some(row));
        let mean = |value: &dyn Fn(&Value) -> f64| {
            let values: Vec<f64> = rows().map(value).filter(|x| x.is_finite()).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        let at = |row: &Value, pointer: &str| row.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
        walk.error_xy = mean(&|row| at(row, "/error_xy_mps"));
        walk.error_yaw = mean(&|row| at(row, "/error_yaw_radps"));
        walk.error_axes = [0, 1, 2]
            .map(|k| mean(&|row| (at(row, &format!("/velocity/{k}")) - at(row, &format!("/command/{k}"))).abs()));
        walk.push = results
            .get("push")
            .and_then(|push| push["rows"].as_array())
            .map(|rows| {
                ["/all_ten_n", "/max_n"]
                    .map(|pointer| rows.iter().map(|row| at(row, pointer)).sum::<f64>() / rows.len() as f64)
            });
        walk
    })
}

/// Whether there is something to compare in what was walked in an engine.
///
/// # Errors
/// When sequences were walked to their end and none lasted long enough for a velocity.
pub fn measured(results: &Map<String, Value>) -> miette::Result<()> {
    let [walk, _] = walks(results, results);
    if walk.survived > 0 && !walk.error_xy.is_finite() {
        return Err(miette!(
            help = "give longer ones by --seconds",
            "the sequences end before a velocity is measured: that begins a second after a command is reached, and takes another"
        ));
    }
    Ok(())
}

fn add_sequences(walk: &mut Walk, sequences: Option<u64>, falls: Option<u64>) {
    let (sequences, falls) = (sequences.unwrap_or(0), falls.unwrap_or(0));
    walk.sequences += sequences;
    walk.survived += sequences.saturating_sub(falls);
}

/// The rows that ask for one command each.
fn rows(results: &Map<String, Value>) -> impl Iterator<Item = &Value> {
    let held = ["commands", "falls", "tracking"]
        .into_iter()
        .filter_map(|part| results.get(part));
    held.filter_map(|result| result["rows"].as_array()).flatten()
}

/// The verdict over what was walked in `engine` and in MuJoCo, with all of it.
pub fn verdict(name: &str, engine: Map<String, Value>, mujoco: Map<String, Value>) -> Value {
    let [ours, theirs] = walks(&engine, &mujoco);
    let survival = theirs.survival() / ours.survival();
    let ratio = |value: fn(&Walk) -> f64| value(&theirs) / value(&ours);
    let (xy, yaw) = (ratio(|walk| walk.error_xy), ratio(|walk| walk.error_yaw));
    json!({
        "pass": survival >= LEAST_SURVIVAL && xy <= LARGEST_ERROR,
        "engine": name,
        "survival_ratio": number(survival),
        "velocity_error_ratio": number(xy),
        "turn_error_ratio": number(yaw),
        "bounds": { "survival_ratio": LEAST_SURVIVAL, "velocity_error_ratio": LARGEST_ERROR },
        name: ours.json(),
        "mujoco": theirs.json(),
        "details": { name: engine, "mujoco": mujoco },
    })
}

/// The verdict for people.
pub fn text(verdict: &Value) -> String {
    let name = verdict["engine"].as_str().unwrap_or("engine");
    let mut out = format!("closed loop          {name:>9}    MuJoCo     ratio\n");
    let figure = |side: &str, pointer: &str| verdict[side].pointer(pointer).and_then(Value::as_f64);
    for (label, pointer) in FIGURES {
        let (Some(ours), Some(theirs)) = (figure(name, pointer), figure("mujoco", pointer)) else {
            continue;
        };
        let _ = writeln!(out, "{label:<20} {ours:>9.3} {theirs:>9.3} {:>9.3}", theirs / ours);
    }
    out + if verdict["pass"] == true { "pass" } else { "FAIL" }
}

/// What is shown of each engine: what it is, and where it is.
pub const FIGURES: [(&str, &str); 8] = [
    ("survival", "/survival"),
    ("error, m/s", "/error_xy_mps"),
    ("error, rad/s", "/error_yaw_radps"),
    ("error along x, m/s", "/error_by_axis/0"),
    ("error along y, m/s", "/error_by_axis/1"),
    ("error turning, rad/s", "/error_by_axis/2"),
    ("every push to, N", "/push_all_n"),
    ("any push to, N", "/push_any_n"),
];

#[cfg(test)]
mod tests {
    use super::*;

    fn results(falls: u64, error: Value, velocity: f64) -> Map<String, Value> {
        let row = json!({
            "command": [0.4, 0.0, 0.0], "episodes": 20, "falls": falls, "velocity": [velocity, 0.0, 0.0],
            "error_xy_mps": error, "error_yaw_radps": 0.1,
        });
        let fallen = json!({
            "command": [0.6, 0.0, 0.0], "episodes": 20, "falls": 20, "velocity": [null, null, null],
            "error_xy_mps": null, "error_yaw_radps": null,
        });
        [("commands".to_owned(), json!({ "rows": [row, fallen] }))]
            .into_iter()
            .collect()
    }

    #[test]
    fn the_gate_holds_survivals_and_errors_against_the_engines_own() {
        let passes = |falls, error: f64| {
            let verdict = verdict(
                "rapier",
                results(0, json!(0.05), 0.4),
                results(falls, json!(error), 0.3),
            );
            verdict["pass"].as_bool().unwrap()
        };
        assert!(passes(1, 0.064));
        assert!(!passes(2, 0.064), "18 of 20 survive");
        assert!(!passes(0, 0.066), "1.32 times the error");
    }

    #[test]
    fn commands_that_one_engine_never_held_do_not_enter_the_errors() {
        let [ours, theirs] = walks(&results(0, json!(0.05), 0.4), &results(3, json!(0.06), 0.3));
        assert_eq!((ours.sequences, ours.survived, theirs.survived), (40, 20, 17));
        assert_eq!((ours.error_xy, theirs.error_xy), (0.05, 0.06));
        assert!((theirs.error_axes[0] - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_policy_that_holds_no_command_anywhere_does_not_pass() {
        let nowhere = || results(20, Value::Null, 0.0);
        assert_eq!(verdict("lanes", nowhere(), nowhere())["pass"], false);
    }
}
