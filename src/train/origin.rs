//! The run whose weights another begins with.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use miette::{Diagnostic, WrapErr};
use omniwalk_env::robot::Robot;
use omniwalk_env::task::shared::spec;
use omniwalk_ppo::Agent;
use thiserror::Error;

use super::checkpoint;
use super::shape::{Shape, by_key};
use crate::run::checkpoint::Checkpoint;
use crate::run::sessions::Origin;
use crate::settings::Settings;

/// Settings that say what the networks' inputs and outputs are and what is between them.
const LAYOUT: [&str; 10] = [
    "observation.blocks",
    "clock.enabled",
    "clock.symmetric",
    "action.law",
    "action.scale",
    "ppo.hidden",
    "ppo.activation",
    "ppo.policy",
    "ppo.normalise_observations",
    "ppo.observation_clip",
];

/// Another run, read.
pub struct Source {
    /// Its folder as it was typed.
    pub run: PathBuf,
    /// Its settings.
    pub settings: Settings,
    /// Its robot.
    pub robot: Arc<Robot>,
    /// Its newest checkpoint.
    pub checkpoint: Checkpoint,
    /// The file of that.
    pub path: PathBuf,
}

/// The networks of a run do not fit another.
#[derive(Debug, Error, Diagnostic)]
#[error("the networks of {} do not fit this configuration: {}", .run.display(), .differences.join("; "))]
#[diagnostic(help("inputs, outputs and size of the networks must be the same; `--set` can change this configuration"))]
pub struct LayoutError {
    run: PathBuf,
    differences: Vec<String>,
}

impl Source {
    /// A learner with the weights and the normaliser of the run; all else of it is new.
    ///
    /// # Errors
    /// [`LayoutError`], or when the checkpoint is not what its configuration says.
    pub fn agent(&self, settings: &Settings, robot: &Robot) -> miette::Result<Agent> {
        let differences = self.differences(settings, robot);
        if !differences.is_empty() {
            let run = self.run.clone();
            return Err(LayoutError { run, differences }.into());
        }
        let layout = spec(robot, &settings.env);
        let agent = checkpoint::agent_from_weights(
            &self.checkpoint,
            settings,
            layout.observation_len(),
            layout.action_len(),
        );
        agent.wrap_err_with(|| format!("cannot start from {}", self.path.display()))
    }

    fn differences(&self, settings: &Settings, robot: &Robot) -> Vec<String> {
        let (theirs, ours) = (by_key(&self.settings), by_key(settings));
        let none = serde_json::Value::Null;
        let value = |values: &BTreeMap<String, serde_json::Value>, key: &str| values.get(key).unwrap_or(&none).clone();
        let mut differences: Vec<String> = LAYOUT
            .into_iter()
            .map(|key| (key, value(&theirs, key), value(&ours, key)))
            .filter(|(_, theirs, ours)| theirs != ours)
            .map(|(key, theirs, ours)| format!("{key} is {theirs} there and {ours} here"))
            .collect();
        let joints = |robot: &Robot| -> Vec<String> {
            let names = (0..robot.policy.len()).map(|i| robot.policy_joint(i).name.clone());
            names.collect()
        };
        let (theirs, ours) = (joints(&self.robot), joints(robot));
        if theirs != ours {
            let list = |names: Vec<String>| names.join(", ");
            differences.push(format!(
                "the policy's joints are {} there and {} here",
                list(theirs),
                list(ours)
            ));
        }
        differences
    }

    /// What the new run's record says of this one.
    pub fn origin(&self) -> Origin {
        Origin {
            run: self.run.clone(),
            step: self.checkpoint.step,
            configuration: Shape::hash_of(&self.checkpoint),
            taken: ["actor", "critic", "normaliser"].map(str::to_owned).to_vec(),
        }
    }
}
