//! Adam (Kingma and Ba 2015) with bias correction.

use std::ops::Range;

use crate::{
    network::Tile,
    simd::{self, Kernel, PANEL, Simd},
};

const FIRST_DECAY: f64 = 0.9;
const SECOND_DECAY: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// One step for a tile; everything that does not depend on the parameter.
#[derive(Clone, Copy)]
pub(crate) struct Step {
    /// Factor on the gradient: shortens it to the largest norm.
    scale: f32,
    /// Learning rate over the bias correction of the first moment.
    rate: f32,
    /// Bias correction of the root of the second moment.
    correction: f32,
}

impl Step {
    /// The `count`-th step, from 1.
    pub(crate) fn new(count: u64, learning_rate: f64, scale: f64) -> Self {
        let count = count as f64;
        Self {
            scale: scale as f32,
            rate: (learning_rate / (1.0 - FIRST_DECAY.powf(count))) as f32,
            correction: (1.0 / (1.0 - SECOND_DECAY.powf(count)).sqrt()) as f32,
        }
    }

    /// Changes the tile's parameters and brings its transposed weights up to date, block by block, while they are in
    /// the cache.
    pub(crate) fn apply(self, tile: &mut Tile) {
        simd::dispatch(Apply { step: self, tile });
    }
}

struct Apply<'a> {
    step: Step,
    tile: &'a mut Tile,
}

impl Apply<'_> {
    #[inline(always)]
    fn change<S: Simd>(&mut self, range: Range<usize>) {
        let Step {
            scale,
            rate,
            correction,
        } = self.step;
        let parameters = self.tile.parameters[range.clone()].iter_mut();
        let gradient = &self.tile.gradient[range.clone()];
        let first = self.tile.first_moment[range.clone()].iter_mut();
        let second = self.tile.second_moment[range].iter_mut();
        for ((x, &g), (m, v)) in parameters.zip(gradient).zip(first.zip(second)) {
            let g = g * scale;
            *m = S::fma(FIRST_DECAY as f32, *m, (1.0 - FIRST_DECAY) as f32 * g);
            *v = S::fma(SECOND_DECAY as f32, *v, (1.0 - SECOND_DECAY) as f32 * g * g);
            *x -= rate * *m / S::fma(v.sqrt(), correction, EPSILON as f32);
        }
    }
}

impl Kernel for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let (inputs, outputs) = (self.tile.inputs, self.tile.outputs);
        for input in (0..inputs).step_by(PANEL) {
            for output in (0..outputs).step_by(PANEL) {
                let start = self.tile.index(output, input);
                self.change::<S>(start..start + (outputs - output).min(PANEL) * PANEL);
                self.tile.pack_block::<S>(output, input);
            }
        }
        let len = self.tile.parameters.len();
        self.change::<S>(len - outputs..len);
    }
}
