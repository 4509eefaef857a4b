//! A trainer as a checkpoint, and back to the same bits.

use std::sync::Arc;

use miette::{Diagnostic, miette};
use omniwalk_env::EnvError;
use omniwalk_env::robot::Robot;
use omniwalk_ppo::{Agent, StateError, Tensor, TensorData};
use thiserror::Error;

use super::shape::Shape;
use super::trainer::{Progress, TrainError, Trainer};
use crate::run::checkpoint::{Checkpoint, CheckpointError};
use crate::run::tensor::Data;
use crate::settings::Settings;

/// Name of the tensor that holds the environments.
const ENVIRONMENTS: &str = "environments";
/// Name of the tensor that holds the trainer's own counters, curriculum and episode window.
const PROGRESS: &str = "progress";
/// Metadata: wall time spent, s.
const WALL_SECONDS: &str = "wall_seconds";
/// Prefix of the learner's tensors.
const AGENT: &str = "agent.";

/// Why a checkpoint does not fit the run.
#[derive(Debug, Error, Diagnostic)]
pub enum RestoreError {
    /// A tensor is missing or of another type.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The networks do not fit the configuration.
    #[error("the checkpoint's networks do not fit this configuration: {0}")]
    Agent(#[from] StateError),
    /// The environments do not fit the configuration.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// Robot and configuration do not fit together.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The counters cannot be read.
    #[error("the checkpoint's progress cannot be read: {0}")]
    Progress(postcard::Error),
}

/// Everything `trainer`, shaped by `shape`, needs to go on.
///
/// # Errors
/// When the progress cannot be serialised.
pub fn save(trainer: &Trainer, shape: &Shape) -> miette::Result<Checkpoint> {
    let progress = trainer.progress();
    let mut checkpoint = Checkpoint::new(progress.steps);
    for tensor in trainer.agent().save() {
        let name = format!("{AGENT}{}", tensor.name);
        match tensor.data {
            TensorData::F32(values) => checkpoint.insert(name, &tensor.shape, &values),
            TensorData::F64(values) => checkpoint.insert(name, &tensor.shape, &values),
            TensorData::U64(values) => checkpoint.insert(name, &tensor.shape, &values),
        }
    }
    let environments = trainer.batch().save();
    checkpoint.insert(ENVIRONMENTS, &[environments.len()], &environments);
    let bytes = postcard::to_stdvec(progress).map_err(|error| miette!("the progress cannot be saved: {error}"))?;
    checkpoint.insert(PROGRESS, &[bytes.len()], &bytes);
    checkpoint
        .metadata
        .insert("program".into(), concat!("omniwalk ", env!("CARGO_PKG_VERSION")).into());
    shape.note(&mut checkpoint);
    checkpoint.metadata.insert("update".into(), progress.update.into());
    checkpoint.metadata.insert(WALL_SECONDS.into(), progress.seconds.into());
    Ok(checkpoint)
}

/// The learner of a checkpoint.
///
/// # Errors
/// [`RestoreError`] when its tensors do not fit `settings` and the lengths of observation and action.
pub fn agent(
    checkpoint: &Checkpoint,
    settings: &Settings,
    observation_len: usize,
    action_len: usize,
) -> Result<Agent, RestoreError> {
    Ok(Agent::load(
        settings.ppo.clone(),
        observation_len,
        action_len,
        &tensors(checkpoint),
    )?)
}

/// A learner that begins with the networks and the normaliser of a checkpoint; optimiser and learning rate are new.
///
/// # Errors
/// As of [`agent`].
pub fn agent_from_weights(
    checkpoint: &Checkpoint,
    settings: &Settings,
    observation_len: usize,
    action_len: usize,
) -> Result<Agent, RestoreError> {
    Ok(Agent::from_weights(
        settings.ppo.clone(),
        observation_len,
        action_len,
        &tensors(checkpoint),
    )?)
}

/// The learner's tensors in a checkpoint.
fn tensors(checkpoint: &Checkpoint) -> Vec<Tensor> {
    checkpoint
        .tensors
        .iter()
        .filter_map(|(name, tensor)| {
            let data = match &tensor.data {
                Data::F32(values) => TensorData::F32(values.clone()),
                Data::F64(values) => TensorData::F64(values.clone()),
                Data::U64(values) => TensorData::U64(values.clone()),
                Data::U8(_) => return None,
            };
            let name = name.strip_prefix(AGENT)?.to_owned();
            Some(Tensor {
                name,
                shape: tensor.shape.clone(),
                data,
            })
        })
        .collect()
}

/// How far the run was when the checkpoint was written; without the wall time.
///
/// # Errors
/// [`RestoreError`] when it is not in the checkpoint.
pub fn progress(checkpoint: &Checkpoint) -> Result<Progress, RestoreError> {
    postcard::from_bytes(checkpoint.get_any::<u8>(PROGRESS)?).map_err(RestoreError::Progress)
}

/// A trainer that goes on where `checkpoint` was written.
///
/// # Errors
/// [`RestoreError`] when the checkpoint does not fit settings and robot.
pub fn restore(checkpoint: &Checkpoint, settings: &Settings, robot: Arc<Robot>) -> Result<Trainer, RestoreError> {
    let mut trainer = Trainer::new(settings, robot)?;
    let (observations, actions) = (trainer.spec().observation_len(), trainer.spec().action_len());
    let agent = agent(checkpoint, settings, observations, actions)?;
    let mut progress = progress(checkpoint)?;
    let seconds = checkpoint.metadata.get(WALL_SECONDS);
    progress.seconds = seconds.and_then(serde_json::Value::as_f64).unwrap_or(0.0);
    trainer.restore(agent, checkpoint.get_any::<u8>(ENVIRONMENTS)?, progress)?;
    Ok(trainer)
}
