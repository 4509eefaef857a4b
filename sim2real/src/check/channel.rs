//! One series by itself: rate, jitter, gaps, noise, values it rests at.

use serde::Serialize;

use crate::recording::{Pace, Series, median};

/// The median of absolute values of a normal variable, in standard deviations.
const MEDIAN_OF_NORMAL: f64 = 0.6745;

/// The figures of a series.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Channel {
    /// Samples.
    pub samples: usize,
    /// Samples per second: one over the median interval; 0 with fewer than two.
    pub rate: f64,
    /// Spread of the intervals without gaps: standard deviation over mean.
    pub jitter: f64,
    /// Longest interval, s.
    pub longest_gap: f64,
    /// Share of the time that lies in gaps: intervals of five times the median and at least 50 ms.
    pub in_gaps: f64,
    /// Smallest and largest value; none without samples.
    pub range: Option<[f64; 2]>,
    /// Standard deviation of the values.
    pub deviation: f64,
    /// Smallest difference between consecutive values that differ; 0 if all are equal.
    pub resolution: f64,
    /// Standard deviation of noise, from fourth differences; also what quantisation makes.
    pub noise: f64,
    /// Largest share of the samples, in runs of at least ten, that rest at the largest or smallest value.
    pub at_bounds: f64,
}

impl Channel {
    /// The figures of `series`.
    pub fn new(series: &Series) -> Self {
        let Some(first) = series.value.first() else {
            return Self::default();
        };
        let fold = |range: [f64; 2], value: &f64| [range[0].min(*value), range[1].max(*value)];
        let range = series.value.iter().fold([*first; 2], fold);
        let steps = series.value.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let resolution = steps.filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
        let Pace { intervals, usual, gap } = series.pace();
        let (gaps, regular): (Vec<f64>, Vec<f64>) = intervals.iter().partition(|interval| **interval > gap);
        Self {
            samples: series.len(),
            rate: if usual > 0.0 { 1.0 / usual } else { 0.0 },
            jitter: spread(&regular),
            longest_gap: intervals.iter().fold(0.0, |longest, interval| longest.max(*interval)),
            in_gaps: gaps.iter().sum::<f64>() / series.span().max(1e-12),
            range: Some(range),
            deviation: deviation(&series.value),
            resolution: if resolution.is_finite() { resolution } else { 0.0 },
            noise: noise(&series.value),
            at_bounds: range
                .iter()
                .fold(0.0, |share, bound| share.max(resting(&series.value, *bound))),
        }
    }

    /// Largest less smallest value; 0 without samples.
    pub(super) fn width(&self) -> f64 {
        self.range.map_or(0.0, |range| range[1] - range[0])
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>();
    (squares / values.len().max(1) as f64).sqrt()
}

/// Standard deviation over mean.
fn spread(values: &[f64]) -> f64 {
    let mean = mean(values);
    if mean > 0.0 { deviation(values) / mean } else { 0.0 }
}

/// Fourth differences of white noise have seventy times its variance; motion hardly has any from sample to sample.
fn noise(values: &[f64]) -> f64 {
    let fourth = |v: &[f64]| (v[4] - 4.0 * v[3] + 6.0 * v[2] - 4.0 * v[1] + v[0]).abs();
    let typical = median(values.windows(5).map(fourth).collect()).unwrap_or(0.0);
    typical / (MEDIAN_OF_NORMAL * 70_f64.sqrt())
}

/// Share of the samples in runs of at least ten at `bound`.
fn resting(values: &[f64], bound: f64) -> f64 {
    let runs = values.chunk_by(|a, b| a == b);
    let long = runs.filter(|run| run.len() >= 10 && run[0] == bound);
    long.map(<[f64]>::len).sum::<usize>() as f64 / values.len().max(1) as f64
}
