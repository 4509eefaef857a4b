//! How regularly a quantity is sampled: the usual interval, and what is a gap beside it.

use super::Series;

/// Intervals this many times the usual one are gaps.
const GAP: f64 = 5.0;
/// Gaps are never shorter, s: schedulers of ordinary systems make such pauses.
const SHORTEST_GAP: f64 = 0.05;

/// How regularly a quantity is sampled.
pub struct Pace {
    /// Intervals between samples, s.
    pub intervals: Vec<f64>,
    /// The median of those, s; 0 without any.
    pub usual: f64,
    /// A longer interval is a gap, s.
    pub gap: f64,
}

impl Series {
    /// How regularly it is sampled.
    pub fn pace(&self) -> Pace {
        let intervals: Vec<f64> = self.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let usual = median(intervals.clone()).unwrap_or(0.0);
        Pace {
            intervals,
            usual,
            gap: (GAP * usual).max(SHORTEST_GAP),
        }
    }
}

/// The middle value; none without values.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
