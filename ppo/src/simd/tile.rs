//! The micro-kernel of the matrix product, and the transposition.

use super::{PANEL, Simd, sets::BLOCK};

/// The left operand of [`tile`], a matrix in panels, see [`crate::matrix::Panels`].
#[derive(Clone, Copy)]
pub(crate) struct Left<'a> {
    /// The elements.
    pub data: &'a [f32],
    /// Floats from a panel to the next.
    pub panel: usize,
    /// The operand is the transpose of what is stored.
    pub transposed: bool,
}

/// `out (rows x PANEL) = left (rows x depth) * panel (depth x PANEL)`, or added to `out`.
#[inline(always)]
pub(crate) fn tile<S: Simd>(left: Left, rows: usize, depth: usize, panel: &[f32], out: &mut [f32], accumulate: bool) {
    if rows == 0 || depth == 0 {
        return;
    }
    let (stored_rows, stored_columns) = if left.transposed { (depth, rows) } else { (rows, depth) };
    let last = (stored_columns - 1) / PANEL * left.panel + (stored_rows - 1) * PANEL + (stored_columns - 1) % PANEL;
    assert!(last < left.data.len() && stored_rows * PANEL <= left.panel);
    assert!(panel.len() >= depth * PANEL && out.len() >= rows * PANEL);
    let mut row = 0;
    while row < rows {
        let mut count = rows - row;
        if left.transposed {
            count = count.min(PANEL - row % PANEL);
        }
        // As even as can be: what is left in the end would wait for its own sums.
        count = count.div_ceil(count.div_ceil(S::ROWS));
        let offset = if left.transposed {
            row / PANEL * left.panel + row % PANEL
        } else {
            row * PANEL
        };
        for column in (0..PANEL).step_by(2 * S::LANES) {
            // SAFETY: the asserts above bound the rows and the depth of all three operands: `block` reads `count` rows
            // of the left operand from `row` on and two vectors of each of the panel's rows, and writes as much of
            // `count` rows. Two vectors of every instruction set divide a panel.
            unsafe {
                let a = left.data.as_ptr().add(offset);
                let b = panel.as_ptr().add(column);
                let c = out.as_mut_ptr().add(row * PANEL + column);
                block::<S>(left, count, depth, a, b, c, accumulate);
            }
        }
        row += count;
    }
}

/// Chooses the micro-kernel.
#[inline(always)]
unsafe fn block<S: Simd>(
    left: Left,
    rows: usize,
    depth: usize,
    a: *const f32,
    b: *const f32,
    c: *mut f32,
    accumulate: bool,
) {
    macro_rules! choose {
        ($($rows:literal)*) => {
            match (rows, left.transposed) {
                $(
                    ($rows, false) => micro::<S, $rows, false>(depth, a, left.panel, b, c, accumulate),
                    ($rows, true) => micro::<S, $rows, true>(depth, a, left.panel, b, c, accumulate),
                )*
                _ => unreachable!("rows are at most S::ROWS"),
            }
        };
    }
    unsafe { choose!(1 2 3 4 5 6 7 8 9 10 11 12) }
}

/// `R` rows of two vectors, held in registers over the depth.
#[inline(always)]
unsafe fn micro<S: Simd, const R: usize, const TRANSPOSED: bool>(
    depth: usize,
    a: *const f32,
    a_panel: usize,
    b: *const f32,
    c: *mut f32,
    accumulate: bool,
) {
    unsafe {
        let mut sums = [[S::zero(); 2]; R];
        let mut start = 0;
        while start < depth {
            // Along the rows of the left operand a panel ends after so many columns; down its columns it does not.
            let end = if TRANSPOSED { depth } else { depth.min(start + PANEL) };
            let a = if TRANSPOSED { a } else { a.add(start / PANEL * a_panel) };
            let b = b.add(start * PANEL);
            for k in 0..end - start {
                let x = [S::load(b.add(k * PANEL)), S::load(b.add(k * PANEL + S::LANES))];
                for (i, sums) in sums.iter_mut().enumerate() {
                    let scalar = *a.add(if TRANSPOSED { k * PANEL + i } else { i * PANEL + k });
                    for (sum, x) in sums.iter_mut().zip(x) {
                        *sum = S::multiply_add(scalar, x, *sum);
                    }
                }
            }
            start = end;
        }
        for (i, sums) in sums.into_iter().enumerate() {
            for (j, sum) in sums.into_iter().enumerate() {
                let to = c.add(i * PANEL + j * S::LANES);
                S::store(to, if accumulate { S::add(S::load(to), sum) } else { sum });
            }
        }
    }
}

/// Writes the transpose of part of a panel, at most [`PANEL`] rows, into part of another panel, of as many rows as
/// columns are wanted.
#[inline(always)]
pub(crate) fn transpose<S: Simd>(from: &[f32], to: &mut [f32]) {
    let (rows, columns) = (from.len() / PANEL, to.len() / PANEL);
    assert!(rows <= PANEL && columns <= PANEL);
    for row in (0..rows).step_by(BLOCK) {
        for column in (0..columns).step_by(BLOCK) {
            if row + BLOCK <= rows && column + BLOCK <= columns {
                // SAFETY: the block lies within both.
                unsafe {
                    S::transpose(
                        from.as_ptr().add(row * PANEL + column),
                        to.as_mut_ptr().add(column * PANEL + row),
                    );
                }
                continue;
            }
            for i in row..rows.min(row + BLOCK) {
                for j in column..columns.min(column + BLOCK) {
                    to[j * PANEL + i] = from[i * PANEL + j];
                }
            }
        }
    }
}
