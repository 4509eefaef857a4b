//! The suites of the thesis's evaluation (7.5): what each is called, asks for and gives.

use serde_json::Value;

use super::changes::Changes;
use super::falls::{self, Falls};
use super::forward::Watch;
use super::push::{self, Pushes};
use super::tracking::{self, Tracked};
use super::trial::Stage;
use crate::report::evaluation::Picture;

/// The conditions of every suite, laid over those a policy was trained under.
pub const CONDITIONS: &str = include_str!("conditions.toml");

/// A suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Suite {
    /// Falls in long sequences: table 7.1.
    Falls,
    /// How well commands are held: figures 7.8 and 7.9.
    Tracking,
    /// Random commands one after another.
    Changes,
    /// Push recovery: table 7.2.
    Push,
}

/// Every suite, in the order they are played.
pub const ALL: [Suite; 4] = [Suite::Falls, Suite::Tracking, Suite::Changes, Suite::Push];

/// How much is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Sequences for each command; the thesis has ten.
    pub episodes: usize,
    /// Length of a sequence, s; the suite's own if none.
    pub seconds: Option<f64>,
}

/// What came of a suite under one set of conditions.
pub trait Results {
    /// For programs.
    fn json(&self) -> Value;

    /// For people.
    fn text(&self) -> String;

    /// To look at, beside what is drawn from [`Results::json`].
    ///
    /// # Errors
    /// When drawing fails.
    fn pictures(&self) -> miette::Result<Vec<Picture>> {
        Ok(Vec::new())
    }
}

impl Suite {
    /// Its name on the command line and in `eval.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Falls => "falls",
            Self::Tracking => "tracking",
            Self::Changes => "changes",
            Self::Push => "push",
        }
    }

    /// The suite of that name.
    pub fn named(name: &str) -> Option<Self> {
        ALL.into_iter().find(|suite| suite.name() == name)
    }

    /// The fixed commands a policy must have been trained for.
    pub fn commands(self) -> &'static [[f64; 3]] {
        match self {
            Self::Falls => &falls::COMMANDS,
            Self::Tracking => &tracking::SEQUENCE,
            Self::Changes => &[],
            Self::Push => &push::COMMANDS,
        }
    }

    /// What is kept as logs: file name and environment.
    pub fn rollouts(self) -> Vec<(String, usize)> {
        match self {
            Self::Tracking => vec![("tracking.mcap".to_owned(), 0)],
            _ => Vec::new(),
        }
    }

    /// Plays the suite; `watch` sees environments of which a log is kept.
    ///
    /// # Errors
    /// Those of [`Stage::play`].
    pub fn play(
        self,
        stage: &mut Stage<'_>,
        plan: &Plan,
        watch: Option<&mut dyn Watch>,
    ) -> miette::Result<Box<dyn Results>> {
        // Parts of suites are numbered from multiples of 16.
        let part = 16 * (1 + self as u64);
        Ok(match self {
            Self::Falls => Box::new(Falls::play(stage, part, plan)?),
            Self::Tracking => Box::new(Tracked::play(stage, part, plan, watch)?),
            Self::Changes => Box::new(Changes::play(stage, part, plan)?),
            Self::Push => Box::new(Pushes::play(stage, part, plan)?),
        })
    }
}
