//! An update to be done: configuration, weights and rollout, as Python programs write them.

use omniwalk_ppo::{Agent, Config, End, Rollout, Tensor, TensorData};
use serde::Deserialize;

/// A layer of a network.
#[derive(Deserialize)]
pub struct Layer {
    pub weight: Vec<f64>,
    pub bias: Vec<f64>,
}

#[derive(Deserialize)]
struct Normaliser {
    count: u64,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

#[derive(Deserialize)]
struct Numbers {
    observations: Vec<f32>,
    actions: Vec<f32>,
    values: Vec<f32>,
    rewards: Vec<f32>,
    ends: Vec<u8>,
    bootstrap_values: Vec<f32>,
    last_values: Vec<f32>,
}

/// The agent before the update, and what it is updated with.
#[derive(Deserialize)]
pub struct Case {
    pub config: Config,
    steps: usize,
    environments: usize,
    rollout: Numbers,
    normaliser: Normaliser,
    actor: Vec<Layer>,
    critic: Vec<Layer>,
}

impl Case {
    /// What the agent is updated with.
    pub fn rollout(&self) -> Rollout {
        let numbers = &self.rollout;
        let end = |&end: &u8| [End::None, End::Terminated, End::TimeOut][usize::from(end)];
        Rollout {
            steps: self.steps,
            environments: self.environments,
            observations: numbers.observations.clone(),
            actions: numbers.actions.clone(),
            values: numbers.values.clone(),
            rewards: numbers.rewards.clone(),
            ends: numbers.ends.iter().map(end).collect(),
            bootstrap_values: numbers.bootstrap_values.clone(),
            last_values: numbers.last_values.clone(),
        }
    }

    /// The agent before the update, with the given passes to do.
    pub fn agent(&self, epochs: usize) -> Agent {
        let config = Config {
            epochs,
            ..self.config.clone()
        };
        let samples = self.steps * self.environments;
        let widths = [&self.rollout.observations, &self.rollout.actions].map(|all| all.len() / samples);
        let mut tensors = Agent::new(config.clone(), widths[0], widths[1], 0).unwrap().save();
        for (name, layers) in [("actor", &self.actor), ("critic", &self.critic)] {
            for (i, layer) in layers.iter().enumerate() {
                set(&mut tensors, &format!("{name}.{i}.weight"), narrow(&layer.weight));
                set(&mut tensors, &format!("{name}.{i}.bias"), narrow(&layer.bias));
            }
        }
        let normaliser = &self.normaliser;
        for (name, data) in [
            ("count", TensorData::U64(vec![normaliser.count])),
            ("mean", TensorData::F64(normaliser.mean.clone())),
            ("squares", TensorData::F64(normaliser.squares.clone())),
        ] {
            set(&mut tensors, &format!("normaliser.{name}"), data);
        }
        Agent::load(config, widths[0], widths[1], &tensors).unwrap()
    }
}

fn narrow(values: &[f64]) -> TensorData {
    TensorData::F32(values.iter().map(|&x| x as f32).collect())
}

fn set(tensors: &mut [Tensor], name: &str, data: TensorData) {
    tensors.iter_mut().find(|tensor| tensor.name == name).unwrap().data = data;
}
