//! Chunks of a minibatch on their way through a network and back.
//!
//! A minibatch goes through in blocks of a few chunks. In each block the chunks pass through a network and back, in
//! parallel; then the network's tiles add up their gradients over the chunks, in parallel. Buffers are of a block's
//! size whatever the minibatch's, and stay in the caches.

use rayon::prelude::*;

use super::samples::Data;
use crate::{
    distribution::{self, Head, HeadScratch, LossCoefficients, LossSums, Samples},
    network::{Network, Pass},
};

/// Most samples of a chunk.
const CHUNK: usize = 240;
/// Chunks of a block.
const CHUNKS: usize = 2;

/// A chunk and what belongs to the network's head.
pub(super) struct Chunk<H> {
    pass: Pass,
    head: H,
}

/// What the actor's loss needs of the samples, and its sums.
pub(super) struct ActorHead {
    scratch: HeadScratch,
    actions: Vec<f32>,
    advantages: Vec<f32>,
    log_probabilities: Vec<f64>,
    references: Vec<[f64; 3]>,
    pub sums: LossSums,
}

/// The critic's loss.
#[derive(Default)]
pub(super) struct CriticHead {
    pub squared_error: f64,
}

/// The chunks of a block.
pub(super) fn chunks<H>(network: &Network, head: impl Fn() -> H) -> Vec<Chunk<H>> {
    let chunk = || Chunk {
        pass: Pass::new(network, CHUNK, true),
        head: head(),
    };
    std::iter::repeat_with(chunk).take(CHUNKS).collect()
}

/// Leaves the gradient of a minibatch's loss in a network's tiles: `run` passes part of the samples through and back,
/// `sum` sees each part's head, in order.
pub(super) fn gradient<H: Send + Sync>(
    network: &mut Network,
    chunks: &mut [Chunk<H>],
    order: &[u32],
    run: impl Fn(&mut Chunk<H>, &Network, &[u32]) + Sync,
    mut sum: impl FnMut(&H),
) {
    let blocks = order.len().div_ceil(chunks.len() * CHUNK);
    for block in 0..blocks {
        let order = &order[part(order.len(), blocks, block)];
        let (count, now) = (chunks.len(), &*network);
        chunks
            .par_iter_mut()
            .enumerate()
            .with_max_len(1)
            .for_each(|(index, chunk)| run(chunk, now, &order[part(order.len(), count, index)]));
        let passed = &*chunks;
        network.tiles.par_iter_mut().with_max_len(1).for_each(|tile| {
            tile.accumulate(passed.iter().map(|chunk| &chunk.pass), block > 0);
            if block + 1 == blocks {
                tile.squared = tile.squared_gradient();
            }
        });
        chunks.iter().for_each(|chunk| sum(&chunk.head));
    }
}

/// Records the distributions of the samples' actions under the policy as it is. Those of mirror images are not those
/// of their originals: the policy is not symmetric.
pub(super) fn record(head: Head, actor: &Network, chunks: &mut [Chunk<ActorHead>], data: &mut Data) {
    let width = data.action_len;
    let mut references = std::mem::take(&mut data.references);
    let mut log_probabilities = std::mem::take(&mut data.log_probabilities);
    let block = chunks.len() * CHUNK;
    let blocks = references
        .chunks_mut(block * width)
        .zip(log_probabilities.chunks_mut(block));
    for (index, (references, log_probabilities)) in blocks.enumerate() {
        let parts = references
            .par_chunks_mut(CHUNK * width)
            .zip(log_probabilities.par_chunks_mut(CHUNK))
            .enumerate();
        let work = chunks.par_iter_mut().zip(parts).with_max_len(1);
        work.for_each(|(chunk, (part, (references, log_probabilities)))| {
            let first = index * block + part * CHUNK;
            chunk.fill(data, first..first + log_probabilities.len());
            actor.forward(&mut chunk.pass);
            for (row, to) in chunk
                .head
                .actions
                .chunks_exact_mut(width)
                .take(chunk.pass.rows)
                .enumerate()
            {
                to.copy_from_slice(data.action(first + row));
            }
            distribution::reference(
                head,
                chunk.pass.outputs(),
                &chunk.head.actions[..chunk.pass.rows * width],
                references,
                log_probabilities,
                &mut chunk.head.scratch,
            );
        });
    }
    (data.references, data.log_probabilities) = (references, log_probabilities);
}

impl<H> Chunk<H> {
    /// Takes the observations of some samples.
    fn fill(&mut self, data: &Data, indices: impl ExactSizeIterator<Item = usize>) {
        self.pass.rows = indices.len();
        for (row, index) in indices.enumerate() {
            self.pass.inputs_mut().set_row(row, data.observation(index));
        }
    }
}

impl ActorHead {
    pub(super) fn new(width: usize) -> Self {
        Self {
            scratch: HeadScratch::new(CHUNK, width),
            actions: vec![0.0; CHUNK * width],
            advantages: vec![0.0; CHUNK],
            log_probabilities: vec![0.0; CHUNK],
            references: vec![[0.0; 3]; CHUNK * width],
            sums: LossSums::default(),
        }
    }
}

impl Chunk<ActorHead> {
    pub(super) fn run(
        &mut self,
        policy: Head,
        actor: &Network,
        data: &Data,
        indices: &[u32],
        coefficients: LossCoefficients,
    ) {
        let (rows, width) = (indices.len(), data.action_len);
        self.fill(data, indices.iter().map(|&index| index as usize));
        let head = &mut self.head;
        for (row, &index) in indices.iter().enumerate() {
            let (to, index) = (row * width..(row + 1) * width, index as usize);
            head.actions[to.clone()].copy_from_slice(data.action(index));
            head.references[to].copy_from_slice(data.reference(index));
            head.advantages[row] = data.advantage(index);
            head.log_probabilities[row] = data.log_probabilities[index];
        }
        actor.forward(&mut self.pass);
        let samples = Samples {
            actions: &head.actions[..rows * width],
            advantages: &head.advantages[..rows],
            log_probabilities: &head.log_probabilities[..rows],
            references: &head.references[..rows * width],
        };
        let (outputs, gradient) = self.pass.outputs_and_gradient();
        head.sums = distribution::loss(policy, outputs, gradient, samples, coefficients, &mut head.scratch);
        actor.backward(&mut self.pass);
    }
}

impl Chunk<CriticHead> {
    pub(super) fn run(&mut self, critic: &Network, data: &Data, indices: &[u32], scale: f64) {
        self.fill(data, indices.iter().map(|&index| index as usize));
        critic.forward(&mut self.pass);
        let mut squared_error = 0.0;
        let (outputs, gradient) = self.pass.outputs_and_gradient();
        for (row, &index) in indices.iter().enumerate() {
            let error = f64::from(outputs.get(row, 0)) - f64::from(data.target(index as usize));
            squared_error += error * error;
            gradient.set(row, 0, (scale * error) as f32);
        }
        self.head.squared_error = squared_error;
        critic.backward(&mut self.pass);
    }
}

/// The `index`-th of `parts` nearly equal parts of `0..len`.
pub(super) fn part(len: usize, parts: usize, index: usize) -> std::ops::Range<usize> {
    len * index / parts..len * (index + 1) / parts
}
