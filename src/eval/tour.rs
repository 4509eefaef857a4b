//! Commands one after another without a stop; a robot that falls stands up again for the next one.

use omniwalk_env::task::episode::End;
use omniwalk_env::task::tracking::Tracking;

use super::meter::{CommandMeter, Meter, Record};
use super::trial::{Ask, Seen, Trial};

/// A sequence of commands for one environment.
///
/// Each lasts the same number of steps. A fall ends its command; the robot is reset to standing and is at once asked
/// for the next.
pub struct Tour {
    commands: Vec<[f64; 3]>,
    steps: usize,
    step: usize,
    meter: Meter,
    held: CommandMeter,
    legs: Vec<Leg>,
    records: Vec<Record>,
    trace: Option<Vec<Moment>>,
}

/// What came of one command.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Desired velocity (m/s, m/s, rad/s).
    pub command: [f64; 3],
    /// How the robot fell; `None` if it did not.
    pub end: Option<End>,
    /// How well the command was held.
    pub tracking: Option<Tracking>,
}

/// A control step as figure 7.9 shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Desired velocity (m/s, m/s, rad/s).
    pub desired: [f64; 3],
    /// True velocity in the heading frame (m/s, m/s, rad/s); not a number after a fall.
    pub velocity: [f64; 3],
}

impl Tour {
    /// `commands` for `steps` control steps each, with or without a trace of every step.
    pub fn new(commands: Vec<[f64; 3]>, steps: usize, control_hz: u32, traced: bool) -> Self {
        Self {
            steps,
            step: 0,
            meter: Meter::new(control_hz),
            held: CommandMeter::new(control_hz),
            legs: Vec::with_capacity(commands.len()),
            records: Vec::new(),
            trace: traced.then(|| Vec::with_capacity(commands.len() * steps)),
            commands,
        }
    }

    /// What came of each command, in order.
    pub fn legs(&self) -> &[Leg] {
        &self.legs
    }

    /// One record for each stretch between two resets.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// Every control step, if it was traced.
    pub fn trace(&self) -> &[Moment] {
        self.trace.as_deref().unwrap_or_default()
    }
}

impl Trial for Tour {
    fn ask(&mut self) -> Option<Ask> {
        self.commands.get(self.legs.len()).map(|&command| Ask::walk(command))
    }

    fn see(&mut self, seen: &Seen<'_>) {
        self.step += 1;
        let command = self.commands[self.legs.len()];
        if seen.ended.is_none() {
            self.meter.step(seen);
            self.held.step(seen);
        }
        if let Some(trace) = &mut self.trace {
            trace.push(Moment {
                desired: command,
                velocity: seen.ended.map_or_else(|| seen.velocity(), |_| [f64::NAN; 3]),
            });
        }
        if seen.ended.is_none() && self.step < self.steps {
            return;
        }
        self.step = 0;
        self.legs.push(Leg {
            command,
            end: seen.ended.map(|episode| episode.end),
            tracking: self.held.take(),
        });
        if seen.ended.is_some() || self.legs.len() == self.commands.len() {
            self.records.push(self.meter.record(seen));
        }
    }
}
