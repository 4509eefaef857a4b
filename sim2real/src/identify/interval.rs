//! 95 % intervals of fitted numbers that respect autocorrelation: how far the fit moves when a log, or a block of time, is left out
//! (jackknife over clusters: MacKinnon, Nielsen and Webb 2023; Newey and West 1987 for neighbours in time). The scatter of gradients
//! between clusters alone is too small where there are not many more of them than numbers, as the fit has bent to each of them.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::cross::{Folds, student_tail};
use super::descent::sum;
use super::fit::{Data, Fit, total};
use super::scales::Scales;

/// Relative error of slopes by finite differences: motion that sticks has kinks.
const SLOPE_ERROR: f64 = 0.02;
/// A cluster counts as having told at most this share of a direction: what it alone tells, leaving it out says nothing of.
const LEVERAGE: f64 = 0.9;
/// Share that a number has in a direction from which on it is part of it.
const PART: f64 = 0.1;

/// Half width of the 95 % interval of every fitted number, in its own unit, were the model right; infinite where the logs cannot tell.
///
/// What the physics step leaves open comes on top: by how much the fit would move were the readings those of half the step,
/// twice, as an integrator of first order is off by twice what half its step changes.
pub fn intervals(data: &Data, fit: &Fit, folds: &Folds, scales: &Scales) -> Vec<f64> {
    let free = fit.model.free(scales);
    let n = free.len();
    let (_, curvature) = sum(&fit.slopes, &|_| true, n);
    // Numbers that do nothing, or nothing that others could not do, are set apart, so that they do not spoil the rest.
    let told: Vec<usize> = told(&curvature);
    let m = told.len();
    let small = DMatrix::from_fn(m, m, |a, b| curvature[(told[a], told[b])]);
    let mut out = vec![f64::INFINITY; n];
    let Some(factor) = small.cholesky() else {
        return out;
    };
    let shifts = shifts(&clusters(fit, folds, &told), &factor);
    let covariance = covariance(&shifts, m, folds.whole_logs());
    let quantile = quantile(shifts.len().saturating_sub(1).max(1) as f64);
    let pull = data.pull_of_the_step(&fit.model, scales);
    let moved = factor.solve(&DVector::from_fn(m, |a, _| pull[told[a]]));
    for (a, &i) in told.iter().enumerate() {
        let noise = quantile * covariance[(a, a)].max(0.0).sqrt();
        out[i] = (noise + 2.0 * moved[a].abs()) * free[i].scale;
    }
    out
}

/// `intervals` of a model as wrong as `fit` is, which does not reach the `floor` (a weighted loss): by more than noise, and by as much in
/// logs it has not seen. What of that goes along with a number moves it unseen; intervals are wider by the ratio of the residual to the
/// floor (the scale factor of the Particle Data Group: Review of Particle Physics 2024, Introduction, 5.2.2).
pub fn widened(intervals: &[f64], fit: &Fit, floor: f64) -> Vec<f64> {
    let wrong = (total(&fit.losses) / floor).sqrt().max(1.0);
    intervals.iter().map(|half| wrong * half).collect()
}

/// The numbers that the logs tell: those with no part in a direction along which, in units of what each does alone, readings
/// change by less than slopes by finite differences are good for.
pub fn told(curvature: &DMatrix<f64>) -> Vec<usize> {
    let n = curvature.nrows();
    let largest = (0..n).map(|i| curvature[(i, i)]).fold(0.0, f64::max);
    let active: Vec<usize> = (0..n).filter(|&i| curvature[(i, i)] > 1e-12 * largest).collect();
    let own = |a: usize| curvature[(active[a], active[a])].sqrt();
    let m = active.len();
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
    fn numbers_that_do_the_same_are_not_told() {
        // The first two move readings alike to one part in a thousand, the third does something of its own, the last nothing.
        let rows = DMatrix::from_row_slice(3, 4, &[1.0, 1.0, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(told(&(rows.transpose() * &rows)), [2]);
    }
}
