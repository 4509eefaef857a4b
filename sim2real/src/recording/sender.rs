//! Targets in a table of readings: a row has the one that held when it was read, not the moment from which on it did.
//!
//! What sends targets by a clock of its own, and more slowly than rows come, does so at some moment between two rows. Where it sends many one
//! after the other, those moments lie on a line, which is known better than any of them; a single one is most likely in the middle. What is
//! left open no model can know, and a second series, as likely, shows how much that is.

use omniwalk_env::random::Stream;

use super::Series;

/// Changes that are farther apart, in rows, say nothing of how regularly a sender sends.
const LONGEST: usize = 8;
/// Fewer changes do not show whether there is a clock of its own.
const FEWEST: usize = 50;
/// Share of the changes that may be a row off where sender and rows are in step: lost rows, and clocks that drift apart by chance.
const OUT_OF_STEP: f64 = 0.005;
/// Fewest and most changes that a line is laid through: what is shorter says little, and no clock runs evenly for long.
const LINE: (usize, usize) = (10, 200);

/// When targets may have been given that a table holds.
pub(super) struct Sent {
    /// Most likely.
    pub likely: Series,
    /// At moments drawn from those that the rows allow, the same for all joints of a table.
    pub otherwise: Series,
    /// Usual time between rows, s.
    pub within: f64,
}

/// Rows before and at a change, s.
type Between = (f64, f64);

/// `None` where targets change in step with the `rows`, as they do where one program writes both, or too rarely to say.
pub(super) fn between(rows: &Series) -> Option<Sent> {
    let changes: Vec<usize> = (1..rows.len())
        .filter(|&i| rows.value[i] != rows.value[i - 1])
        .collect();
    let usual = out_of_step(&changes)?;
    let between: Vec<Between> = changes.iter().map(|&i| (rows.time[i - 1], rows.time[i])).collect();
    let mut draws = Stream::new(0, 0, 0);
    let shares: Vec<f64> = (0..rows.len()).map(|_| draws.unit()).collect();
    let middle = between.iter().map(|(before, at)| 0.5 * (before + at)).collect();
    let drawn = changes
        .iter()
        .zip(&between)
        .map(|(&i, (before, at))| at - shares[i] * (at - before));
    let drawn = drawn.collect();
    let series = |mut times: Vec<f64>| {
        for run in runs(&changes, usual) {
            straighten(&mut times[run.clone()], &between[run]);
        }
        times.insert(0, rows.time[0]);
        let values = changes.iter().map(|&i| rows.value[i]);
        Series {
            time: times,
            value: [rows.value[0]].into_iter().chain(values).collect(),
        }
    };
    Some(Sent {
        likely: series(middle),
        otherwise: series(drawn),
        within: rows.pace().usual,
    })
}

/// How many rows apart changes usually are, where they are not always.
fn out_of_step(changes: &[usize]) -> Option<usize> {
    let apart = changes
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|rows| *rows <= LONGEST);
    let mut counts = [0_usize; LONGEST + 2];
    apart.for_each(|rows| counts[rows] += 1);
    let all: usize = counts.iter().sum();
    let usual = (1..=LONGEST).max_by_key(|&rows| counts[rows]).unwrap_or(1);
    let off = (counts[usual - 1] + counts[usual + 1]) as f64;
    let shown = all >= FEWEST && usual > 1 && off > OUT_OF_STEP * (off + counts[usual] as f64);
    shown.then_some(usual)
}

/// Ranges of changes between which a sender sent one after the other, `usual` rows or one more or less apart.
fn runs(changes: &[usize], usual: usize) -> Vec<std::ops::Range<usize>> {
    let mut runs = Vec::new();
    let mut begin = 0;
    for i in 1..=changes.len() {
        let goes_on = i < changes.len() && (changes[i] - changes[i - 1]).abs_diff(usual) <= 1;
        if !goes_on || i - begin == LINE.1 {
            runs.push(begin..i);
            begin = i;
        }
    }
    runs.retain(|run| run.len() >= LINE.0);
    runs
}

/// Puts `times`, which follow each other evenly, onto the line that fits them best, as far as their rows allow.
fn straighten(times: &mut [f64], between: &[Between]) {
    let n = times.len() as f64;
    let middle = 0.5 * (n - 1.0);
    let mean = times.iter().sum::<f64>() / n;
    let tilted: f64 = times
        .iter()
        .enumerate()
        .map(|(k, t)| (k as f64 - middle) * (t - mean))
        .sum();
    let every = tilted / (n * (n * n - 1.0) / 12.0);
    for ((k, time), (before, at)) in times.iter_mut().enumerate().zip(between) {
        // After the row before.
        let earliest = before + 1e-6 * (at - before);
        *time = (mean + (k as f64 - middle) * every).clamp(earliest, *at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows at `hertz` for 6 s that hold the last target of a sender at 100 Hz.
    fn rows(hertz: f64, target: impl Fn(f64) -> f64) -> Series {
        let time: Vec<f64> = (0..(6.0 * hertz) as usize).map(|k| k as f64 / hertz).collect();
        let value = time.iter().map(|t| target((t * 100.0 + 1e-9).floor() * 0.01)).collect();
        Series { time, value }
    }

    #[test]
    fn targets_of_another_clock_were_given_between_two_rows() {
        let rows = rows(195.0, |t| (3.0 * t).sin());
        let sent = between(&rows).expect("another clock");
        for series in [&sent.likely, &sent.otherwise] {
            assert_eq!(series.len(), 600);
            assert!(series.time.windows(2).all(|pair| pair[0] < pair[1]));
            // The line is known to less than a millisecond, a row is 5 ms.
            let late = |(k, t): (usize, &f64)| (t - 0.01 * k as f64).abs();
            let latest = series.time.iter().enumerate().map(late).fold(0.0, f64::max);
            assert!(latest < 1e-3, "{latest}");
        }
        assert_ne!(sent.likely, sent.otherwise);
    }

    #[test]
    fn targets_that_are_sent_now_and_then_lie_in_the_middle_between_rows() {
        // Two in a row every 30 ms.
        let rows = rows(195.0, |t| {
            ((t * 100.0).round() - f64::from((t * 100.0).round() as u32 % 3 == 2)) * 1e-3
        });
        let sent = between(&rows).expect("another clock");
        let at = |i: usize| rows.time.iter().position(|t| *t > sent.likely.time[i]).expect("a row");
        for i in 1..sent.likely.len() {
            let middle = 0.5 * (rows.time[at(i) - 1] + rows.time[at(i)]);
            assert!((sent.likely.time[i] - middle).abs() < 1e-9);
            let drawn = sent.otherwise.time[i];
            assert!(rows.time[at(i) - 1] < drawn && drawn <= rows.time[at(i)]);
        }
    }

    #[test]
    fn targets_that_change_with_the_rows_were_given_then() {
        assert!(between(&rows(100.0, f64::sin)).is_none(), "in every row");
        assert!(between(&rows(200.0, f64::sin)).is_none(), "in every other row");
        assert!(between(&rows(195.0, |t| t.floor())).is_none(), "steps");
        assert!(between(&rows(195.0, |_| 0.5)).is_none(), "none");
    }
}
