//! The whole configuration: one struct a section of the TOML files.

use std::path::PathBuf;

use omniwalk_env::config::EnvConfig;
use serde::{Deserialize, Serialize};

use crate::config::{Configuration, Fault, Invalid, Table};

/// The embedded defaults, the one place where they stand.
pub const DEFAULT: &str = include_str!("../configs/default.toml");

/// Everything a run is made of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// `[robot]`
    pub robot: RobotSection,
    /// The sections of the environments.
    #[serde(flatten)]
    pub env: EnvConfig,
    /// `[curriculum]`
    pub curriculum: omniwalk_curriculum::Config,
    /// `[ppo]`
    pub ppo: omniwalk_ppo::Config,
    /// `[train]`
    pub train: TrainSection,
    /// `[eval]`
    pub eval: EvalSection,
}

/// Section `[robot]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSection {
    /// Robot folder, or a URDF.
    pub path: PathBuf,
}

/// Section `[train]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainSection {
    /// Environments that collect samples side by side.
    pub environments: usize,
    /// Control steps each environment collects for an update.
    pub steps_per_update: usize,
    /// Control steps of all environments together; training ends with the first update that reaches it.
    pub steps: u64,
    /// Seed of everything random.
    pub seed: u64,
    /// Each sample is also learned from as its left-right mirror image.
    pub mirror: bool,
    /// Factor on rewards before they reach the learner.
    pub reward_scale: f64,
    /// Minutes between checkpoints.
    pub checkpoint_minutes: f64,
    /// Checkpoints that are kept.
    pub keep_checkpoints: usize,
}

/// Section `[eval]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvalSection {
    /// Desired velocities (m/s, m/s, rad/s) that are tried.
    pub commands: Vec<[f64; 3]>,
    /// Episodes for each.
    pub episodes: usize,
    /// Length of an episode, s.
    pub seconds: f64,
}

impl Settings {
    fn invalid_program(&self) -> Vec<(&'static str, String)> {
        let mut found = Vec::new();
        let mut require = |holds: bool, key: &'static str, right: &str| {
            if !holds {
                found.push((key, right.to_string()));
            }
        };
        require(
            !self.robot.path.as_os_str().is_empty(),
            "robot.path",
            "the path of a robot folder or a .urdf file",
        );
        let t = &self.train;
        // A world of rapier takes half a megabyte.
        require((1..=8192).contains(&t.environments), "train.environments", "1 to 8192");
        require(
            (1..=100_000).contains(&t.steps_per_update),
            "train.steps_per_update",
            "1 to 100000",
        );
        require(
            t.environments.saturating_mul(t.steps_per_update) <= 2_000_000,
            "train.steps_per_update",
            "at most 2 million divided by train.environments: that many samples of an update are in memory",
        );
        require(
            (1..=1_000_000_000_000_000).contains(&t.steps),
            "train.steps",
            "1 to 1e15",
        );
        require(
            t.reward_scale > 0.0 && t.reward_scale <= 1e6,
            "train.reward_scale",
            "above 0 and at most 1e6",
        );
        require(
            t.checkpoint_minutes > 0.0 && t.checkpoint_minutes <= 1e6,
            "train.checkpoint_minutes",
            "above 0 and at most 1e6",
        );
        require(
            (1..=1000).contains(&t.keep_checkpoints),
            "train.keep_checkpoints",
            "1 to 1000",
        );
        let e = &self.eval;
        require(!e.commands.is_empty(), "eval.commands", "at least one command");
        require(
            e.commands.iter().flatten().all(|x| x.is_finite()),
            "eval.commands",
            "finite numbers",
        );
        // They are all played side by side.
        require(
            e.episodes >= 1 && e.episodes.saturating_mul(e.commands.len()) <= 8192,
            "eval.episodes",
            "at least 1, and at most 8192 over all commands",
        );
        require(
            e.seconds * f64::from(self.env.engine.control_hz) >= 2.0 && e.seconds <= 3600.0,
            "eval.seconds",
            "at least two control steps and at most 3600",
        );
        found
    }
}

impl Configuration for Settings {
    fn read(table: &mut Table<'_>) -> Result<Self, Fault> {
        Ok(Self {
            robot: table.entry("robot")?,
            env: table.part()?,
            curriculum: table.entry("curriculum")?,
            ppo: table.entry("ppo")?,
            train: table.entry("train")?,
            eval: table.entry("eval")?,
        })
    }

    fn validate(&self) -> Result<(), Vec<Invalid>> {
        let mut found = self.env.invalid();
        found.extend(self.curriculum.invalid());
        let within =
            |k: usize| (self.env.command.lower[k]..=self.env.command.upper[k]).contains(&self.curriculum.core[k]);
        if self.curriculum.scheduler && !(0..3).all(within) {
            let message = format!(
                "within command.lower = {:?} and command.upper = {:?}",
                self.env.command.lower, self.env.command.upper
            );
            found.push(("curriculum.core", message));
        }
        found.extend(self.invalid_program());
        let mut found: Vec<Invalid> = found
            .into_iter()
            .map(|(key, right)| Invalid {
                key: key.into(),
                message: format!("must be {right}"),
            })
            .collect();
        if let Err(error) = self.ppo.validate() {
            found.push(Invalid {
                key: format!("ppo.{}", error.key),
                message: format!("must be {}", error.message),
            });
        }
        if found.is_empty() { Ok(()) } else { Err(found) }
    }
}
