//! `changes`: 160 random commands in sequence (thesis 7.5), 10 s each.
//!
//! They are played as ten sequences of sixteen side by side, which keeps all cores busy and gives the same figures
//! with any number of them; so ten of the changes start from standing, where the thesis's single sequence has one. A robot
//! that falls is reset to standing, the change counts as failed, and the next command follows at once.

use omniwalk_env::random::Stream;
use omniwalk_env::task::command::CommandRange;
use serde_json::{Value, json};

use super::meter::Record;
use super::stats::Estimate;
use super::suites::{Plan, Results};
use super::summary::{ERRORS_HEAD, Errors, gait_json, gait_text, interval, percent};
use super::tour::{Leg, Tour};
use super::trial::Stage;

/// Changes of a sequence; ten sequences make 160.
const CHANGES: usize = 16;

/// Time at a command, s.
const SECONDS: f64 = 10.0;

/// What came of it.
pub struct Changes {
    legs: Vec<Leg>,
    records: Vec<Record>,
}

impl Changes {
    /// Plays the suite.
    ///
    /// # Errors
    /// Those of [`Stage::play`].
    pub fn play(stage: &mut Stage<'_>, part: u64, plan: &Plan) -> miette::Result<Self> {
        let steps = stage.steps(plan.seconds.unwrap_or(SECONDS));
        let bounds = &stage.config.command;
        let range = CommandRange {
            lower: bounds.lower,
            upper: bounds.upper,
            zero_share: 0.0,
            axis_share: 0.0,
        };
        let commands = commands(&range, stage.seed, plan.episodes);
        let hz = stage.config.engine.control_hz;
        let tour = |commands| Tour::new(commands, steps, hz, false);
        let mut tours: Vec<Tour> = commands.into_iter().map(tour).collect();
        stage.play(part, &mut tours, None)?;
        Ok(Self {
            legs: tours.iter().flat_map(|tour| tour.legs().to_vec()).collect(),
            records: tours.iter().flat_map(|tour| tour.records().to_vec()).collect(),
        })
    }

    fn survived(&self) -> usize {
        self.legs.iter().filter(|leg| leg.end.is_none()).count()
    }

    fn errors(&self) -> Errors {
        Errors::of(self.legs.iter().map(|leg| &leg.tracking))
    }
}

/// Uniform draws from the bounds the policy was trained for, [`CHANGES`] for each of `sequences`.
fn commands(range: &CommandRange, seed: u64, sequences: usize) -> Vec<Vec<[f64; 3]>> {
    // Environments draw from streams of episodes from nought on.
    let stream = |sequence: usize| Stream::new(seed, sequence as u64, u64::MAX);
    let draw = |sequence| {
        let mut stream = stream(sequence);
        (0..CHANGES).map(|_| range.draw(&mut stream)).collect()
    };
    (0..sequences).map(draw).collect()
}

impl Results for Changes {
    fn json(&self) -> Value {
        let (survived, total) = (self.survived(), self.legs.len());
        let failed = self.legs.iter().filter(|leg| leg.end.is_some());
        let mut out = json!({
            "total": total,
            "survived": survived,
            "survived_share_ci95": interval(&Estimate::share(survived, total)),
            "failed": failed.map(|leg| leg.command).collect::<Vec<_>>(),
            "gait": gait_json(&self.records),
        });
        self.errors().write_to(&mut out);
        out
    }

    fn text(&self) -> String {
        let (survived, total) = (self.survived(), self.legs.len());
        format!(
            "survived         95 %  {ERRORS_HEAD}\n{survived:>3}/{total:<4} {:>12}  {}\n{}",
            percent(&Estimate::share(survived, total)),
            self.errors().to_text(),
            gait_text([("all changes".to_owned(), &self.records[..])])
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_sequences_are_160_commands_within_the_bounds_and_a_sequence_keeps_its_own() {
        let range = CommandRange {
            lower: [-0.6, -0.5, 0.0],
            upper: [0.6, 0.5, 0.4],
            zero_share: 0.0,
            axis_share: 0.0,
        };
        let ten = commands(&range, 7, 10);
        assert_eq!(ten.iter().map(Vec::len).sum::<usize>(), 160);
        let inside = |c: &[f64; 3]| (0..3).all(|k| (range.lower[k]..=range.upper[k]).contains(&c[k]));
        assert!(ten.iter().flatten().all(inside));
        assert_eq!(ten[..3], commands(&range, 7, 3)[..]);
        assert_ne!(ten[0], ten[1]);
        assert_ne!(ten, commands(&range, 8, 10));
    }
}
