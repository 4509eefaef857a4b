//! At which frequencies what is lacking repeats over position.

use nalgebra::{Matrix4, Vector4};

use super::model::FEWEST_CYCLES;
use super::torque::Moment;

/// Frequencies (cycles per rad or m) at which the torque that is lacking repeats over position, the strongest first: a
/// straight search, as a ripple has no slope that would lead to its frequency from afar.
pub fn ripples(moments: &[Moment], range: f64, count: usize) -> Vec<f64> {
    // Slower ones are slopes; up to what readings can resolve.
    let highest = 200.0;
    let grid: Vec<f64> = (0..)
        .map(|k| FEWEST_CYCLES + 0.25 * f64::from(k))
        .take_while(|&f| f < highest)
        .collect();
    let takes: Vec<f64> = grid.iter().map(|&f| taken_by_wave(moments, range, f)).collect();
    let is_peak = |&i: &usize| {
        let above = |other: Option<usize>| other.and_then(|i| takes.get(i)).is_none_or(|other| takes[i] > *other);
        above(i.checked_sub(1)) && above(Some(i + 1))
    };
    let mut peaks: Vec<usize> = (0..grid.len()).filter(is_peak).collect();
    peaks.sort_by(|&a, &b| takes[b].total_cmp(&takes[a]));
    peaks.iter().take(count).map(|&i| grid[i] / range).collect()
}

/// How much of the torque's squares a wave of so many `cycles` over the `range` of positions takes beside a straight line: what goes up or down
/// with position would be most of every slow wave.
fn taken_by_wave(moments: &[Moment], range: f64, cycles: f64) -> f64 {
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for moment in moments {
        let x = moment.values[0] / range;
        let (sin, cos) = (std::f64::consts::TAU * cycles * x).sin_cos();
        let row = Vector4::new(1.0, x, sin, cos);
        normal += row * row.transpose();
        right += row * moment.torque;
    }
    // Positions of which all are one, or none, leave a wave open.
    (0..4).for_each(|i| normal[(i, i)] += 1e-9 * moments.len().max(1) as f64);
    let taken = |n: usize| {
        let (normal, right) = (normal.view((0, 0), (n, n)).into_owned(), right.rows(0, n).into_owned());
        normal.cholesky().map_or(0.0, |factor| factor.solve(&right).dot(&right))
    };
    taken(4) - taken(2)
}

#[cfg(test)]
mod tests {
    use super::super::torque::tests::moments;
    use super::*;

    #[test]
    fn a_slow_ripple_shows_its_frequency_beside_a_slope() {
        // 1.6 and 1.8 cycles over a range of 2.
        for (frequency, slope) in [(0.8, 0.0), (0.9, 3.0), (0.9, -3.0)] {
            let torque = |q: f64, _| (std::f64::consts::TAU * frequency * q).sin() + slope * q;
            let found = ripples(&moments(torque), 2.0, 3);
            assert!(found.iter().any(|f| (f - frequency).abs() < 0.1), "{slope}: {found:?}");
        }
    }

    #[test]
    fn a_ripple_shows_its_frequency() {
        let found = ripples(&moments(|q, _| (std::f64::consts::TAU * 3.0 * q).sin()), 2.0, 1);
        assert!((found[0] - 3.0).abs() < 0.2, "{found:?}");
    }
}
