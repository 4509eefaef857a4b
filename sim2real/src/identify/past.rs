//! What of a torque goes with the past of a variable: a mass that is loose, a belt that swings or a cable that drags remember what the joint
//! did, and no function of what it does now predicts them.

use nalgebra::{DMatrix, DVector};

use super::torque::Moment;

/// Moments between values of the past that count: 20 ms.
const APART: usize = 2;
/// Values of the past that count: 0.2 s.
const TAPS: usize = 11;
/// Pull of every number towards none, as a share of the moments.
const PULL: f64 = 1e-3;

/// Predictions of the torque of `moments` by a linear function of the last 0.2 s of the variable with index `variable`, each block by the
/// function that was fitted without its fold.
pub fn predict(moments: &[Moment], variable: usize, fold: &dyn Fn(usize) -> usize, folds: usize) -> Vec<f64> {
    let rows = rows(moments, variable);
    let fold_of: Vec<usize> = moments.iter().map(|moment| fold(moment.block)).collect();
    let mut out = vec![0.0; moments.len()];
    for own in 0..folds {
        let train: Vec<usize> = (0..moments.len()).filter(|&k| fold_of[k] != own).collect();
        let inputs = DMatrix::from_fn(TAPS + 1, train.len(), |i, k| rows[(i, train[k])]);
        let torques = DVector::from_fn(train.len(), |k, _| moments[train[k]].torque);
        let pull = PULL * train.len() as f64;
        let matrix = &inputs * inputs.transpose() + DMatrix::identity(TAPS + 1, TAPS + 1) * pull;
        let Some(factor) = matrix.cholesky() else {
            continue;
        };
        let numbers = factor.solve(&(inputs * torques));
        for k in (0..moments.len()).filter(|&k| fold_of[k] == own) {
            out[k] = numbers.dot(&rows.column(k));
        }
    }
    out
}

/// A column a moment: one, and the variable now and before, as far back as its trial goes, over its typical size.
fn rows(moments: &[Moment], variable: usize) -> DMatrix<f64> {
    let value = |k: usize| moments[k].values[variable];
    let squares: f64 = (0..moments.len()).map(|k| value(k) * value(k)).sum();
    let size = (squares / moments.len().max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
    let mut first = 0;
    let firsts: Vec<usize> = (0..moments.len())
        .map(|k| {
            if moments[k].trial != moments[first].trial {
                first = k;
            }
            first
        })
        .collect();
    DMatrix::from_fn(TAPS + 1, moments.len(), |i, k| match i {
        0 => 1.0,
        i => value(k.saturating_sub((i - 1) * APART).max(firsts[k])) / size,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_late_is_predicted_by_the_past() {
        let value = |k: usize| (0.37 * k as f64).sin() + (0.0913 * (k * k % 977) as f64).cos();
        let moment = |k: usize| Moment {
            trial: k / 1000,
            log: 0,
            block: k / 100,
            torque: if k % 1000 < 8 { 0.0 } else { 0.3 * value(k - 8) },
            values: vec![value(k)],
        };
        let moments: Vec<Moment> = (0..4000).map(moment).collect();
        let predicted = predict(&moments, 0, &|block| block % 4, 4);
        let left: f64 = moments
            .iter()
            .zip(&predicted)
            .map(|(m, p)| (m.torque - p).powi(2))
            .sum();
        let whole: f64 = moments.iter().map(|m| m.torque * m.torque).sum();
        assert!(left < 0.05 * whole, "{left} of {whole}");
    }
}
