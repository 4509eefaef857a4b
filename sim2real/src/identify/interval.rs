//! 95 % intervals of fitted numbers, of three parts: noise, what the physics step leaves open, and what the model is wrong about.
//!
//! Noise: how far the fit moves when a log, or a block of time, is left out (jackknife over clusters: MacKinnon, Nielsen and Webb 2023;
//! Newey and West 1987 for neighbours in time), which respects autocorrelation. The scatter of gradients between clusters alone is too
//! small where there are not many more of them than numbers, as the fit has bent to each of them.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::cross::Folds;
use super::descent::sum;
use super::fit::Fit;
use super::gain::student_tail;
use super::leftover::squares;
use super::select::Selector;

/// Relative error of slopes by finite differences: motion that sticks has kinks.
const SLOPE_ERROR: f64 = 0.02;
/// A cluster counts as having told at most this share of a direction: what it alone tells, leaving it out says nothing of.
const LEVERAGE: f64 = 0.9;
/// Share that a number has in a direction from which on it is part of it.
const PART: f64 = 0.1;
/// Share of the most by which what a model is wrong about can have moved a number that the 95 % interval has. Of 136 numbers of effects that were
/// rightly named in three lists of sealed cases, whose intervals had all of it, 0.4 and 0.8, some 130 (95 %) are within what has 0.6 (half
/// widths times 0.6, 1.5 and 0.75): play and friction, which real machines have in another form, are off by more than noise by as much.
const ALONG: f64 = 0.6;

/// Half widths of the 95 % interval of a fitted number, in its own unit; infinite where the logs cannot tell.
#[derive(Clone, Copy, Debug)]
pub struct HalfWidth {
    /// Were the model right: noise and the physics step.
    pub right: f64,
    /// As wrong as it is.
    pub whole: f64,
    /// As far as what it is wrong about can have moved the number.
    pub most: f64,
}

/// Intervals of every number of `fit`.
///
/// What the physics step leaves open is by how much the fit would move were the readings those of half the step, twice, as an integrator
/// of first order is off by twice what half its step changes.
///
/// A model that does not reach the floor is wrong beyond noise, in every log alike, so that no scatter between logs shows it. What of that goes
/// along with a number has moved it unseen; what does not is the loss above the floor. As much is taken to be in either: of a robot of one
/// joint, a number is left open over all values that are no worse than the fit by more than the fit is worse than the floor, the other numbers
/// fitted again; of several joints, by what each joint's own loss above its floor can move it, the root of the sum of their squares. That is
/// the most; all that is wrong would have to go along with this one number for it, and [`ALONG`] of it is what the interval has.
pub fn intervals(selector: &Selector<'_>, fit: &Fit) -> Vec<HalfWidth> {
    let (data, scales) = (selector.data, selector.scales);
    let free = fit.model.free(scales);
    let n = free.len();
    let (_, curvature) = sum(&fit.slopes, &|_| true, n);
    // Numbers that do nothing, or nothing that others could not do, are set apart, so that they do not spoil the rest.
    let told: Vec<usize> = told(&curvature);
    let m = told.len();
    let of_told = |curvature: &DMatrix<f64>| DMatrix::from_fn(m, m, |a, b| curvature[(told[a], told[b])]);
    let unknown = HalfWidth {
        right: f64::INFINITY,
        whole: f64::INFINITY,
        most: f64::INFINITY,
    };
    let mut out = vec![unknown; n];
    if told.is_empty() {
        return out;
    }
    let Some(factor) = of_told(&curvature).cholesky() else {
        return out;
    };
    let shifts = shifts(&clusters(fit, selector.folds, &told), &factor);
    let covariance = covariance(&shifts, m, selector.folds.whole_logs());
    let quantile = quantile(shifts.len().saturating_sub(1).max(1) as f64);
    let by_dof = data.slopes_against_half_the_step(&fit.model, scales);
    let pull: DVector<f64> = by_dof.iter().map(|slope| &slope.gradient).sum();
    let moved = factor.solve(&DVector::from_fn(m, |a, _| pull[told[a]]));
    let curvatures: Vec<DMatrix<f64>> = by_dof.iter().map(|slope| of_told(&slope.curvature)).collect();
    let wrong = wrong(&factor, &curvatures, &excess(selector, fit));
    for (a, &i) in told.iter().enumerate() {
        let noise = quantile * covariance[(a, a)].max(0.0).sqrt();
        let step = 2.0 * moved[a].abs();
        out[i] = HalfWidth {
            right: (noise + step) * free[i].scale,
            whole: (noise.hypot(ALONG * wrong[a]) + step) * free[i].scale,
            most: (noise.hypot(wrong[a]) + step) * free[i].scale,
        };
    }
    out
}

/// Loss above the floor, by degree of freedom.
fn excess(selector: &Selector<'_>, fit: &Fit) -> Vec<f64> {
    let squares = squares(selector.data, &fit.model);
    let above = squares.iter().zip(&selector.floors).map(|(own, floor)| own - floor);
    above.map(|above| above.max(0.0)).collect()
}

/// By how much residuals whose squares sum up to `excess` can move each number at most, the root of the sum of squares over degrees of freedom;
/// `curvatures` are theirs, `factor` is that of their sum.
fn wrong(factor: &Cholesky<f64, Dyn>, curvatures: &[DMatrix<f64>], excess: &[f64]) -> Vec<f64> {
    let inverse = factor.inverse();
    let squares = |a: usize| {
        let moved = inverse.column(a);
        let own = curvatures.iter().zip(excess);
        own.map(|(curvature, excess)| excess * moved.dot(&(curvature * moved)))
            .sum::<f64>()
    };
    (0..inverse.ncols()).map(|a| squares(a).max(0.0).sqrt()).collect()
}

/// The numbers that the logs tell: those with no part in a direction along which, in units of what each does alone, readings
/// change by less than slopes by finite differences are good for.
pub fn told(curvature: &DMatrix<f64>) -> Vec<usize> {
    let n = curvature.nrows();
    let largest = (0..n).map(|i| curvature[(i, i)]).fold(0.0, f64::max);
    let active: Vec<usize> = (0..n).filter(|&i| curvature[(i, i)] > 1e-12 * largest).collect();
    let own = |a: usize| curvature[(active[a], active[a])].sqrt();
    let m = active.len();
    if m == 0 {
        return active;
    }
    let unit = DMatrix::from_fn(m, m, |a, b| curvature[(active[a], active[b])] / (own(a) * own(b)));
    let eigen = unit.symmetric_eigen();
    let open = |a: &usize| {
        let untold = (0..m).filter(|&k| eigen.eigenvalues[k] < SLOPE_ERROR * SLOPE_ERROR);
        untold.map(|k| eigen.eigenvectors[(*a, k)].powi(2)).sum::<f64>() < PART * PART
    };
    (0..m).filter(open).map(|a| active[a]).collect()
}

/// Gradient and curvature of each cluster in the numbers that are `told`.
fn clusters(fit: &Fit, folds: &Folds, told: &[usize]) -> Vec<(DVector<f64>, DMatrix<f64>)> {
    let m = told.len();
    let of = |blocks: &Vec<usize>| {
        let (mut gradient, mut curvature) = (DVector::zeros(m), DMatrix::zeros(m, m));
        for slope in blocks.iter().map(|&block| &fit.slopes[block]) {
            gradient += DVector::from_fn(m, |a, _| slope.gradient[told[a]]);
            curvature += DMatrix::from_fn(m, m, |a, b| slope.curvature[(told[a], told[b])]);
        }
        (gradient, curvature)
    };
    folds.clusters().iter().map(of).collect()
}

/// How far a fit moves when each of `clusters` is left out, to first order; `factor` is that of their curvatures' sum.
fn shifts(clusters: &[(DVector<f64>, DMatrix<f64>)], factor: &Cholesky<f64, Dyn>) -> Vec<DVector<f64>> {
    let lower = factor.l();
    let m = lower.nrows();
    let sum = clusters
        .iter()
        .fold(DVector::zeros(m), |sum, (gradient, _)| sum + gradient);
    let mean = sum / clusters.len().max(1) as f64;
    let solved = |of: &DMatrix<f64>| {
        let solved = lower.solve_lower_triangular(of);
        solved.unwrap_or_else(|| DMatrix::zeros(m, of.ncols()))
    };
    let shift = |(gradient, curvature): &(DVector<f64>, DMatrix<f64>)| {
        // In units in which all clusters together have curvature one, one of them has its share in every direction.
        let shares = solved(&solved(curvature).transpose()).symmetric_eigen();
        let own = DMatrix::from_columns(&[gradient - &mean]);
        let mut pull = shares.eigenvectors.tr_mul(&solved(&own));
        for (pull, share) in pull.iter_mut().zip(&shares.eigenvalues) {
            *pull /= 1.0 - share.clamp(0.0, LEVERAGE);
        }
        let shift = lower.tr_solve_lower_triangular(&(&shares.eigenvectors * pull));
        shift.map_or_else(|| DVector::zeros(m), |shift| shift.column(0).into_owned())
    };
    clusters.iter().map(shift).collect()
}

/// Covariance of `m` numbers that move by `shifts` when a cluster is left out, with half the products of neighbours where clusters
/// are no `whole_logs`.
fn covariance(shifts: &[DVector<f64>], m: usize, whole_logs: bool) -> DMatrix<f64> {
    let mut covariance = DMatrix::zeros(m, m);
    for (k, own) in shifts.iter().enumerate() {
        covariance += own * own.transpose();
        if let Some(next) = shifts.get(k + 1).filter(|_| !whole_logs) {
            let product = own * next.transpose();
            covariance += 0.5 * (&product + product.transpose());
        }
    }
    let count = shifts.len().max(1) as f64;
    covariance * ((count - 1.0).max(1.0) / count)
}

/// The 97.5 % point of Student's distribution.
fn quantile(freedom: f64) -> f64 {
    let (mut low, mut high) = (0.0, 100.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if student_tail(middle, freedom) > 0.025 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use omniwalk_env::random::Stream;

    use super::*;

    #[test]
    fn shifts_are_what_fits_without_a_cluster_differ_by() {
        const NUMBERS: usize = 3;
        let mut random = Stream::new(5, 0, 0);
        let mut normal = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random.normal(1.0));
        let clusters: Vec<_> = (0..6).map(|_| (normal(5, NUMBERS), normal(5, 1))).collect();
        // Least squares over all but the cluster that is left out.
        let solution = |out: Option<usize>| {
            let (mut curvature, mut right) = (DMatrix::zeros(NUMBERS, NUMBERS), DMatrix::zeros(NUMBERS, 1));
            for (x, y) in clusters
                .iter()
                .enumerate()
                .filter(|(k, _)| Some(*k) != out)
                .map(|(_, c)| c)
            {
                curvature += x.transpose() * x;
                right += x.transpose() * y;
            }
            curvature.cholesky().expect("a fit").solve(&right)
        };
        let all = solution(None);
        let slope = |(x, y): &(DMatrix<f64>, DMatrix<f64>)| {
            let gradient = x.transpose() * (x * &all - y);
            (gradient.column(0).into_owned(), x.transpose() * x)
        };
        let slopes: Vec<_> = clusters.iter().map(slope).collect();
        let sum = slopes
            .iter()
            .fold(DMatrix::zeros(NUMBERS, NUMBERS), |sum, (_, c)| sum + c);
        for (k, shift) in shifts(&slopes, &sum.cholesky().expect("a fit")).iter().enumerate() {
            let moved = solution(Some(k)) - &all;
            assert!((moved.column(0) - shift).norm() < 1e-10, "cluster {k}: {moved} {shift}");
        }
    }

    #[test]
    fn a_model_is_wrong_about_a_number_by_what_moves_the_loss_as_far_as_it_is_above_the_floor() {
        let curvature = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 9.0]);
        let factor = curvature.clone().cholesky().expect("a fit");
        let all = wrong(&factor, std::slice::from_ref(&curvature), &[0.25]);
        // The least loss at a first number that is off by d is d^2 (4 - 1 / 9).
        assert!(
            (all[0] - (0.25_f64 / (4.0 - 1.0 / 9.0)).sqrt()).abs() < 1e-12,
            "{all:?}"
        );
        // A joint that one number alone moves leaves the other as it is.
        let first = DMatrix::from_row_slice(2, 2, &[4.0, 0.0, 0.0, 0.0]);
        let second = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 9.0]);
        let factor = (&first + &second).cholesky().expect("a fit");
        assert_eq!(wrong(&factor, &[first, second], &[1.0, 0.0]), [0.5, 0.0]);
    }

    #[test]
    fn numbers_that_do_the_same_are_not_told() {
        // The first two move readings alike to one part in a thousand, the third does something of its own, the last nothing.
        let rows = DMatrix::from_row_slice(3, 4, &[1.0, 1.0, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(told(&(rows.transpose() * &rows)), [2]);
        assert!(told(&DMatrix::zeros(3, 3)).is_empty());
        assert!(told(&DMatrix::zeros(0, 0)).is_empty());
    }
}
