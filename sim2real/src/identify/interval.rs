//! 95 % intervals of fitted numbers that respect autocorrelation: the sandwich of the curvature and the scatter of
//! gradients between clusters (White 1980; Newey and West 1987 for neighbours in time).

use nalgebra::{DMatrix, DVector};

use super::cross::{Folds, student_tail};
use super::fit::{Data, Fit, sum};
use super::scales::Scales;

/// Relative error of slopes by finite differences: motion that sticks has kinks.
const SLOPE_ERROR: f64 = 0.02;
/// Share that a number has in a direction from which on it is part of it.
const PART: f64 = 0.1;

/// Half width of the 95 % interval of every fitted number, in its own unit; infinite where the logs cannot tell.
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
    let Some(inverse) = small.cholesky().map(|factor| factor.inverse()) else {
        return out;
    };
    let (scatter, clusters) = scatter(fit, folds, &told);
    let covariance = &inverse * scatter * &inverse;
    let quantile = quantile(clusters.saturating_sub(1).max(1) as f64);
    let pull = data.pull_of_the_step(&fit.model, scales);
    let moved = &inverse * DVector::from_fn(m, |a, _| pull[told[a]]);
    for (a, &i) in told.iter().enumerate() {
        let noise = quantile * covariance[(a, a)].max(0.0).sqrt();
        out[i] = (noise + 2.0 * moved[a].abs()) * free[i].scale;
    }
    out
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

/// Scatter of the gradients between clusters, with half the products of neighbours, and the number of clusters.
fn scatter(fit: &Fit, folds: &Folds, told: &[usize]) -> (DMatrix<f64>, usize) {
    let clusters = folds.clusters();
    let m = told.len();
    let gradients: Vec<DVector<f64>> = clusters
        .iter()
        .map(|blocks| {
            DVector::from_fn(m, |a, _| {
                blocks.iter().map(|&b| fit.slopes[b].gradient[told[a]]).sum::<f64>()
            })
        })
        .collect();
    let count = gradients.len();
    let mean = gradients.iter().fold(DVector::zeros(m), |sum, g| sum + g) / count.max(1) as f64;
    let mut scatter = DMatrix::zeros(m, m);
    for (k, gradient) in gradients.iter().enumerate() {
        let own = gradient - &mean;
        scatter += &own * own.transpose();
        if let Some(next) = gradients.get(k + 1).filter(|_| !folds.whole_logs()) {
            let next = next - &mean;
            let product = &own * next.transpose();
            scatter += 0.5 * (&product + product.transpose());
        }
    }
    (
        scatter * (count as f64 / (count.saturating_sub(1).max(1)) as f64),
        count,
    )
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
    use super::*;

    #[test]
    fn numbers_that_do_the_same_are_not_told() {
        // The first two move readings alike to one part in a thousand, the third does something of its own, the last nothing.
        let rows = DMatrix::from_row_slice(3, 4, &[1.0, 1.0, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(told(&(rows.transpose() * &rows)), [2]);
    }
}
