//! Running mean, variance and range of observations.

/// Smallest standard deviation: a quantity that hardly moves is not blown up.
const FLOOR: f64 = 0.01;

/// Statistics of observations, and the `f32` form in which they are applied.
#[derive(Clone, Debug)]
pub(crate) struct Normaliser {
    pub enabled: bool,
    pub clip: f32,
    pub count: u64,
    pub mean: Vec<f64>,
    /// Sum of squared deviations from the mean.
    pub squares: Vec<f64>,
    /// Smallest and largest values so far; the smallest is above the largest before the first.
    pub range: [Vec<f32>; 2],
    applied_mean: Vec<f32>,
    applied_deviation: Vec<f32>,
    applied_scale: Vec<f32>,
    batch_mean: Vec<f64>,
    batch_squares: Vec<f64>,
}

impl Normaliser {
    pub(crate) fn new(len: usize, enabled: bool, clip: f64) -> Self {
        Self {
            enabled,
            clip: clip as f32,
            count: 0,
            mean: vec![0.0; len],
            squares: vec![0.0; len],
            range: [vec![f32::INFINITY; len], vec![f32::NEG_INFINITY; len]],
            applied_mean: vec![0.0; len],
            applied_deviation: vec![1.0; len],
            applied_scale: vec![1.0; len],
            batch_mean: vec![0.0; len],
            batch_squares: vec![0.0; len],
        }
    }

    /// Mean and standard deviation as they are applied.
    pub(crate) fn applied(&self) -> (&[f32], &[f32]) {
        (&self.applied_mean, &self.applied_deviation)
    }

    /// Normalises part of an observation, from its element `first` on.
    pub(crate) fn apply(&self, first: usize, from: &[f32], to: &mut [f32]) {
        let statistics = self.applied_mean[first..].iter().zip(&self.applied_scale[first..]);
        for ((to, &x), (&mean, &scale)) in to.iter_mut().zip(from).zip(statistics) {
            *to = ((x - mean) * scale).clamp(-self.clip, self.clip);
        }
    }

    /// Merges a batch of observations, row-major, into the statistics: its own in two passes, then Chan et al. (1979).
    pub(crate) fn merge(&mut self, observations: &[f32]) {
        let len = self.mean.len();
        let [lower, upper] = &mut self.range;
        for row in observations.chunks_exact(len.max(1)) {
            for ((lower, upper), &x) in lower.iter_mut().zip(upper.iter_mut()).zip(row) {
                (*lower, *upper) = (lower.min(x), upper.max(x));
            }
        }
        if !self.enabled || len == 0 || observations.is_empty() {
            return;
        }
        let rows = observations.len() / len;
        self.batch_mean.fill(0.0);
        self.batch_squares.fill(0.0);
        for row in observations.chunks_exact(len) {
            self.batch_mean
                .iter_mut()
                .zip(row)
                .for_each(|(sum, &x)| *sum += f64::from(x));
        }
        self.batch_mean.iter_mut().for_each(|sum| *sum /= rows as f64);
        for row in observations.chunks_exact(len) {
            for ((sum, &x), mean) in self.batch_squares.iter_mut().zip(row).zip(&self.batch_mean) {
                *sum += (f64::from(x) - mean) * (f64::from(x) - mean);
            }
        }
        let (old, new) = (self.count as f64, rows as f64);
        for i in 0..len {
            let shift = self.batch_mean[i] - self.mean[i];
            self.mean[i] += shift * new / (old + new);
            self.squares[i] += self.batch_squares[i] + shift * shift * old * new / (old + new);
        }
        self.count += rows as u64;
        self.refresh();
    }

    /// Derives the applied form from the statistics.
    pub(crate) fn refresh(&mut self) {
        if !self.enabled || self.count == 0 {
            return;
        }
        for i in 0..self.mean.len() {
            let deviation = (self.squares[i] / self.count as f64).sqrt().max(FLOOR);
            self.applied_mean[i] = self.mean[i] as f32;
            self.applied_deviation[i] = deviation as f32;
            self.applied_scale[i] = 1.0 / self.applied_deviation[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn merged_batches_have_the_statistics_of_all_rows_together(
            rows in prop::collection::vec(prop::array::uniform2(-1e3_f32..1e3), 2..60),
            cut in 0_usize..60,
        ) {
            let flat: Vec<f32> = rows.iter().flatten().copied().collect();
            let cut = 2 * cut.min(rows.len());
            let mut merged = Normaliser::new(2, true, 10.0);
            merged.merge(&flat[..cut]);
            merged.merge(&flat[cut..]);
            for i in 0..2 {
                let column: Vec<f64> = rows.iter().map(|row| f64::from(row[i])).collect();
                let mean = column.iter().sum::<f64>() / column.len() as f64;
                let variance = column.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / column.len() as f64;
                prop_assert!((merged.mean[i] - mean).abs() < 1e-9);
                let outside = |&x: &f64| x < f64::from(merged.range[0][i]) || x > f64::from(merged.range[1][i]);
                prop_assert!(!column.iter().any(outside));
                let ends = merged.range.each_ref().map(|range| f64::from(range[i]));
                prop_assert!(ends.iter().all(|end| column.contains(end)));
                prop_assert!((merged.squares[i] / merged.count as f64 - variance).abs() <= 1e-9 * variance.max(1.0));
            }
        }
    }
}
