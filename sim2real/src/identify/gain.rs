//! Whether one model predicts better than another, by what each loses on blocks of time it was not fitted to.

use std::collections::BTreeMap;

use omniwalk_env::random::Stream;

use super::fit::{Loss, total};

/// Draws of a bootstrap.
const DRAWS: u64 = 2000;

/// By how much a model predicts better than another, on blocks it was not fitted to.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// Fall of the loss over the loss before.
    pub share: f64,
    /// Probability of seeing such a fall were there none.
    pub p: f64,
}

impl Gain {
    /// No better, or not known to be.
    pub const NONE: Self = Self { share: 0.0, p: 1.0 };

    /// Of losses `before` and `after` by block and degree of freedom, all of these together or one of them, of which the others' noise would
    /// hide it: p is that of the least likely times the number of such tests. The bootstrap draws blocks of a `cluster` (that of each block)
    /// together.
    pub fn of(cluster: &[usize], before: &[Loss], after: &[Loss]) -> Self {
        let (a, b) = (total(before), total(after));
        if !(b.is_finite() && a > 0.0) {
            return Self {
                share: f64::NEG_INFINITY,
                p: 1.0,
            };
        }
        let dofs = before.len() / cluster.len().max(1);
        let mut p = chance(cluster, before, after, |_| true);
        if dofs > 1 {
            let own = (0..dofs).map(|d| chance(cluster, before, after, |dof| dof == d));
            p = (own.fold(p, f64::min) * (dofs + 1) as f64).min(1.0);
        }
        Self { share: 1.0 - b / a, p }
    }
}

/// Probability that the degrees of freedom of `which` gain what they do by chance: by a bootstrap over clusters of what each loses or
/// gains relative to its own loss, which finds small gains everywhere, or by the ratio of the losses, which finds large gains in few.
fn chance(cluster: &[usize], before: &[Loss], after: &[Loss], which: impl Fn(usize) -> bool) -> f64 {
    let dofs = before.len() / cluster.len().max(1);
    let mut clusters: BTreeMap<usize, [f64; 2]> = BTreeMap::new();
    for (cell, (before, after)) in before
        .iter()
        .zip(after)
        .enumerate()
        .filter(|(cell, _)| which(cell % dofs))
    {
        let sums = clusters.entry(cluster[cell / dofs]).or_default();
        sums[0] += before.squares;
        sums[1] += after.squares;
    }
    let [a, b] = [0, 1].map(|i| clusters.values().map(|sums| sums[i]).sum::<f64>());
    let mean = (a + b) / (2.0 * clusters.len() as f64);
    let change = |[a, b]: &[f64; 2]| (a - b) / (a + b + mean);
    let changes: Vec<f64> = clusters.values().map(change).collect();
    // The better of two tests is better by chance twice as often.
    (2.0 * significance(&changes).min(ratio_test(&clusters, a, b))).min(1.0)
}

/// Probability of the ratio of two losses by an F test with as many observations as there are clusters that make up the
/// loss: their participation ratio, so that one wild block counts as one.
fn ratio_test(clusters: &BTreeMap<usize, [f64; 2]>, before: f64, after: f64) -> f64 {
    let squares: f64 = clusters.values().map(|[a, _]| a * a).sum();
    let effective = before * before / squares;
    if after <= 0.0 || before <= after || effective < 3.0 {
        return 1.0;
    }
    let freedom = effective - 1.0;
    2.0 * student_tail(((before / after - 1.0) * freedom).sqrt(), freedom)
}

/// Probability that the mean of `changes` is this far above zero by chance: a bootstrap of pairs of neighbours, and the tail
/// of Student's distribution at the mean over its spread, as no number of draws reaches small probabilities.
fn significance(changes: &[f64]) -> f64 {
    let n = changes.len();
    if n < 3 {
        return 1.0;
    }
    let mean = changes.iter().sum::<f64>() / n as f64;
    let mut stream = Stream::new(0x1de7, 0, 0);
    let pairs = n.div_ceil(2);
    let draw = |_| {
        let mut sum = 0.0;
        for _ in 0..pairs {
            let first = (stream.unit() * n as f64) as usize % n;
            sum += changes[first] + changes[(first + 1) % n];
        }
        sum / (2 * pairs) as f64 - mean
    };
    let squares: f64 = (0..DRAWS).map(draw).map(|d| d * d).sum();
    let spread = (squares / DRAWS as f64).sqrt();
    if spread == 0.0 {
        return if mean > 0.0 { 0.0 } else { 1.0 };
    }
    student_tail(mean / spread, (n - 1) as f64)
}

/// Probability of Student's distribution with `freedom` degrees of freedom above `t`: Simpson's rule over its density in
/// the angle atan(t / sqrt(freedom)), where it is a power of the cosine.
pub fn student_tail(t: f64, freedom: f64) -> f64 {
    if !t.is_finite() {
        return if t > 0.0 { 0.0 } else { 1.0 };
    }
    let end = std::f64::consts::FRAC_PI_2;
    let start = (t / freedom.sqrt()).atan();
    let integral = |from: f64| {
        let steps = 4000;
        let h = (end - from) / f64::from(steps);
        let at = |k: i32| (from + f64::from(k) * h).cos().max(0.0).powf(freedom - 1.0);
        (0..steps)
            .step_by(2)
            .map(|k| at(k) + 4.0 * at(k + 1) + at(k + 2))
            .sum::<f64>()
            * h
            / 3.0
    };
    (integral(start) / integral(-end)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_tables() {
        for (t, freedom, p) in [
            (1.812, 10.0, 0.05),
            (2.764, 10.0, 0.01),
            (12.706, 1.0, 0.025),
            (0.0, 5.0, 0.5),
        ] {
            assert!((student_tail(t, freedom) - p).abs() < 2e-4 * (1.0 + p), "{t} {freedom}");
        }
    }

    #[test]
    fn what_one_joint_gains_is_not_hidden_by_the_noise_of_the_others() {
        const BLOCKS: usize = 40;
        const DOFS: usize = 4;
        let cluster: Vec<usize> = (0..BLOCKS).collect();
        // The last joint moves in a fifth of the blocks, and there its loss falls to a twentieth; of the others' some rise and some fall.
        let wobble = |cell: usize| 1.0 + 0.5 * ((cell * 37 % 41) as f64 / 20.0 - 1.0);
        let loss = |cell: usize, share: f64| {
            let squares = match cell % DOFS {
                3 if (cell / DOFS).is_multiple_of(5) => 2.5 * share,
                3 => 0.0,
                _ => wobble(cell + (share < 1.0) as usize * 7),
            };
            Loss { squares, count: 1.0 }
        };
        let [before, after] =
            [1.0, 0.05].map(|share| (0..BLOCKS * DOFS).map(|cell| loss(cell, share)).collect::<Vec<_>>());
        let together = chance(&cluster, &before, &after, |_| true);
        let tried = 80.0;
        assert!(together * tried > 0.05, "{together}");
        assert!(Gain::of(&cluster, &before, &after).p * tried < 0.05);
        assert!(Gain::of(&cluster, &before, &before).p > 0.05);
    }

    #[test]
    fn changes_about_zero_are_no_gain_and_steady_ones_are() {
        let wobble: Vec<f64> = (0..40).map(|k| ((k * 37 % 40) as f64 - 19.5) / 20.0).collect();
        assert!(significance(&wobble) > 0.3);
        let steady: Vec<f64> = wobble.iter().map(|w| 0.5 + 0.3 * w).collect();
        assert!(significance(&steady) < 1e-6);
    }
}
