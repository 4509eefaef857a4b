//! The policy's network: from an observation to the most likely action.
//!
//! [`Actor`] is the network as plain numbers, [`Inference`] the same prepared for one observation at a time.
//!
//! ```text
//! x = clip((observation - mean) / deviation, +-clip)
//! h = activation(W h + b) in all layers but the last, which is linear
//! outputs = the first parameter of every action, then the second of every action
//! Beta:     alpha, beta = 1 + softplus(output);  action = (alpha - 1) / (alpha + beta - 2), 1/2 where that is flat
//! Gaussian: action = (1 + first) / 2
//! ```

use alloc::{vec, vec::Vec};

use thiserror::Error;

use crate::{
    kernel::{Finish, Level, Panels},
    math::is_finite,
    weights::{Precision, Weights},
};

/// Widest layer, and longest observation: what bounds the memory that a file can ask for.
const MAX_WIDTH: usize = 16_384;

/// Most layers.
const MAX_LAYERS: usize = 32;

/// Non-linearity of the hidden layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Hyperbolic tangent.
    Tanh,
    /// `x` above zero, `exp(x) - 1` below.
    Elu,
    /// `x` above zero, 0 below.
    Relu,
}

/// The distribution whose mode is the action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Head {
    /// Beta distribution on [0, 1] (Chou et al. 2017, thesis 7.3.2).
    Beta,
    /// Normal distribution of `u = 2 a - 1`.
    Gaussian,
}

/// A dense layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    /// Number of inputs.
    pub inputs: usize,
    /// Weights, a row of `inputs` for each output.
    pub weights: Weights,
    /// One for each output.
    pub bias: Vec<f32>,
}

/// A policy network as plain numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Actor {
    /// Mean that is subtracted from the observation.
    pub mean: Vec<f32>,
    /// Standard deviation that the difference is divided by.
    pub deviation: Vec<f32>,
    /// The quotient is clipped to this magnitude.
    pub clip: f32,
    /// Layers; the last has two outputs for each action.
    pub layers: Vec<Dense>,
    /// Non-linearity of all layers but the last.
    pub activation: Activation,
    /// What the outputs mean.
    pub head: Head,
}

/// Why an [`Actor`] is not a network. Layers count from 0.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ActorError {
    /// Mean and deviation differ in length, or a deviation or the clip is not positive and finite.
    #[error("the normaliser needs as many means as deviations, all finite, deviations and clip positive")]
    Normaliser,
    /// No layer, or too many.
    #[error("the network has {found} layers; 1 to {MAX_LAYERS} are possible")]
    Layers {
        /// How many.
        found: usize,
    },
    /// Wider than any policy's.
    #[error("the network is {found} wide; at most {MAX_WIDTH} is possible")]
    TooWide {
        /// How wide.
        found: usize,
    },
    /// A layer's inputs are not the previous layer's outputs, or its weights are not inputs times outputs.
    #[error("layer {layer}: {weights} weights and {bias} biases do not fit {inputs} inputs")]
    Shape {
        /// The layer.
        layer: usize,
        /// The inputs there are.
        inputs: usize,
        /// The weights it has.
        weights: usize,
        /// The biases it has.
        bias: usize,
    },
    /// The last layer's outputs cannot be two for each action.
    #[error("the last layer has {outputs} outputs, not two for each action")]
    Outputs {
        /// The outputs.
        outputs: usize,
    },
    /// A weight is not finite.
    #[error("layer {layer}: a weight or bias is not finite")]
    NotFinite {
        /// The layer.
        layer: usize,
    },
}

impl Actor {
    /// Length of the observation.
    pub fn observation_len(&self) -> usize {
        self.mean.len()
    }

    /// Number of actions.
    pub fn action_len(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.bias.len() / 2)
    }

    /// The network with its weights stored in `precision`.
    #[must_use]
    pub fn with_precision(&self, precision: Precision) -> Self {
        let mut actor = self.clone();
        for layer in &mut actor.layers {
            layer.weights = Weights::new(&layer.weights.expand(layer.inputs), layer.inputs, precision);
        }
        actor
    }

    /// Checks shapes and numbers.
    ///
    /// # Errors
    /// What does not fit.
    pub fn validate(&self) -> Result<(), ActorError> {
        let normaliser = self.mean.len() == self.deviation.len()
            && is_finite(&self.mean)
            && self
                .deviation
                .iter()
                .chain([&self.clip])
                .all(|&x| x.is_finite() && x > 0.0);
        if !normaliser || self.mean.is_empty() {
            return Err(ActorError::Normaliser);
        }
        if !(1..=MAX_LAYERS).contains(&self.layers.len()) {
            let found = self.layers.len();
            return Err(ActorError::Layers { found });
        }
        let widths = self.layers.iter().map(|layer| layer.bias.len());
        if let Some(found) = widths.chain([self.mean.len()]).find(|&width| width > MAX_WIDTH) {
            return Err(ActorError::TooWide { found });
        }
        let mut inputs = self.mean.len();
        for (index, layer) in self.layers.iter().enumerate() {
            let (weights, bias) = (layer.weights.len(), layer.bias.len());
            if layer.inputs != inputs || bias == 0 || inputs.checked_mul(bias) != Some(weights) {
                return Err(ActorError::Shape {
                    layer: index,
                    inputs,
                    weights,
                    bias,
                });
            }
            if !layer.weights.are_finite(bias) || !is_finite(&layer.bias) {
                return Err(ActorError::NotFinite { layer: index });
            }
            inputs = bias;
        }
        // `inputs` are now the outputs of the last layer.
        if inputs.is_multiple_of(2) {
            Ok(())
        } else {
            Err(ActorError::Outputs { outputs: inputs })
        }
    }
}

/// A network ready to run, with its buffers.
#[derive(Clone, Debug)]
pub struct Inference {
    mean: Vec<f32>,
    /// Inverse of the deviation.
    scale: Vec<f32>,
    clip: f32,
    layers: Vec<Panels>,
    head: Head,
    level: Level,
    /// Input and output of the current layer.
    buffers: [Vec<f32>; 2],
}

impl Inference {
    /// Prepares `actor`.
    ///
    /// # Errors
    /// What [`Actor::validate`] finds.
    pub fn new(actor: &Actor) -> Result<Self, ActorError> {
        Self::with_level(actor, Level::detect())
    }

    /// [`Inference::new`] with the instructions alone that the crate was compiled for, as on a processor without others.
    ///
    /// # Errors
    /// As above.
    pub fn portable(actor: &Actor) -> Result<Self, ActorError> {
        Self::with_level(actor, Level::Baseline)
    }

    fn with_level(actor: &Actor, level: Level) -> Result<Self, ActorError> {
        actor.validate()?;
        let last = actor.layers.len() - 1;
        let layer = |(i, layer): (usize, &Dense)| {
            Panels::new(
                layer.inputs,
                &layer.weights.expand(layer.inputs),
                &layer.bias,
                match actor.head {
                    _ if i < last => Finish::Activate(actor.activation),
                    Head::Beta => Finish::Softplus,
                    Head::Gaussian => Finish::Linear,
                },
            )
        };
        let layers: Vec<Panels> = actor.layers.iter().enumerate().map(layer).collect();
        let widest = layers
            .iter()
            .map(Panels::width)
            .chain([actor.mean.len()])
            .max()
            .unwrap_or(0);
        Ok(Self {
            mean: actor.mean.clone(),
            scale: actor.deviation.iter().map(|x| 1.0 / x).collect(),
            clip: actor.clip,
            layers,
            head: actor.head,
            level,
            buffers: [vec![0.0; widest], vec![0.0; widest]],
        })
    }

    /// Name of the instruction set it runs with.
    pub fn instruction_set(&self) -> &'static str {
        self.level.name()
    }

    /// Writes the most likely action for `observation`; not a number where the observation's are not. Beta actions are in
    /// [0, 1], Gaussian ones may leave it.
    ///
    /// # Panics
    /// When a length is not the network's.
    pub fn action(&mut self, observation: &[f32], action: &mut [f32]) {
        assert_eq!(observation.len(), self.mean.len(), "the observation's length");
        let [input, output] = &mut self.buffers;
        let statistics = self.mean.iter().zip(&self.scale);
        for ((x, &raw), (&mean, &scale)) in input.iter_mut().zip(observation).zip(statistics) {
            *x = ((raw - mean) * scale).clamp(-self.clip, self.clip);
        }
        for layer in &self.layers {
            layer.apply(self.level, input, output);
            core::mem::swap(input, output);
        }
        let outputs = self.layers.last().map_or(0, Panels::outputs);
        let (first, second) = input[..outputs].split_at(outputs / 2);
        assert_eq!(action.len(), first.len(), "one action for each joint");
        for (action, (&first, &second)) in action.iter_mut().zip(first.iter().zip(second)) {
            *action = match self.head {
                Head::Beta => beta_mode(first, second),
                Head::Gaussian => 0.5 + 0.5 * first,
            };
        }
    }
}

/// Mode of a Beta distribution from alpha - 1 and beta - 1, neither negative; the middle if both are zero.
fn beta_mode(a: f32, b: f32) -> f32 {
    // Halves, so that the sum of finite numbers is finite.
    let sum = 0.5 * a + 0.5 * b;
    if sum == 0.0 { 0.5 } else { 0.5 * a / sum }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kernel::softplus;
    use crate::testing::actor;

    #[test]
    fn the_mode_of_a_beta_distribution_is_where_its_density_peaks() {
        for (first, second) in [(0.3f32, -0.2f32), (4.0, 1.0), (-3.0, 2.0), (30.0, 25.0)] {
            let (a, b) = (
                f64::from(softplus::<false>(first)),
                f64::from(softplus::<false>(second)),
            );
            // Logarithm of the density up to a constant, at 10,000 places.
            let density = |x: f64| a * x.ln() + b * (1.0 - x).ln();
            let peak = (1..10_000)
                .map(|i| f64::from(i) * 1e-4)
                .max_by(|x, y| density(*x).total_cmp(&density(*y)));
            let mode = f64::from(beta_mode(softplus::<false>(first), softplus::<false>(second)));
            assert!(
                (mode - peak.expect("not empty")).abs() < 1e-4,
                "{first} {second} {mode}"
            );
        }
        assert_eq!(
            beta_mode(softplus::<false>(-200.0), softplus::<false>(-200.0)),
            0.5,
            "flat"
        );
        assert_eq!(beta_mode(softplus::<false>(90.0), softplus::<false>(-200.0)), 1.0);
        assert!(beta_mode(softplus::<false>(f32::NAN), 1.0).is_nan());
    }

    #[test]
    fn a_network_of_one_weight_can_be_computed_by_hand() {
        let layer = |weight, bias: &[f32]| Dense {
            inputs: 1,
            weights: Weights::F32(weight),
            bias: bias.to_vec(),
        };
        let network = Actor {
            mean: vec![1.0],
            deviation: vec![2.0],
            clip: 3.0,
            layers: vec![layer(vec![0.5], &[0.1]), layer(vec![2.0, -1.0], &[0.0, 0.3])],
            activation: Activation::Tanh,
            head: Head::Gaussian,
        };
        let mut action = [0.0];
        Inference::new(&network).expect("valid").action(&[2.0], &mut action);
        let hidden = (0.5f64 * 0.5 + 0.1).tanh();
        assert!((f64::from(action[0]) - (0.5 + hidden)).abs() < 1e-6);
        Inference::new(&network).expect("valid").action(&[1e9], &mut action);
        assert!(
            (f64::from(action[0]) - (0.5 + (0.5f64 * 3.0 + 0.1).tanh())).abs() < 1e-6,
            "clipped"
        );
    }

    #[test]
    fn networks_that_do_not_fit_together_are_refused() {
        let wrong: [fn(&mut Actor); 10] = [
            |actor| actor.layers = vec![actor.layers[1].clone(); MAX_LAYERS + 1],
            |actor| actor.mean = vec![0.0; MAX_WIDTH + 1],
            |actor| actor.layers.clear(),
            |actor| actor.mean.push(0.0),
            |actor| actor.deviation[0] = 0.0,
            |actor| actor.clip = f32::NAN,
            |actor| actor.layers[1].inputs += 1,
            |actor| actor.layers[0].weights = Weights::F32(vec![0.0; 3]),
            |actor| actor.layers[1].bias[0] = f32::INFINITY,
            |actor| drop(actor.layers.remove(1)),
        ];
        assert_eq!(actor(5, &[7], 3).validate(), Ok(()));
        for (i, change) in wrong.iter().enumerate() {
            let mut broken = actor(5, &[7], 3);
            change(&mut broken);
            assert!(Inference::new(&broken).is_err(), "{i}");
        }
    }

    proptest! {
        #[test]
        fn actions_of_finite_observations_are_in_the_unit_interval(observation in prop::array::uniform5(-1e6f32..1e6)) {
            let mut action = [f32::NAN; 3];
            Inference::new(&actor(5, &[70, 20], 3)).expect("valid").action(&observation, &mut action);
            prop_assert!(action.iter().all(|a| (0.0..=1.0).contains(a)), "{action:?}");
        }
    }
}
