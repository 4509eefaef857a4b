//! What a sample says of the whole: means and shares with their 95 % confidence intervals.

/// 97.5 % quantile of the standard normal distribution.
const Z: f64 = 1.959_963_984_540_054;

/// A figure with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The figure; NaN without data.
    pub value: f64,
    /// Lower end; NaN where the data give none.
    pub low: f64,
    /// Upper end; NaN where the data give none.
    pub high: f64,
}

impl Estimate {
    /// A share of `hits` among `trials` with the score interval of Wilson (1927), which holds for shares near 0 and 1.
    pub fn share(hits: usize, trials: usize) -> Self {
        let n = trials as f64;
        let p = hits as f64 / n;
        let centre = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        Self {
            value: p,
            // The ends that are 0 and 1 would be so only up to rounding.
            low: if hits == 0 { 0.0 } else { centre - half },
            high: if hits == trials { 1.0 } else { centre + half },
        }
    }

    /// The mean of independent `values` with Student's interval; a single value has none.
    pub fn mean(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let value = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - value).powi(2)).sum::<f64>() / (n - 1.0);
        let half = if values.len() < 2 {
            f64::NAN
        } else {
            student(values.len() - 1) * (variance / n).sqrt()
        };
        Self {
            value,
            low: value - half,
            high: value + half,
        }
    }

    /// Half the width of the interval.
    pub fn half_width(&self) -> f64 {
        0.5 * (self.high - self.low)
    }
}

/// 97.5 % quantile of Student's t distribution with `freedom` degrees of freedom, at least one.
pub fn student(freedom: usize) -> f64 {
    let (mut low, mut high) = (0.0, 13.0);
    // Halved until nothing is between the two.
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if within(middle, freedom) < 0.95 {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// Probability that |T| is below `t`, by the finite series of Abramowitz and Stegun 26.7.3 and 26.7.4.
fn within(t: f64, freedom: usize) -> f64 {
    let (sine, cosine) = (t / (freedom as f64).sqrt()).atan().sin_cos();
    let odd = freedom % 2 == 1;
    let mut term = if odd { cosine } else { 1.0 };
    let mut sum = 0.0;
    for k in (if odd { 1 } else { 0 }..freedom.saturating_sub(1)).step_by(2) {
        sum += term;
        term *= cosine * cosine * (k + 1) as f64 / (k + 2) as f64;
    }
    if odd {
        2.0 / std::f64::consts::PI * (sine.atan2(cosine) + sine * sum)
    } else {
        sine * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn student_quantiles_are_those_of_the_closed_forms_and_of_the_tables() {
        // One degree of freedom is the Cauchy distribution, two have t = (2p - 1) / sqrt(2 p (1 - p)).
        assert!((student(1) - (std::f64::consts::PI * 0.475).tan()).abs() < 1e-9);
        assert!((student(2) - 0.95 / (2.0_f64 * 0.975 * 0.025).sqrt()).abs() < 1e-9);
        for (freedom, table) in [(3, 3.182), (4, 2.776), (9, 2.262), (30, 2.042), (99, 1.984)] {
            assert!(
                (student(freedom) - table).abs() < 5e-4,
                "{freedom}: {}",
                student(freedom)
            );
        }
        // The distribution tends to the normal one as t = z + (z^3 + z) / (4 freedom).
        assert!((student(10_000) - Z - (Z.powi(3) + Z) / 40_000.0).abs() < 1e-7);
    }

    #[test]
    fn a_share_of_none_or_all_has_an_interval_that_ends_there() {
        // Wilson's ends for no hit are 0 and z^2 / (n + z^2).
        let none = Estimate::share(0, 10);
        assert_eq!((none.value, none.low), (0.0, 0.0));
        assert!((none.high - Z * Z / (10.0 + Z * Z)).abs() < 1e-12);
        let all = Estimate::share(10, 10);
        assert_eq!((all.value, all.high), (1.0, 1.0));
        assert!((all.low - 10.0 / (10.0 + Z * Z)).abs() < 1e-12);
    }

    #[test]
    fn the_ends_of_a_shares_interval_are_where_its_score_test_just_rejects() {
        for (hits, n) in [(1, 10), (3, 7), (150, 160)] {
            let estimate = Estimate::share(hits, n);
            for end in [estimate.low, estimate.high] {
                let score = (estimate.value - end) / (end * (1.0 - end) / n as f64).sqrt();
                assert!((score.abs() - Z).abs() < 1e-9, "{hits} of {n}: {score}");
            }
        }
    }

    #[test]
    fn a_mean_has_students_interval_and_a_single_value_none() {
        let estimate = Estimate::mean(&[1.0, 2.0, 3.0]);
        assert_eq!(estimate.value, 2.0);
        assert!((estimate.half_width() - student(2) / 3.0_f64.sqrt()).abs() < 1e-12);
        let single = Estimate::mean(&[0.5]);
        assert!(single.value == 0.5 && single.low.is_nan() && single.high.is_nan());
        assert!(Estimate::mean(&[]).value.is_nan());
    }
}
