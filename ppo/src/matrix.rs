//! Matrix products over packed panels.
//!
//! The right operand is packed: its columns in groups of [`PANEL`], each group stored row after row, the last one
//! filled up with zeros. Weights are packed once after each optimiser step and used by every chunk of rows, and
//! nothing is allocated in a product; a general library does both per call. Each element of a product is summed over the
//! depth in one order, whatever the number of rows, so a sample's output does not depend on its neighbours.

use crate::simd::{self, Kernel, Left, PANEL, Simd};

/// Depth of a block of the product: a panel of it stays in the first-level cache.
const DEPTH: usize = 256;

/// Length of `rows x columns` packed in panels.
pub(crate) fn packed_len(rows: usize, columns: usize) -> usize {
    rows * columns.next_multiple_of(PANEL)
}

/// Floats between rows of a buffer of the given width: not a power of two, which would crowd a few cache sets.
pub(crate) fn stride(width: usize) -> usize {
    width.next_multiple_of(16) + 16
}

/// Packs a row-major matrix.
pub(crate) fn pack(from: &[f32], from_stride: usize, rows: usize, columns: usize, to: &mut [f32]) {
    for (panel, to) in to.chunks_exact_mut(rows * PANEL).enumerate() {
        let first = panel * PANEL;
        let count = (columns - first).min(PANEL);
        for (row, to) in to.chunks_exact_mut(PANEL).enumerate() {
            let from = &from[row * from_stride + first..][..count];
            to[..count].copy_from_slice(from);
            to[count..].fill(0.0);
        }
    }
}

/// Packs the transpose of a row-major matrix of `columns` rows and `rows` columns without gaps.
pub(crate) fn pack_transposed(from: &[f32], rows: usize, columns: usize, to: &mut [f32]) {
    for (panel, to) in to.chunks_exact_mut(rows * PANEL).enumerate() {
        let first = panel * PANEL;
        let count = (columns - first).min(PANEL);
        if count < PANEL {
            to.fill(0.0);
        }
        // Blocks of 16 read whole cache lines of the source.
        for (block, to) in to.chunks_mut(16 * PANEL).enumerate() {
            for column in 0..count {
                let from = &from[(first + column) * rows + block * 16..];
                for (to, from) in to[column..].iter_mut().step_by(PANEL).zip(from) {
                    *to = *from;
                }
            }
        }
    }
}

/// The product `out = left * right`.
pub(crate) struct Product<'a> {
    /// Left operand, `rows x depth`.
    pub left: Left<'a>,
    /// Rows of the left operand and of the output.
    pub rows: usize,
    /// Columns of the left operand, rows of the right one.
    pub depth: usize,
    /// Packed right operand.
    pub right: &'a [f32],
    /// Columns of the right operand and of the output.
    pub columns: usize,
    /// Output, row-major.
    pub out: &'a mut [f32],
    /// Floats between the output's rows.
    pub out_stride: usize,
    /// Add to the output instead of setting it.
    pub accumulate: bool,
}

impl Product<'_> {
    /// Computes it.
    pub(crate) fn run(self) {
        simd::dispatch(self);
    }
}

impl Kernel for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        for (index, panel) in self.right.chunks_exact(self.depth.max(1) * PANEL).enumerate() {
            let column = index * PANEL;
            let columns = (self.columns - column).min(PANEL);
            for start in (0..self.depth).step_by(DEPTH) {
                let depth = (self.depth - start).min(DEPTH);
                let offset = if self.left.transposed {
                    start * self.left.stride
                } else {
                    start
                };
                let left = Left {
                    data: &self.left.data[offset..],
                    ..self.left
                };
                let accumulate = self.accumulate || start > 0;
                let out = &mut self.out[column..];
                let panel = &panel[start * PANEL..];
                simd::tile::<S>(left, self.rows, depth, panel, columns, out, self.out_stride, accumulate);
            }
        }
    }
}
