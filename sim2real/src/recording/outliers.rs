//! Single readings that no joint took: a bit that was lost on the bus, a register read half way.
//!
//! Such a reading is far from where its neighbours on both sides lead, on the same side of both, and without it they are of one
//! motion. A joint that stops dead or turns round is on the line that leads there, and stays.

use super::Series;
use super::pace::median;

/// A reading is out when it is so many times as far off as the median reading is, or steps of the encoder.
const FAR: f64 = 20.0;
/// And so far beyond all neighbours, and off either side's line, as a share of how far it is off them together: a reading that came late is
/// not.
const OFF_LINE: f64 = 0.5;
/// What it leaves of that without it.
const MENDED: f64 = 0.25;
/// Neighbours lie within so many typical intervals.
const NEAR: f64 = 8.0;

/// Takes the readings out of `series` that no joint took; how many they were.
pub(super) fn take_out(series: &mut Series) -> usize {
    let out = outliers(series);
    let count = out.iter().filter(|out| **out).count();
    if count > 0 {
        let mut kept = out.iter().map(|out| !out);
        series.value.retain(|_| kept.next().unwrap_or(true));
        let mut kept = out.iter().map(|out| !out);
        series.time.retain(|_| kept.next().unwrap_or(true));
    }
    count
}

fn outliers(series: &Series) -> Vec<bool> {
    let mut out = vec![false; series.len()];
    let inner = 2..series.len().saturating_sub(2);
    let off: Vec<f64> = inner.clone().map(|i| off(series, i, None).abs()).collect();
    let steps = series.value.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let resolution = steps.filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
    let Some(typical) = median(off.clone()) else {
        return out;
    };
    let interval = series.pace().usual;
    let least = FAR * typical.max(resolution);
    for (i, off) in inner.zip(off) {
        let near = series.time[i + 2] - series.time[i - 2] < NEAR * interval;
        out[i] = near && off > least && stands_out(series, i, off);
    }
    out
}

/// Whether reading `i`, which is off the curve through its neighbours by `distance`, is beyond all of them and off both sides' lines the same
/// way, and they are of one motion.
fn stands_out(series: &Series, i: usize, distance: f64) -> bool {
    let (t, v) = (&series.time, &series.value);
    let around = [v[i - 2], v[i - 1], v[i + 1], v[i + 2]];
    let beyond = around.iter().all(|other| v[i] - other > OFF_LINE * distance)
        || around.iter().all(|other| other - v[i] > OFF_LINE * distance);
    let line = |a: usize, b: usize| v[b] + (v[b] - v[a]) / (t[b] - t[a]) * (t[i] - t[b]);
    let sides = [line(i - 2, i - 1), line(i + 2, i + 1)].map(|line| v[i] - line);
    let same_way = sides[0] * sides[1] > 0.0 && sides.iter().all(|side| side.abs() > OFF_LINE * distance);
    let mended = Some((i, v[i] - off(series, i, None)));
    let left = (i - 2..=i + 2).filter(|&j| j != i && j >= 2 && j + 2 < series.len());
    beyond
        && same_way
        && left
            .into_iter()
            .all(|j| off(series, j, mended).abs() < MENDED * distance)
}

/// How far reading `i` is from the cubic through the two on either side of it, with another value for one of them perhaps.
fn off(series: &Series, i: usize, instead: Option<(usize, f64)>) -> f64 {
    let value = |j: usize| {
        instead
            .filter(|(own, _)| *own == j)
            .map_or(series.value[j], |(_, value)| value)
    };
    let others = [i - 2, i - 1, i + 1, i + 2];
    let weight = |j: usize| {
        let factor = |k: &usize| (series.time[i] - series.time[*k]) / (series.time[j] - series.time[*k]);
        others.iter().filter(|k| **k != j).map(factor).product::<f64>()
    };
    value(i) - others.iter().map(|&j| weight(j) * value(j)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use omniwalk_env::random::Stream;

    use super::*;

    /// A swing at 100 Hz, with jitter, noise of 0.5 mrad, and stops at 0.4 rad.
    fn swing() -> Series {
        let mut random = Stream::new(3, 0, 0);
        let time: Vec<f64> = (0..600)
            .map(|k| 0.01 * f64::from(k) + 2e-3 * random.uniform(-1.0, 1.0))
            .collect();
        let value = time
            .iter()
            .map(|t| (6.0 * t).sin().min(0.4) + random.normal(5e-4))
            .collect();
        Series { time, value }
    }

    #[test]
    fn readings_that_no_joint_took_are_left_out_and_no_others() {
        let mut clean = swing();
        assert_eq!(take_out(&mut clean), 0);
        let mut spoiled = swing();
        for (i, by) in [(50, 0.3), (200, -3.0), (201 + 60, 0.3), (430, 6.2), (590, 0.3)] {
            spoiled.value[i] += by;
        }
        assert_eq!(take_out(&mut spoiled), 5);
        let without = |i: &usize| ![50, 200, 261, 430, 590].contains(i);
        let kept: Vec<f64> = (0..600).filter(without).map(|i| clean.value[i]).collect();
        assert_eq!(spoiled.value, kept);
    }

    #[test]
    fn steps_turns_and_coarse_encoders_have_no_outliers() {
        let series = |value: &dyn Fn(usize) -> f64| Series {
            time: (0..300).map(|k| 0.01 * k as f64).collect(),
            value: (0..300).map(value).collect(),
        };
        let step = |k: usize| f64::from(u8::from(k % 40 >= 20)) + if k % 40 == 20 { -0.5 } else { 0.0 };
        let triangle = |k: usize| 0.05 * (k % 60).abs_diff(30) as f64;
        let coarse = |k: usize| ((0.05 * k as f64).sin() * 300.0).round() / 300.0;
        for (what, value) in [
            ("steps", &step as &dyn Fn(usize) -> f64),
            ("turns", &triangle),
            ("coarse", &coarse),
        ] {
            assert_eq!(take_out(&mut series(value)), 0, "{what}");
        }
        for n in 0..6 {
            let mut few = series(&step);
            few.time.truncate(n);
            few.value.truncate(n);
            assert_eq!(take_out(&mut few), 0);
        }
    }
}
