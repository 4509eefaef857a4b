//! What two series of a joint say of each other.

use std::ops::RangeInclusive;

use serde::Serialize;

use crate::recording::{CommandKind, JointRecord, Series};

/// Time over which slopes are taken, s: long against quantisation and noise, short against motion.
const SLOPE_TIME: f64 = 0.05;
/// Lags that are tried, in [`LAG_STEP`]s: clocks may be off both ways, a servo follows within some hundred milliseconds.
const LAGS: RangeInclusive<i32> = -10..=30;
/// Lags that are tried where the best of those is the last.
const FAR_LAGS: RangeInclusive<i32> = -100..=100;
/// Step between lags, s.
const LAG_STEP: f64 = 0.01;
/// Samples that are compared at most; more say nothing new about sign and unit.
const MAX_SAMPLES: usize = 4000;

/// How one series goes with another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Relation {
    /// Correlation as they are.
    pub correlation: f64,
    /// Correlation at the lag where it is largest.
    pub best_correlation: f64,
    /// That lag, s: how much later the second series does what the first did.
    pub lag: f64,
    /// Standard deviation of the second over that of the first.
    pub ratio: f64,
}

impl Relation {
    /// Whether the lag is the first or last of `lags`: the true one may be longer.
    fn ends(&self, lags: &RangeInclusive<i32>) -> bool {
        let ends = [*lags.start(), *lags.end()];
        let is_lag = |end: &i32| (self.lag - f64::from(*end) * LAG_STEP).abs() < 0.5 * LAG_STEP;
        ends.iter().any(is_lag)
    }

    /// Whether the lag is as long as any that is tried.
    pub(super) fn is_longest(&self) -> bool {
        self.ends(&FAR_LAGS)
    }

    /// What the lag leaves of what does not go with the other series without it, as a share: slow motion goes as well with a command of any
    /// time.
    pub(super) fn lag_leaves(&self) -> f64 {
        (1.0 - self.best_correlation.powi(2)) / (1.0 - self.correlation.powi(2)).max(1e-12)
    }
}

/// Position and mean speed over a short time.
pub(super) struct Slope {
    pub time: f64,
    pub position: f64,
    pub speed: f64,
}

/// Slopes of a series of positions.
pub(super) fn slopes(series: &Series) -> Vec<Slope> {
    let interval = series.pace().usual;
    let apart = if interval > 0.0 {
        (SLOPE_TIME / interval).round().max(1.0) as usize
    } else {
        1
    };
    let slope = |start: usize| {
        let end = start + apart;
        let seconds = series.time[end] - series.time[start];
        // Across a gap it would be no slope.
        (seconds < 3.0 * apart as f64 * interval).then(|| Slope {
            time: 0.5 * (series.time[start] + series.time[end]),
            position: 0.5 * (series.value[start] + series.value[end]),
            speed: (series.value[end] - series.value[start]) / seconds,
        })
    };
    (0..series.len().saturating_sub(apart)).filter_map(slope).collect()
}

/// Position against position commands, while the motor is on; `None` where there are none or nothing varies.
pub(super) fn following(joint: &JointRecord) -> Option<Relation> {
    if joint.command_kind != CommandKind::Position {
        return None;
    }
    against_command(joint, &joint.command)
}

/// The same as `following`, at a longer lag where that may be the better one: no servo's, but a clock's.
pub(super) fn followed_far(joint: &JointRecord, following: Relation) -> Relation {
    if !following.ends(&LAGS) {
        return following;
    }
    best_over_lags(&while_switched(joint, true), &joint.command, FAR_LAGS).unwrap_or(following)
}

/// The joint's position against `command`, which may be another joint's.
pub(super) fn against_command(joint: &JointRecord, command: &Series) -> Option<Relation> {
    best_over_lags(&while_switched(joint, true), command, LAGS)
}

/// Position against position commands, while the motor is off; `None` where it never is.
pub(super) fn following_while_off(joint: &JointRecord) -> Option<Relation> {
    if joint.command_kind != CommandKind::Position {
        return None;
    }
    best_over_lags(&while_switched(joint, false), &joint.command, LAGS)
}

/// Times and positions while the motor is on, or off.
fn while_switched(joint: &JointRecord, is_on: bool) -> Vec<(f64, f64)> {
    let stride = joint.position.len().div_ceil(MAX_SAMPLES).max(1);
    let samples = joint.position.time.iter().zip(&joint.position.value).step_by(stride);
    samples
        .filter(|(time, _)| joint.is_on(**time) == is_on)
        .map(|(t, p)| (*t, *p))
        .collect()
}

/// The measured velocity against the slope of the position; `None` where one is missing or nothing varies.
pub(super) fn velocity_to_slope(joint: &JointRecord) -> Option<Relation> {
    let slopes = slopes(&joint.position);
    let first = *joint.velocity.time.first()?;
    let stride = slopes.len().div_ceil(MAX_SAMPLES).max(1);
    let samples: Vec<(f64, f64)> = slopes
        .iter()
        .step_by(stride)
        .map(|slope| (slope.time, slope.speed))
        .collect();
    let known: Vec<(f64, f64)> = samples.into_iter().filter(|(time, _)| *time >= first).collect();
    // The measured velocity is the second of the two.
    let relation = best_over_lags(&known, &joint.velocity, LAGS)?;
    Some(Relation {
        ratio: 1.0 / relation.ratio,
        lag: -relation.lag,
        ..relation
    })
}

/// `samples` (time, value) against what `first` held some of `lags` before.
fn best_over_lags(samples: &[(f64, f64)], first: &Series, lags: RangeInclusive<i32>) -> Option<Relation> {
    let at = |lag: f64| correlate(samples, first, lag);
    let (correlation, ratio) = at(0.0)?;
    let lags = lags.map(|step| f64::from(step) * LAG_STEP);
    let tried = lags.filter_map(|lag| Some((lag, at(lag)?.0)));
    let (lag, best_correlation) = tried.fold(
        (0.0, correlation),
        |best, tried| if tried.1 > best.1 { tried } else { best },
    );
    Some(Relation {
        correlation,
        best_correlation,
        lag,
        ratio,
    })
}

/// Correlation, and ratio of standard deviations; `None` with too few samples or without variation.
fn correlate(samples: &[(f64, f64)], first: &Series, lag: f64) -> Option<(f64, f64)> {
    let pairs = samples
        .iter()
        .filter_map(|(time, value)| Some((*first.held_at(time - lag)?, *value)));
    let mut sums = [0.0; 6];
    for (a, b) in pairs {
        for (sum, term) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
            *sum += term;
        }
    }
    let [count, a, b, aa, bb, ab] = sums;
    let variance = |square: f64, sum: f64| (square - sum * sum / count) / count;
    let (of_first, of_second) = (variance(aa, a), variance(bb, b));
    // Below this share of the squares, what is left is rounding.
    let varies = |variance: f64, square: f64| variance > 1e-12 * square / count;
    if count < 10.0 || !varies(of_first, aa) || !varies(of_second, bb) {
        return None;
    }
    let covariance = (ab - a * b / count) / count;
    Some((
        covariance / (of_first * of_second).sqrt(),
        (of_second / of_first).sqrt(),
    ))
}
