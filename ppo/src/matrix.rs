//! Matrices in panels, and their products.
//!
//! A panel is [`PANEL`] columns of a matrix, stored row after row; the last panel of a matrix is filled up with zeros.
//! Values, their gradients and the packed weights all have this form, so that every operand of every product is read
//! from one end to the other, no operand is rearranged in a product, and nothing is allocated. A general library does
//! both in each call. Each element of a product is summed over the depth in one order, whatever the number of rows, so
//! a sample's output does not depend on its neighbours.

use crate::floats::Floats;
use crate::simd::{self, Kernel, Left, PANEL, Simd};

/// Depth of a block of the product: a panel of it stays in the first-level cache. A multiple of [`PANEL`].
const DEPTH: usize = 256;

/// Length of `rows x columns` in panels.
pub(crate) fn panels_len(rows: usize, columns: usize) -> usize {
    rows * columns.next_multiple_of(PANEL)
}

/// A matrix in panels with room for a number of rows.
pub(crate) struct Panels {
    pub data: Floats,
    /// Floats from a panel to the next.
    pub panel: usize,
}

impl Panels {
    /// Zeros.
    pub(crate) fn new(rows: usize, columns: usize) -> Self {
        Self {
            data: Floats::zeros(panels_len(rows, columns)),
            panel: rows * PANEL,
        }
    }

    /// An element.
    #[inline]
    pub(crate) fn get(&self, row: usize, column: usize) -> f32 {
        self.data[column / PANEL * self.panel + row * PANEL + column % PANEL]
    }

    /// Sets an element.
    #[inline]
    pub(crate) fn set(&mut self, row: usize, column: usize, value: f32) {
        self.data[column / PANEL * self.panel + row * PANEL + column % PANEL] = value;
    }

    /// A row's part in a panel.
    pub(crate) fn piece_mut(&mut self, row: usize, panel: usize) -> &mut [f32] {
        &mut self.data[panel * self.panel + row * PANEL..][..PANEL]
    }

    /// Sets a row.
    pub(crate) fn set_row(&mut self, row: usize, values: &[f32]) {
        for (panel, values) in values.chunks(PANEL).enumerate() {
            self.piece_mut(row, panel)[..values.len()].copy_from_slice(values);
        }
    }

    /// As the left operand of a product, from the given panel on.
    pub(crate) fn left(&self, first_panel: usize, transposed: bool) -> Left<'_> {
        Left {
            data: &self.data[first_panel * self.panel..],
            panel: self.panel,
            transposed,
        }
    }
}

/// The product `out = left * right` for one panel of the right operand and of the output.
pub(crate) struct Product<'a> {
    /// Left operand, `rows x depth`.
    pub left: Left<'a>,
    /// Rows of the left operand and of the output.
    pub rows: usize,
    /// Columns of the left operand, rows of the right one.
    pub depth: usize,
    /// Panel of the right operand.
    pub right: &'a [f32],
    /// Panel of the output.
    pub out: &'a mut [f32],
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
        let step = if self.left.transposed {
            PANEL
        } else {
            self.left.panel / PANEL
        };
        for start in (0..self.depth).step_by(DEPTH) {
            let depth = (self.depth - start).min(DEPTH);
            let left = Left {
                data: &self.left.data[start * step..],
                ..self.left
            };
            let right = &self.right[start * PANEL..];
            simd::tile::<S>(left, self.rows, depth, right, self.out, self.accumulate || start > 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Level;
    use proptest::prelude::*;

    /// An invented element, of few digits so that products are exact.
    fn element(row: usize, column: usize, salt: usize) -> f32 {
        ((row * 31 + column * 17 + salt * 7) % 23) as f32 - 11.0
    }

    fn panels(rows: usize, columns: usize, salt: usize) -> Panels {
        let mut panels = Panels::new(rows, columns);
        (0..rows).for_each(|i| (0..columns).for_each(|j| panels.set(i, j, element(i, j, salt))));
        panels
    }

    /// A size's bound; an interpreter takes a quarter of it.
    fn upto(size: usize) -> usize {
        if cfg!(miri) { size / 4 } else { size }
    }

    proptest! {
        #[test]
        fn products_of_every_instruction_set_agree_with_the_sum_over_the_depth(
            rows in 1..upto(70),
            depth in 1..upto(300),
            columns in 1..upto(100),
            transposed: bool,
            accumulate: bool,
        ) {
            let left = if transposed { panels(depth, rows, 1) } else { panels(rows, depth, 1) };
            let right = panels(depth, columns, 2);
            for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
                let mut out = Panels::new(rows, columns);
                out.data.fill(0.5);
                let panels = out.data.chunks_exact_mut(out.panel).zip(right.data.chunks_exact(right.panel));
                for (out, right) in panels {
                    let left = left.left(0, transposed);
                    simd::dispatch_on(level, Product { left, rows, depth, right, out, accumulate });
                }
                for i in 0..rows {
                    for j in 0..columns {
                        let of = |k| if transposed { element(k, i, 1) } else { element(i, k, 1) };
                        let sum: f32 = (0..depth).map(|k| of(k) * element(k, j, 2)).sum();
                        let expected = if accumulate { sum + 0.5 } else { sum };
                        prop_assert_eq!(out.get(i, j), expected, "{:?} {} {}", level, i, j);
                    }
                }
            }
        }

        #[test]
        fn transposes_of_every_instruction_set_have_rows_and_columns_exchanged(
            rows in 1_usize..=PANEL,
            columns in 1_usize..=PANEL,
        ) {
            struct Transpose<'a>(&'a [f32], &'a mut [f32]);
            impl Kernel for Transpose<'_> {
                type Output = ();
                #[inline(always)]
                fn run<S: Simd>(self) {
                    simd::transpose::<S>(self.0, self.1);
                }
            }
            let from = panels(rows, columns, 1);
            for level in [Level::Baseline, Level::Avx2, Level::Avx512] {
                let mut to = panels(columns, PANEL, 2);
                simd::dispatch_on(level, Transpose(&from.data, &mut to.data));
                for i in 0..PANEL {
                    for j in 0..columns {
                        let expected = if i < rows { from.get(i, j) } else { element(j, i, 2) };
                        prop_assert_eq!(to.get(j, i), expected, "{:?} {} {}", level, i, j);
                    }
                }
            }
        }
    }
}
