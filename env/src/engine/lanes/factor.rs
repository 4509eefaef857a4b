//! Sparse factorisation `H = L^T L` and the inverse of the factor (Featherstone, Rigid Body Dynamics Algorithms, section 6.5).
//!
//! A row of L holds the entries of its path to the root, so nothing fills in, not in its inverse either. With `y = L^-T J^T`
//! for a row J of a constraint, its inverse inertia is `y . y` and the velocity change of an impulse vector is found by
//! one product with `L^-1` at the end of the step: the solver works on `u = L (v' - v)`, where all inertias are one.
//!
//! Every joint is a constraint whose row is a unit vector, so all rows of `X = L^-1` are needed anyhow. Products with them
//! wait for nothing and store once an entry, where solves with L wait for every row of the path and store with every product.

use super::lane::Lane;
use super::model::Row;

/// Replaces the packed matrix by its factor; the diagonal's inverse goes to `inverse_diagonal`. `outward` is [`super::model::Model::outward`].
#[inline(always)]
pub fn factor<L: Lane>(rows: &[Row], outward: &[usize], matrix: &mut [L], inverse_diagonal: &mut [L]) {
    for &k in outward.iter().rev() {
        let row = &rows[k];
        let (above, own) = matrix.split_at_mut(row.start);
        let (own, rest) = own.split_at_mut(row.ancestors.len());
        let inverse = rest[0].sqrt().recip();
        inverse_diagonal[k] = inverse;
        for entry in own.iter_mut() {
            *entry *= inverse;
        }
        for (a, &ancestor) in row.ancestors.iter().enumerate() {
            let start = rows[ancestor].start;
            let scale = own[a];
            for (entry, x) in above[start..=start + a].iter_mut().zip(&*own) {
                *entry = scale.neg_mul_add(*x, *entry);
            }
        }
    }
}

/// Columns of the inverse that are summed side by side: those of a floating base are the first such block.
const BLOCK: usize = 6;

/// `sums[c] += entry row[c]`, written out for the columns `c`: as a loop it would keep the sums in memory.
macro_rules! add_row {
    ($sums:ident, $entry:expr, $row:expr, $($c:literal)*) => {{
        let (entry, row) = ($entry, $row);
        $($sums[$c] = entry.mul_add(row[$c], $sums[$c]);)*
    }};
}

/// Fills `inverse` with `X = L^-1`, packed like the matrix: `X_k = (e_k - sum L_ka X_a) / L_kk` over the ancestors a of k.
#[inline(always)]
pub fn invert<L: Lane>(rows: &[Row], outward: &[usize], factor: &[L], inverse_diagonal: &[L], inverse: &mut [L]) {
    for &k in outward {
        let (row, own) = (&rows[k], inverse_diagonal[k]);
        let (above, x) = inverse.split_at_mut(row.start);
        let (factor, ancestors) = (&factor[row.start..row.diagonal()], &row.ancestors[..]);
        let x = &mut x[..=ancestors.len()];
        let whole = ancestors.len() / BLOCK * BLOCK;
        for j in (0..whole).step_by(BLOCK) {
            let sums = block(rows, above, &factor[j..], &ancestors[j..], j);
            for (x, sum) in x[j..j + BLOCK].iter_mut().zip(sums) {
                *x = -(sum * own);
            }
        }
        for (j, x) in (whole..).zip(&mut x[whole..ancestors.len()]) {
            let mut sum = L::zero();
            for (entry, &a) in factor[j..].iter().zip(&ancestors[j..]) {
                sum = entry.mul_add(above[rows[a].start + j], sum);
            }
            *x = -(sum * own);
        }
        x[ancestors.len()] = own;
    }
}

/// `sum L_ka X_a` in the columns from `j` on; `factor` and `ancestors` begin with the one of that place.
#[inline(always)]
fn block<L: Lane>(rows: &[Row], inverse: &[L], factor: &[L], ancestors: &[usize], j: usize) -> [L; BLOCK] {
    let mut sums = [L::zero(); BLOCK];
    add_row!(sums, factor[0], &inverse[rows[ancestors[0]].start + j..], 0);
    add_row!(sums, factor[1], &inverse[rows[ancestors[1]].start + j..], 0 1);
    add_row!(sums, factor[2], &inverse[rows[ancestors[2]].start + j..], 0 1 2);
    add_row!(sums, factor[3], &inverse[rows[ancestors[3]].start + j..], 0 1 2 3);
    add_row!(sums, factor[4], &inverse[rows[ancestors[4]].start + j..], 0 1 2 3 4);
    add_row!(sums, factor[5], &inverse[rows[ancestors[5]].start + j..], 0 1 2 3 4 5);
    for (&entry, &a) in factor[BLOCK..].iter().zip(&ancestors[BLOCK..]) {
        let start = rows[a].start + j;
        add_row!(sums, entry, &inverse[start..start + BLOCK], 0 1 2 3 4 5);
    }
    sums
}

/// `x = X^T x`
#[inline(always)]
pub fn multiply_transposed<L: Lane>(rows: &[Row], inverse: &[L], x: &mut [L]) {
    for (k, row) in rows.iter().enumerate() {
        let value = x[k];
        for (entry, &a) in inverse[row.start..].iter().zip(&row.ancestors) {
            x[a] = entry.mul_add(value, x[a]);
        }
        x[k] = inverse[row.diagonal()] * value;
    }
}

/// `sum + X_ij x_i` over the rows i of `path` from its place `from` on, for the column at place `j`.
#[inline(always)]
pub fn plus_column<L: Lane>(
    rows: &[Row],
    inverse: &[L],
    path: &[usize],
    j: usize,
    from: usize,
    x: &[[L; 6]],
    mut sum: [L; 6],
) -> [L; 6] {
    for (x, &k) in x[from..].iter().zip(&path[from..]) {
        add_row!(sum, inverse[rows[k].start + j], x, 0 1 2 3 4 5);
    }
    sum
}

/// `X_k . x`
#[inline(always)]
pub fn row_product<L: Lane>(row: &Row, k: usize, inverse: &[L], x: &[L]) -> L {
    let (own, ancestors) = (&inverse[row.start..=row.diagonal()], &row.ancestors);
    // Four sums at once: one would wait for every product.
    let [mut p, mut q, mut r, mut s] = [own[ancestors.len()] * x[k], L::zero(), L::zero(), L::zero()];
    for (y, a) in own.chunks_exact(4).zip(ancestors.chunks_exact(4)) {
        p = y[0].mul_add(x[a[0]], p);
        q = y[1].mul_add(x[a[1]], q);
        r = y[2].mul_add(x[a[2]], r);
        s = y[3].mul_add(x[a[3]], s);
    }
    let whole = ancestors.len() & !3;
    for (y, &a) in own[whole..].iter().zip(&ancestors[whole..]) {
        q = y.mul_add(x[a], q);
    }
    (p + q) + (r + s)
}

/// `x = X x`
#[inline(always)]
pub fn multiply<L: Lane>(rows: &[Row], inverse: &[L], x: &mut [L]) {
    // From the last row upwards: a row looks at ancestors alone.
    for (k, row) in rows.iter().enumerate().rev() {
        x[k] = row_product(row, k, inverse, x);
    }
}
