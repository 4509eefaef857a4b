//! A multi-layer perceptron: parameters in tiles, and chunks of samples that pass through it and back.
//!
//! A tile is a group of a layer's outputs with everything that belongs to their weights: the parameters, the gradient,
//! the optimiser's moments and the packed forms the matrix products want. Tiles are what threads share out among them
//! when weights are summed or changed, chunks of rows when samples pass through. Neither depends on the number of
//! threads, and every sum runs over chunks in order, so the bits do not either.

use std::ops::Range;

use rand::{Rng, RngExt};

use crate::{
    elementwise::{Activation, activate, differentiate},
    matrix::{Product, pack, pack_transposed, packed_len, stride},
    simd::Left,
};

/// Most outputs of a tile.
const TILE: usize = 128;

/// Some outputs of a layer.
pub(crate) struct Tile {
    pub inputs: usize,
    pub outputs: usize,
    /// First output within the layer.
    pub first: usize,
    pub layer: usize,
    /// Weights, row-major (`outputs x inputs`), then biases.
    pub parameters: Vec<f32>,
    /// Gradient of the loss, in the same order.
    pub gradient: Vec<f32>,
    /// Sum of the squared gradient of the last minibatch.
    pub squared: f64,
    /// Adam's mean of the gradient.
    pub first_moment: Vec<f32>,
    /// Adam's mean of the squared gradient.
    pub second_moment: Vec<f32>,
    /// Transposed weights (`inputs x outputs`), packed: right operand of the forward pass.
    forward: Vec<f32>,
    /// Weights (`outputs x inputs`), packed: right operand of the backward pass. Empty in the first layer.
    backward: Vec<f32>,
}

impl Tile {
    fn new(layer: usize, first: usize, inputs: usize, outputs: usize) -> Self {
        let parameters = vec![0.0; outputs * (inputs + 1)];
        Self {
            inputs,
            outputs,
            first,
            layer,
            gradient: parameters.clone(),
            squared: 0.0,
            first_moment: parameters.clone(),
            second_moment: parameters.clone(),
            parameters,
            forward: vec![0.0; packed_len(inputs, outputs)],
            backward: if layer == 0 {
                Vec::new()
            } else {
                vec![0.0; packed_len(outputs, inputs)]
            },
        }
    }

    /// Biases.
    pub(crate) fn bias(&self) -> &[f32] {
        &self.parameters[self.outputs * self.inputs..]
    }

    /// Weights, row-major (`outputs x inputs`).
    pub(crate) fn weights(&self) -> &[f32] {
        &self.parameters[..self.outputs * self.inputs]
    }

    /// Brings the packed forms up to date with the parameters.
    pub(crate) fn pack(&mut self) {
        let weights = &self.parameters[..self.outputs * self.inputs];
        pack_transposed(weights, self.inputs, self.outputs, &mut self.forward);
        if !self.backward.is_empty() {
            pack(weights, self.inputs, self.outputs, self.inputs, &mut self.backward);
        }
    }

    /// Adds (or, if `first`, sets) the gradient of chunks that have passed back.
    pub(crate) fn accumulate<'a>(&mut self, passes: impl Iterator<Item = &'a Pass>, mut first: bool) {
        let (weights, bias) = self.gradient.split_at_mut(self.outputs * self.inputs);
        for pass in passes.filter(|pass| pass.rows > 0) {
            let by_outputs = &pass.gradients[self.layer];
            Product {
                left: Left {
                    data: &by_outputs.data[self.first..],
                    stride: by_outputs.stride,
                    transposed: true,
                },
                rows: self.outputs,
                depth: pass.rows,
                right: &pass.packed[self.layer][..packed_len(pass.rows, self.inputs)],
                columns: self.inputs,
                out: weights,
                out_stride: self.inputs,
                accumulate: !first,
            }
            .run();
            if first {
                bias.fill(0.0);
            }
            for row in by_outputs.data.chunks(by_outputs.stride).take(pass.rows) {
                bias.iter_mut().zip(&row[self.first..]).for_each(|(sum, x)| *sum += x);
            }
            first = false;
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
                let from = &weights[tile.first * inputs..][..tile.outputs * inputs];
                tile.parameters
                    .iter_mut()
                    .zip(from)
                    .for_each(|(to, from)| *to = (gain * from) as f32);
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
                let out = &mut outputs.data[tile.first..];
                Product {
                    left: Left {
                        data: &inputs.data,
                        stride: inputs.stride,
                        transposed: false,
                    },
                    rows: pass.rows,
                    depth: tile.inputs,
                    right: &tile.forward,
                    columns: tile.outputs,
                    out: &mut *out,
                    out_stride: outputs.stride,
                    accumulate: false,
                }
                .run();
                activate(out, outputs.stride, pass.rows, tile.bias(), activation);
            }
        }
    }

    /// Computes the gradients by each layer's outputs from that by the last one's, and packs the inputs for
    /// [`Tile::accumulate`].
    pub(crate) fn backward(&self, pass: &mut Pass) {
        for layer in (0..self.layers.len()).rev() {
            let values = &pass.values[layer];
            let width = self.widths[layer];
            pack(
                &values.data,
                values.stride,
                pass.rows,
                width,
                &mut pass.packed[layer][..packed_len(pass.rows, width)],
            );
            if layer == 0 {
                break;
            }
            let (before, after) = pass.gradients.split_at_mut(layer);
            let (by_inputs, by_outputs) = (&mut before[layer - 1], &after[0]);
            for (index, tile) in self.tiles[self.layers[layer].clone()].iter().enumerate() {
                let left = &by_outputs.data[tile.first..];
                Product {
                    left: Left {
                        data: left,
                        stride: by_outputs.stride,
                        transposed: false,
                    },
                    rows: pass.rows,
                    depth: tile.outputs,
                    right: &tile.backward,
                    columns: width,
                    out: &mut by_inputs.data,
                    out_stride: by_inputs.stride,
                    accumulate: index > 0,
                }
                .run();
            }
            differentiate(
                &mut by_inputs.data,
                &values.data,
                values.stride,
                pass.rows,
                width,
                self.activation,
            );
        }
    }
}

/// Rows of values, with room between them.
pub(crate) struct Rows {
    pub data: Vec<f32>,
    pub stride: usize,
}

impl Rows {
    fn new(rows: usize, width: usize) -> Self {
        Self {
            data: vec![0.0; rows * stride(width)],
            stride: stride(width),
        }
    }
}

/// A chunk of samples on its way through a network.
pub(crate) struct Pass {
    /// Samples in use.
    pub rows: usize,
    /// The inputs, then each layer's outputs.
    pub values: Vec<Rows>,
    /// Gradient by each layer's outputs before the activation.
    pub gradients: Vec<Rows>,
    /// Each layer's inputs (`rows x inputs`), packed.
    packed: Vec<Vec<f32>>,
}

impl Pass {
    /// Buffers for at most `rows` samples; without those of the backward pass if it is not `trained`.
    pub(crate) fn new(network: &Network, rows: usize, trained: bool) -> Self {
        let inputs = &network.widths[..network.layers.len()];
        let outputs = &network.widths[1..];
        let backward = if trained { rows } else { 0 };
        Self {
            rows: 0,
            values: network.widths.iter().map(|&width| Rows::new(rows, width)).collect(),
            gradients: outputs.iter().map(|&width| Rows::new(backward, width)).collect(),
            packed: inputs
                .iter()
                .map(|&width| vec![0.0; packed_len(backward, width)])
                .collect(),
        }
    }

    /// The network's outputs: data and stride.
    pub(crate) fn outputs(&self) -> &Rows {
        &self.values[self.values.len() - 1]
    }

    /// Row of the inputs.
    pub(crate) fn input_mut(&mut self, row: usize, width: usize) -> &mut [f32] {
        let Rows { data, stride } = &mut self.values[0];
        &mut data[row * *stride..][..width]
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
