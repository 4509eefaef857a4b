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
    /// What numbers the updates of the rows have.
    numbered: Numbered,
    /// What of the file was left out.
    pub damage: Option<String>,
}

/// Numbers of the updates in the first row and in the last, and how many rows follow the first.
#[derive(Clone, Copy, Debug, Default)]
struct Numbered {
    first: f64,
    last: f64,
    steps: usize,
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
                let number = metrics.columns.iter().position(|column| column == "update");
                let number = number.and_then(|column| values.get(column));
                curves.numbered.note(number.copied().unwrap_or(f64::NAN), metrics.rows);
            }
        })?;
        curves.damage = metrics.damage();
        curves.columns = metrics.columns;
        Ok(curves)
    }

    /// Updates a point is the mean of.
    pub fn updates_per_point(&self) -> usize {
        self.rows
    }

    /// Updates from one row to the next: more than one where rows were taken out, as of runs that are kept in a repository.
    pub fn apart(&self) -> usize {
        self.numbered.apart()
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

impl Numbered {
    fn note(&mut self, number: f64, rows: usize) {
        if rows <= 1 {
            self.first = number;
        }
        self.last = number;
        self.steps = rows.saturating_sub(1);
    }

    /// Numbers that are missing, or none that updates have, say nothing.
    fn apart(&self) -> usize {
        let apart = ((self.last - self.first) / self.steps.max(1) as f64).round();
        if (1.0..1e9).contains(&apart) { apart as usize } else { 1 }
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
        assert_eq!(curves.apart(), 1);
    }

    #[test]
    fn rows_that_were_taken_out_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        for (name, first, apart, expected) in [
            ("all", 1.0, 1.0, 1),
            ("thinned", 39.0, 40.0, 40),
            ("odd", f64::NAN, 1.0, 1),
        ] {
            let path = folder.path().join(name);
            let mut writer = MetricsWriter::create(&path, &["update"]).unwrap();
            for row in 0..10 {
                writer.append(row + 1, &[first + apart * row as f64]).unwrap();
            }
            assert_eq!(Curves::read(&path, String::new()).unwrap().apart(), expected, "{name}");
        }
    }
}
