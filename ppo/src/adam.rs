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

    /// Changes the tile's parameters, and brings its panels up to date one after the other, while they are in the
    /// cache.
    pub(crate) fn apply(self, tile: &mut Tile) {
        for first in (0..tile.outputs).step_by(PANEL) {
            let end = (first + PANEL).min(tile.outputs);
            self.apply_to(tile, first * tile.inputs..end * tile.inputs);
            tile.pack_panel(first);
        }
        self.apply_to(tile, tile.outputs * tile.inputs..tile.parameters.len());
    }

    fn apply_to(self, tile: &mut Tile, range: Range<usize>) {
        simd::dispatch(Apply {
            step: self,
            parameters: &mut tile.parameters[range.clone()],
            gradient: &tile.gradient[range.clone()],
            first: &mut tile.first_moment[range.clone()],
            second: &mut tile.second_moment[range],
        });
    }
}

struct Apply<'a> {
    step: Step,
    parameters: &'a mut [f32],
    gradient: &'a [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
}

impl Kernel for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let Step {
            scale,
            rate,
            correction,
        } = self.step;
        let moments = self.first.iter_mut().zip(self.second.iter_mut());
        for ((x, &g), (m, v)) in self.parameters.iter_mut().zip(self.gradient).zip(moments) {
            let g = g * scale;
            *m = S::fma(FIRST_DECAY as f32, *m, (1.0 - FIRST_DECAY) as f32 * g);
            *v = S::fma(SECOND_DECAY as f32, *v, (1.0 - SECOND_DECAY) as f32 * g * g);
            *x -= rate * *m / S::fma(v.sqrt(), correction, EPSILON as f32);
        }
    }
}
