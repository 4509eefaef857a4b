//! Sparse factorisation `H = L^T L` and triangular solves (Featherstone, Rigid Body Dynamics Algorithms, section 6.5).
//!
//! A row of L holds the entries of its path to the root, so nothing fills in. With `y = L^-T J^T` for a row J of a
//! constraint, its inverse inertia is `y . y` and the velocity change of an impulse vector is found by one solve with
//! L at the end of the step: the solver works on `u = L (v' - v)`, where all inertias are one.

use super::lane::Lane;
use super::model::Row;

/// Replaces the packed matrix by its factor; the diagonal's inverse goes to `inverse_diagonal`.
#[inline(always)]
pub fn factor<L: Lane>(rows: &[Row], matrix: &mut [L], inverse_diagonal: &mut [L]) {
    for (k, row) in rows.iter().enumerate().rev() {
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

/// `x = L^-T x`
#[inline(always)]
pub fn half_solve<L: Lane>(rows: &[Row], matrix: &[L], inverse_diagonal: &[L], x: &mut [L]) {
    for (k, row) in rows.iter().enumerate().rev() {
        let value = x[k] * inverse_diagonal[k];
        x[k] = value;
        for (entry, &ancestor) in matrix[row.start..].iter().zip(&row.ancestors) {
            x[ancestor] = entry.neg_mul_add(value, x[ancestor]);
        }
    }
}

/// `x = L^-1 x`
#[inline(always)]
pub fn finish_solve<L: Lane>(rows: &[Row], matrix: &[L], inverse_diagonal: &[L], x: &mut [L]) {
    for (k, row) in rows.iter().enumerate() {
        let mut value = x[k];
        for (entry, &ancestor) in matrix[row.start..].iter().zip(&row.ancestors) {
            value = entry.neg_mul_add(x[ancestor], value);
        }
        x[k] = value * inverse_diagonal[k];
    }
}

/// `x = L^-T x` for N right-hand sides that are zero off `path`; `x` holds the path's rows.
#[inline(always)]
pub fn half_solve_path<L: Lane, const N: usize>(
    rows: &[Row],
    matrix: &[L],
    inverse_diagonal: &[L],
    path: &[usize],
    x: &mut [[L; N]],
) {
    for (a, &k) in path.iter().enumerate().rev() {
        let (above, own) = x.split_at_mut(a);
        let own = &mut own[0];
        for value in own.iter_mut() {
            *value *= inverse_diagonal[k];
        }
        for (entry, above) in matrix[rows[k].start..].iter().zip(above) {
            for (x, value) in above.iter_mut().zip(&*own) {
                *x = entry.neg_mul_add(*value, *x);
            }
        }
    }
}

/// `L^-T` of the unit impulse at degree of freedom `k`; `x` holds its path, itself last.
#[inline(always)]
pub fn half_solve_unit<L: Lane>(rows: &[Row], matrix: &[L], inverse_diagonal: &[L], k: usize, x: &mut [L]) {
    let ancestors = &rows[k].ancestors;
    let last = ancestors.len();
    let unit = inverse_diagonal[k];
    x[last] = unit;
    for (x, entry) in x[..last].iter_mut().zip(&matrix[rows[k].start..]) {
        *x = -(*entry * unit);
    }
    for (a, &i) in ancestors.iter().enumerate().rev() {
        let (above, own) = x.split_at_mut(a);
        let value = own[0] * inverse_diagonal[i];
        own[0] = value;
        for (x, entry) in above.iter_mut().zip(&matrix[rows[i].start..]) {
            *x = entry.neg_mul_add(value, *x);
        }
    }
}
