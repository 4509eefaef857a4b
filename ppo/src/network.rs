//! A multi-layer perceptron: parameters in tiles, and chunks of samples that pass through it and back.
//!
//! A tile is a group of a layer's outputs with everything that belongs to their weights: the parameters, the gradient,
//! the optimiser's moments and the forms that matrix products want. Tiles are what threads share out among them
//! when weights are summed or changed, chunks of rows when samples pass through. Neither depends on the number of
//! threads, and every sum runs over chunks in order, so the bits do not either.

use std::ops::Range;

use rand::{Rng, RngExt};

use crate::{
    elementwise::{Activation, activate, differentiate},
    floats::Floats,
    matrix::{Panels, Product, panels_len},
    simd::{self, Kernel, PANEL, Simd},
};

/// Most outputs of a tile, a multiple of [`PANEL`].
const TILE: usize = 128;

/// Some outputs of a layer.
pub(crate) struct Tile {
    pub inputs: usize,
    pub outputs: usize,
    /// First output within the layer.
    pub first: usize,
    pub layer: usize,
    /// Weights (`outputs x inputs`) in panels, what fills up the last one zero, then biases. So they are the right
    /// operand of the backward pass, and their gradient an output of products, as they lie.
    pub parameters: Floats,
    /// Gradient of the loss, in the same order.
    pub gradient: Floats,
    /// Sum of the squared gradient of the last minibatch.
    pub squared: f64,
    /// Adam's mean of the gradient.
    pub first_moment: Floats,
    /// Adam's mean of the squared gradient.
    pub second_moment: Floats,
    /// Transposed weights (`inputs x outputs`) in panels: right operand of the forward pass.
    pub forward: Floats,
}

impl Tile {
    fn new(layer: usize, first: usize, inputs: usize, outputs: usize) -> Self {
        let parameters = || Floats::zeros(panels_len(outputs, inputs) + outputs);
        Self {
            inputs,
            outputs,
            first,
            layer,
            parameters: parameters(),
            gradient: parameters(),
            squared: 0.0,
            first_moment: parameters(),
            second_moment: parameters(),
            forward: Floats::zeros(panels_len(inputs, outputs)),
        }
    }

    /// Biases.
    pub(crate) fn bias(&self) -> &[f32] {
        &self.parameters[panels_len(self.outputs, self.inputs)..]
    }

    /// Rows of weights (`outputs x inputs`), and biases, of one of the arrays of parameters.
    pub(crate) fn plain(&self, part: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let (weights, bias) = part.split_at(panels_len(self.outputs, self.inputs));
        let index = |output| (0..self.inputs).map(move |input| self.index(output, input));
        let rows = (0..self.outputs).flat_map(index).map(|i| weights[i]).collect();
        (rows, bias.to_vec())
    }

    /// Where a weight lies among the parameters.
    pub(crate) fn index(&self, output: usize, input: usize) -> usize {
        (input / PANEL * self.outputs + output) * PANEL + input % PANEL
    }

    /// Brings the transposed weights up to date with the parameters.
    pub(crate) fn pack(&mut self) {
        simd::dispatch(Pack(self));
    }

    /// The same for weights between a panel's worth of outputs and one of inputs, from the given ones on, in a kernel.
    #[inline(always)]
    pub(crate) fn pack_block<S: Simd>(&mut self, output: usize, input: usize) {
        let (outputs, inputs) = ((self.outputs - output).min(PANEL), (self.inputs - input).min(PANEL));
        let from = &self.parameters[self.index(output, input)..][..outputs * PANEL];
        let to = &mut self.forward[output * self.inputs + input * PANEL..][..inputs * PANEL];
        simd::transpose::<S>(from, to);
    }

    /// Sets the gradient to that of chunks that have passed back, or adds that if `add`.
    pub(crate) fn accumulate<'a>(&mut self, passes: impl Iterator<Item = &'a Pass> + Clone, add: bool) {
        let (weights, bias) = self.gradient.split_at_mut(panels_len(self.outputs, self.inputs));
        let passes = passes.filter(|pass| pass.rows > 0);
        // A panel of the gradient stays in the cache while the chunks add to it.
        for (panel, out) in weights.chunks_exact_mut(self.outputs * PANEL).enumerate() {
            for (index, pass) in passes.clone().enumerate() {
                let (values, gradients) = (&pass.values[self.layer], &pass.gradients[self.layer]);
                Product {
                    left: gradients.left(self.first / PANEL, true),
                    rows: self.outputs,
                    depth: pass.rows,
                    right: &values.data[panel * values.panel..][..values.panel],
                    out: &mut *out,
                    accumulate: add || index > 0,
                }
                .run();
            }
        }
        if !add {
            bias.fill(0.0);
        }
        for pass in passes {
            let gradients = &pass.gradients[self.layer];
            let panels = gradients.data[self.first / PANEL * gradients.panel..].chunks(gradients.panel);
            for (bias, panel) in bias.chunks_mut(PANEL).zip(panels) {
                let mut sums = [0.0; PANEL];
                for row in panel.chunks_exact(PANEL).take(pass.rows) {
                    sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
                }
                bias.iter_mut().zip(sums).for_each(|(bias, sum)| *bias += sum);
            }
        }
    }

    /// Sum of the squared gradient.
    pub(crate) fn squared_gradient(&self) -> f64 {
        // Sixteen sums, so that the loop vectorises; the order is fixed.
        let mut sums = [0.0_f64; 16];
        for chunk in self.gradient.chunks(16) {
            sums.iter_mut()
                .zip(chunk)
                .for_each(|(sum, &g)| *sum += f64::from(g) * f64::from(g));
        }
        sums.iter().sum()
    }
}

struct Pack<'a>(&'a mut Tile);

impl Kernel for Pack<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        for output in (0..self.0.outputs).step_by(PANEL) {
            for input in (0..self.0.inputs).step_by(PANEL) {
                self.0.pack_block::<S>(output, input);
            }
        }
    }
}

/// A multi-layer perceptron.
pub(crate) struct Network {
    /// Width of the input, of each hidden layer and of the output.
    pub widths: Vec<usize>,
    pub activation: Activation,
    /// All layers' tiles in order.
    pub tiles: Vec<Tile>,
    /// Each layer's part of `tiles`.
    pub layers: Vec<Range<usize>>,
}

impl Network {
    /// All parameters zero.
    pub(crate) fn zeroed(inputs: usize, hidden: &[usize], outputs: usize, activation: Activation) -> Self {
        let widths: Vec<usize> = std::iter::once(inputs)
            .chain(hidden.iter().copied())
            .chain([outputs])
            .collect();
        let mut tiles = Vec::new();
        let mut layers = Vec::new();
        for (layer, pair) in widths.windows(2).enumerate() {
            let start = tiles.len();
            for first in (0..pair[1]).step_by(TILE) {
                tiles.push(Tile::new(layer, first, pair[0], (pair[1] - first).min(TILE)));
            }
            layers.push(start..tiles.len());
        }
        Self {
            widths,
            activation,
            tiles,
            layers,
        }
    }

    /// Orthogonal weights (Saxe et al. 2014), scaled by sqrt(2) in hidden layers and by `gain` in the last; no biases.
    pub(crate) fn orthogonal(
        inputs: usize,
        hidden: &[usize],
        outputs: usize,
        activation: Activation,
        gain: f64,
        random: &mut impl Rng,
    ) -> Self {
        let mut network = Self::zeroed(inputs, hidden, outputs, activation);
        let last = network.layers.len() - 1;
        for layer in 0..=last {
            let (inputs, outputs) = (network.widths[layer], network.widths[layer + 1]);
            let gain = if layer == last { gain } else { std::f64::consts::SQRT_2 };
            let weights = orthogonal(outputs, inputs, random);
            for tile in &mut network.tiles[network.layers[layer].clone()] {
                for output in 0..tile.outputs {
                    for input in 0..inputs {
                        let index = tile.index(output, input);
                        tile.parameters[index] = (gain * weights[(tile.first + output) * inputs + input]) as f32;
                    }
                }
            }
        }
        network.tiles.iter_mut().for_each(Tile::pack);
        network
    }

    /// Width of the output.
    pub(crate) fn outputs(&self) -> usize {
        self.widths[self.widths.len() - 1]
    }

    /// Computes the outputs of a pass from its inputs.
    pub(crate) fn forward(&self, pass: &mut Pass) {
        for layer in 0..self.layers.len() {
            let (before, after) = pass.values.split_at_mut(layer + 1);
            let (inputs, outputs) = (&before[layer], &mut after[0]);
            let activation = (layer + 1 < self.layers.len()).then_some(self.activation);
            for tile in &self.tiles[self.layers[layer].clone()] {
                let weights = tile.forward.chunks_exact(tile.inputs * PANEL);
                let out = outputs.data.chunks_exact_mut(outputs.panel).skip(tile.first / PANEL);
                // The activation finds a panel in the cache.
                for ((right, bias), out) in weights.zip(tile.bias().chunks(PANEL)).zip(out) {
                    Product {
                        left: inputs.left(0, false),
                        rows: pass.rows,
                        depth: tile.inputs,
                        right,
                        out: &mut *out,
                        accumulate: false,
                    }
                    .run();
                    activate(&mut out[..pass.rows * PANEL], bias, activation);
                }
            }
        }
    }

    /// Computes the gradients by each layer's outputs before the activation from that by the last one's.
    pub(crate) fn backward(&self, pass: &mut Pass) {
        for layer in (1..self.layers.len()).rev() {
            let (before, after) = pass.gradients.split_at_mut(layer);
            let (by_inputs, by_outputs) = (&mut before[layer - 1], &after[0]);
            let values = &pass.values[layer];
            let panels = by_inputs.data.chunks_exact_mut(by_inputs.panel);
            for (panel, (out, values)) in panels.zip(values.data.chunks_exact(values.panel)).enumerate() {
                for (index, tile) in self.tiles[self.layers[layer].clone()].iter().enumerate() {
                    Product {
                        left: by_outputs.left(tile.first / PANEL, false),
                        rows: pass.rows,
                        depth: tile.outputs,
                        right: &tile.parameters[panel * tile.outputs * PANEL..][..tile.outputs * PANEL],
                        out: &mut *out,
                        accumulate: index > 0,
                    }
                    .run();
                }
                let count = pass.rows * PANEL;
                differentiate(&mut out[..count], &values[..count], self.activation);
            }
        }
    }
}

/// A chunk of samples on its way through a network.
pub(crate) struct Pass {
    /// Samples in use.
    pub rows: usize,
    /// The inputs, then each layer's outputs.
    pub values: Vec<Panels>,
    /// Gradient by each layer's outputs before the activation.
    pub gradients: Vec<Panels>,
}

impl Pass {
    /// Buffers for at most `rows` samples; without those of the backward pass if it is not `trained`.
    pub(crate) fn new(network: &Network, rows: usize, trained: bool) -> Self {
        let panels = |widths: &[usize]| widths.iter().map(|&width| Panels::new(rows, width)).collect();
        Self {
            rows: 0,
            values: panels(&network.widths),
            gradients: if trained {
                panels(&network.widths[1..])
            } else {
                Vec::new()
            },
        }
    }

    /// The network's inputs.
    pub(crate) fn inputs_mut(&mut self) -> &mut Panels {
        &mut self.values[0]
    }

    /// The network's outputs.
    pub(crate) fn outputs(&self) -> &Panels {
        &self.values[self.values.len() - 1]
    }

    /// The network's outputs, and the gradient by them.
    pub(crate) fn outputs_and_gradient(&mut self) -> (&Panels, &mut Panels) {
        let last = self.gradients.len() - 1;
        (&self.values[last + 1], &mut self.gradients[last])
    }
}

/// A `rows x columns` matrix with orthonormal rows or columns, whichever are fewer: normal numbers, then Gram and
/// Schmidt.
fn orthogonal(rows: usize, columns: usize, random: &mut impl Rng) -> Vec<f64> {
    let (count, length) = (rows.min(columns), rows.max(columns));
    let mut vectors: Vec<f64> = (0..count * length)
        .map(|_| random.sample::<f64, _>(rand_distr::StandardNormal))
        .collect();
    for i in 0..count {
        let (done, rest) = vectors.split_at_mut(i * length);
        let vector = &mut rest[..length];
        for other in done.chunks_exact(length) {
            let along = dot(vector, other);
            vector.iter_mut().zip(other).for_each(|(x, o)| *x -= along * o);
        }
        let norm = dot(vector, vector).sqrt();
        vector.iter_mut().for_each(|x| *x /= norm);
    }
    if rows <= columns {
        return vectors;
    }
    (0..rows * columns)
        .map(|i| vectors[i % columns * length + i / columns])
        .collect()
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    for (x, y) in x.chunks(8).zip(y.chunks(8)) {
        sums.iter_mut()
            .zip(x.iter().zip(y))
            .for_each(|(sum, (x, y))| *sum += x * y);
    }
    sums.iter().sum()
}
