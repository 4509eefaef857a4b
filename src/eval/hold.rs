//! The simplest trial: a robot that stands is asked for one velocity for a while.

use super::meter::{Meter, Record};
use super::trial::{Ask, Seen, Stage, Trial};

/// A sequence at one command.
pub struct Hold {
    command: [f64; 3],
    steps: usize,
    step: usize,
    meter: Meter,
    record: Option<Record>,
}

impl Hold {
    /// `command` (m/s, m/s, rad/s) for `steps` control steps.
    pub fn new(command: [f64; 3], steps: usize, control_hz: u32) -> Self {
        Self {
            command,
            steps,
            step: 0,
            meter: Meter::new(control_hz),
            record: None,
        }
    }
}

impl Trial for Hold {
    fn ask(&mut self) -> Option<Ask> {
        self.record.is_none().then(|| Ask::walk(self.command))
    }

    fn see(&mut self, seen: &Seen<'_>) {
        self.step += 1;
        if seen.ended.is_none() {
            self.meter.step(seen);
        }
        if seen.ended.is_some() || self.step == self.steps {
            self.record = Some(self.meter.record(seen));
        }
    }
}

/// Sequences at one command.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Desired velocity (m/s, m/s, rad/s).
    pub command: [f64; 3],
    /// One record a sequence.
    pub records: Vec<Record>,
}

impl Row {
    /// Sequences that ended early.
    pub fn falls(&self) -> usize {
        self.records.iter().filter(|record| record.end.is_some()).count()
    }
}

/// Plays `sequences` of `seconds` at each of `commands`.
///
/// # Errors
/// Those of [`Stage::play`].
pub fn play(
    stage: &mut Stage<'_>,
    part: u64,
    commands: &[[f64; 3]],
    sequences: usize,
    seconds: f64,
) -> miette::Result<Vec<Row>> {
    let (steps, hz) = (stage.steps(seconds), stage.config.engine.control_hz);
    let each = commands
        .iter()
        .flat_map(|&command| std::iter::repeat_n(command, sequences));
    let mut trials: Vec<Hold> = each.map(|command| Hold::new(command, steps, hz)).collect();
    stage.play(part, &mut trials, None)?;
    let mut records = trials.into_iter().filter_map(|trial| trial.record);
    Ok(commands
        .iter()
        .map(|&command| Row {
            command,
            records: records.by_ref().take(sequences).collect(),
        })
        .collect())
}
