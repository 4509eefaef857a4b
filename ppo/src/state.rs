//! The agent's state as named arrays, and back: everything a resumed run needs to continue with the same bits.

use crate::{
    agent::Agent,
    config::{Config, InvalidConfig},
    network::{Network, Tile},
};

/// A named array.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Unique name.
    pub name: String,
    /// Lengths, the slowest index first; empty for a single number.
    pub shape: Vec<usize>,
    /// The numbers, row-major.
    pub data: TensorData,
}

/// Numbers of a [`Tensor`].
#[derive(Clone, Debug, PartialEq)]
pub enum TensorData {
    /// 32-bit floating point.
    F32(Vec<f32>),
    /// 64-bit floating point.
    F64(Vec<f64>),
    /// Unsigned integers.
    U64(Vec<u64>),
}

/// Why a state cannot be loaded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// The configuration is not valid.
    #[error(transparent)]
    Config(#[from] InvalidConfig),
    /// An array is missing.
    #[error("`{0}` is missing")]
    Missing(String),
    /// An array has another shape or type than the configuration asks for.
    #[error("`{name}` has shape {found:?}, expected {expected:?} of {kind}")]
    Shape {
        /// The array.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// The shape that is right.
        expected: Vec<usize>,
        /// The type that is right.
        kind: &'static str,
    },
    /// An array holds a number that is not finite or is impossible.
    #[error("`{0}` holds a number that is not possible")]
    Value(String),
}

/// Which of a tile's arrays; the suffix names it.
type Part = (&'static str, fn(&Tile) -> &[f32], fn(&mut Tile) -> &mut [f32]);

const PARTS: [Part; 3] = [
    ("", |tile| &tile.parameters, |tile| &mut tile.parameters),
    (
        ".first_moment",
        |tile| &tile.first_moment,
        |tile| &mut tile.first_moment,
    ),
    (
        ".second_moment",
        |tile| &tile.second_moment,
        |tile| &mut tile.second_moment,
    ),
];

/// Smallest and largest observations so far, and what they are in older states, which do not know them.
const RANGE: [(&str, f32); 2] = [
    ("normaliser.smallest", f32::NEG_INFINITY),
    ("normaliser.largest", f32::INFINITY),
];

impl Agent {
    /// The whole state.
    pub fn save(&self) -> Vec<Tensor> {
        let tensor = |name: &str, shape: &[usize], data| Tensor {
            name: name.to_owned(),
            shape: shape.to_vec(),
            data,
        };
        let len = self.observation_len();
        let mut tensors = vec![
            tensor("learning_rate", &[], TensorData::F64(vec![self.learning_rate])),
            tensor("optimiser_steps", &[], TensorData::U64(vec![self.steps])),
            tensor("normaliser.count", &[], TensorData::U64(vec![self.normaliser.count])),
            tensor("normaliser.mean", &[len], TensorData::F64(self.normaliser.mean.clone())),
            tensor(
                "normaliser.squares",
                &[len],
                TensorData::F64(self.normaliser.squares.clone()),
            ),
        ];
        for ((name, _), values) in RANGE.into_iter().zip(&self.normaliser.range) {
            tensors.push(tensor(name, &[len], TensorData::F32(values.clone())));
        }
        save_network("actor", &self.actor, &mut tensors);
        save_network("critic", &self.critic, &mut tensors);
        tensors
    }

    /// An agent with a saved state. Arrays of other names are not looked at.
    ///
    /// # Errors
    /// If the configuration is not valid, or an array is missing, has another shape or an impossible value.
    pub fn load(
        config: Config,
        observation_len: usize,
        action_len: usize,
        tensors: &[Tensor],
    ) -> Result<Self, StateError> {
        let mut agent = Self::zeroed(config, observation_len, action_len)?;
        let value = |ok: bool, name: &str| {
            if ok {
                Ok(())
            } else {
                Err(StateError::Value(name.to_owned()))
            }
        };
        agent.learning_rate = find_f64(tensors, "learning_rate", &[])?[0];
        value(agent.learning_rate > 0.0 && agent.learning_rate <= 1.0, "learning_rate")?;
        agent.steps = find_u64(tensors, "optimiser_steps")?;
        agent.normaliser.count = find_u64(tensors, "normaliser.count")?;
        agent.normaliser.mean = find_f64(tensors, "normaliser.mean", &[observation_len])?.to_vec();
        agent.normaliser.squares = find_f64(tensors, "normaliser.squares", &[observation_len])?.to_vec();
        value(
            agent.normaliser.mean.iter().all(|x| x.abs() < f64::from(f32::MAX)),
            "normaliser.mean",
        )?;
        value(
            agent.normaliser.squares.iter().all(|x| x.is_finite() && *x >= 0.0),
            "normaliser.squares",
        )?;
        for ((name, unknown), values) in RANGE.into_iter().zip(&mut agent.normaliser.range) {
            match find_numbers(tensors, name, &[observation_len]) {
                Err(StateError::Missing(_)) => values.fill(unknown),
                found => *values = found?.to_vec(),
            }
            value(!values.iter().any(|x| x.is_nan()), name)?;
        }
        agent.normaliser.refresh();
        load_network("actor", &mut agent.actor, tensors)?;
        load_network("critic", &mut agent.critic, tensors)?;
        Ok(agent)
    }

    /// An agent that begins with the networks and the normaliser of a saved state; its optimiser and learning rate are
    /// those of a new one.
    ///
    /// # Errors
    /// As [`Agent::load`].
    pub fn from_weights(
        config: Config,
        observation_len: usize,
        action_len: usize,
        tensors: &[Tensor],
    ) -> Result<Self, StateError> {
        let learning_rate = config.learning_rate;
        let mut agent = Self::load(config, observation_len, action_len, tensors)?;
        agent.learning_rate = learning_rate;
        agent.steps = 0;
        for tile in agent.actor.tiles.iter_mut().chain(&mut agent.critic.tiles) {
            tile.first_moment.fill(0.0);
            tile.second_moment.fill(0.0);
        }
        Ok(agent)
    }
}

fn save_network(prefix: &str, network: &Network, tensors: &mut Vec<Tensor>) {
    for (suffix, part, _) in PARTS {
        for (layer, range) in network.layers.iter().enumerate() {
            let tiles = &network.tiles[range.clone()];
            let (inputs, outputs) = (network.widths[layer], network.widths[layer + 1]);
            let (weights, bias): (Vec<_>, Vec<_>) = tiles.iter().map(|tile| tile.plain(part(tile))).unzip();
            let (weights, bias) = (weights.concat(), bias.concat());
            tensors.push(Tensor {
                name: format!("{prefix}.{layer}.weight{suffix}"),
                shape: vec![outputs, inputs],
                data: TensorData::F32(weights),
            });
            tensors.push(Tensor {
                name: format!("{prefix}.{layer}.bias{suffix}"),
                shape: vec![outputs],
                data: TensorData::F32(bias),
            });
        }
    }
}

fn load_network(prefix: &str, network: &mut Network, tensors: &[Tensor]) -> Result<(), StateError> {
    for (suffix, _, part) in PARTS {
        for (layer, range) in network.layers.iter().enumerate() {
            let (inputs, outputs) = (network.widths[layer], network.widths[layer + 1]);
            let weights = find_f32(tensors, &format!("{prefix}.{layer}.weight{suffix}"), &[outputs, inputs])?;
            let bias = find_f32(tensors, &format!("{prefix}.{layer}.bias{suffix}"), &[outputs])?;
            for tile in &mut network.tiles[range.clone()] {
                for output in 0..tile.outputs {
                    for input in 0..inputs {
                        let index = tile.index(output, input);
                        part(tile)[index] = weights[(tile.first + output) * inputs + input];
                    }
                }
                let bias = &bias[tile.first..][..tile.outputs];
                let to = part(tile);
                let start = to.len() - bias.len();
                to[start..].copy_from_slice(bias);
            }
        }
    }
    let impossible = network
        .tiles
        .iter()
        .any(|tile| tile.second_moment.iter().any(|&x| x < 0.0));
    if impossible {
        return Err(StateError::Value(format!("{prefix}.*.second_moment")));
    }
    network.tiles.iter_mut().for_each(Tile::pack);
    Ok(())
}

fn find<'a, T>(
    tensors: &'a [Tensor],
    name: &str,
    shape: &[usize],
    kind: &'static str,
    data: impl Fn(&'a TensorData) -> Option<&'a Vec<T>>,
) -> Result<&'a [T], StateError> {
    let tensor = tensors.iter().find(|tensor| tensor.name == name);
    let tensor = tensor.ok_or_else(|| StateError::Missing(name.to_owned()))?;
    match data(&tensor.data) {
        Some(data) if tensor.shape == shape && data.len() == shape.iter().product::<usize>() => Ok(data),
        _ => Err(StateError::Shape {
            name: name.to_owned(),
            found: tensor.shape.clone(),
            expected: shape.to_vec(),
            kind,
        }),
    }
}

/// Numbers that need not be finite.
fn find_numbers<'a>(tensors: &'a [Tensor], name: &str, shape: &[usize]) -> Result<&'a [f32], StateError> {
    find(tensors, name, shape, "f32", |data| {
        if let TensorData::F32(x) = data { Some(x) } else { None }
    })
}

fn find_f32<'a>(tensors: &'a [Tensor], name: &str, shape: &[usize]) -> Result<&'a [f32], StateError> {
    let data = find_numbers(tensors, name, shape)?;
    if data.iter().all(|x| x.is_finite()) {
        Ok(data)
    } else {
        Err(StateError::Value(name.to_owned()))
    }
}

fn find_f64<'a>(tensors: &'a [Tensor], name: &str, shape: &[usize]) -> Result<&'a [f64], StateError> {
    find(tensors, name, shape, "f64", |data| {
        if let TensorData::F64(x) = data { Some(x) } else { None }
    })
}

fn find_u64(tensors: &[Tensor], name: &str) -> Result<u64, StateError> {
    find(tensors, name, &[], "u64", |data| {
        if let TensorData::U64(x) = data { Some(x) } else { None }
    })
    .map(|x| x[0])
}
