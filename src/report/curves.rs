//! Learning curves from `metrics.csv` in bounded memory, whatever the length of the run.

use std::path::Path;

use crate::run::metrics::{Metrics, MetricsError};

/// Bins at which pairs of bins become one, so that a curve has half as many to all of them.
const MAX_BINS: usize = 256;

/// The metrics of a run: each point is the mean over as many updates as every other point.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// Name of the run, for the legend.
    pub name: String,
    columns: Vec<String>,
    bins: Vec<Bin>,
    /// Rows in a full bin.
    rows: usize,
}

#[derive(Clone, Debug)]
struct Bin {
    rows: usize,
    /// Step of the last row.
    step: u64,
    /// Sum and number of the finite values, a pair a column.
    sums: Vec<(f64, usize)>,
}

impl Curves {
    /// Reads the metrics at `path`.
    ///
    /// # Errors
    /// [`MetricsError`].
    pub fn read(path: &Path, name: String) -> Result<Self, MetricsError> {
        let mut curves = Self {
            name,
            rows: 1,
            ..Self::default()
        };
        let metrics = Metrics::scan(path, |metrics| {
            if let Some((step, values)) = &metrics.last {
                curves.push(*step, values);
            }
        })?;
        curves.columns = metrics.columns;
        Ok(curves)
    }

    /// Updates a point is the mean of.
    pub fn updates_per_point(&self) -> usize {
        self.rows
    }

    /// The last step.
    pub fn steps(&self) -> u64 {
        self.bins.last().map_or(0, |bin| bin.step)
    }

    /// Step and mean of a column; empty if there is no such column. NaN where nothing was measured.
    pub fn column(&self, name: &str) -> Vec<(f64, f64)> {
        let Some(column) = self.columns.iter().position(|other| other == name) else {
            return Vec::new();
        };
        let mean = |(sum, count): (f64, usize)| if count > 0 { sum / count as f64 } else { f64::NAN };
        let point = |bin: &Bin| (bin.step as f64, mean(bin.sums[column]));
        self.bins.iter().map(point).collect()
    }

    fn push(&mut self, step: u64, values: &[f64]) {
        let one = |&value: &f64| if value.is_finite() { (value, 1) } else { (0.0, 0) };
        let new = Bin {
            rows: 1,
            step,
            sums: values.iter().map(one).collect(),
        };
        if let Some(bin) = self.bins.last_mut().filter(|bin| bin.rows < self.rows) {
            return bin.add(&new);
        }
        if self.bins.len() == MAX_BINS {
            self.bins = self.bins.chunks(2).map(Bin::merged).collect();
            self.rows *= 2;
        }
        self.bins.push(new);
    }
}

impl Bin {
    fn add(&mut self, later: &Bin) {
        self.rows += later.rows;
        self.step = later.step;
        for (sum, other) in self.sums.iter_mut().zip(&later.sums) {
            *sum = (sum.0 + other.0, sum.1 + other.1);
        }
    }

    fn merged(bins: &[Bin]) -> Bin {
        let mut merged = bins[0].clone();
        bins[1..].iter().for_each(|bin| merged.add(bin));
        merged
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::metrics::MetricsWriter;

    #[test]
    fn points_are_means_over_equally_many_updates_and_skip_what_was_not_measured() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let mut writer = MetricsWriter::create(&path, &["line", "odd"]).unwrap();
        let rows = 4 * MAX_BINS as u64 - 1;
        for step in 1..=rows {
            let odd = if step % 2 == 1 { 5.0 } else { f64::NAN };
            writer.append(step, &[step as f64, odd]).unwrap();
        }
        let curves = Curves::read(&path, "run".to_owned()).unwrap();
        assert_eq!((curves.updates_per_point(), curves.steps()), (4, rows));
        let line = curves.column("line");
        assert_eq!(line.len(), MAX_BINS);
        for (i, &(step, mean)) in line[..MAX_BINS - 1].iter().enumerate() {
            assert_eq!((step, mean), (4.0 * i as f64 + 4.0, 4.0 * i as f64 + 2.5));
        }
        assert!(curves.column("odd").iter().all(|&(_, mean)| mean == 5.0));
        assert!(curves.column("none").is_empty());
    }
}
