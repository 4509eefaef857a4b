//! Position and velocity of a joint at an instant, by the readings about it.

use nalgebra::{DMatrix, DVector};

use super::trial::DT;
use crate::recording::Series;

/// Readings this far on either side tell the state at an instant, s.
const ABOUT: f64 = 0.03;

/// Readings about an instant, and the powers of their times of which a polynomial is made.
pub struct Near<'a> {
    position: &'a [f64],
    powers: DMatrix<f64>,
    /// Unit of time of the powers, s.
    span: f64,
}

impl<'a> Near<'a> {
    /// About `time` of `series`.
    pub fn new(series: &'a Series, time: f64) -> Self {
        let near = |about: f64| {
            let from = series.time.partition_point(|&t| t < time - about);
            (from, series.time.partition_point(|&t| t <= time + about))
        };
        let (mut from, mut to) = near(ABOUT);
        if to - from < 5 {
            let middle = series.time.partition_point(|&t| t < time);
            from = middle.saturating_sub(3).min(series.len().saturating_sub(5));
            to = (from + 5).min(series.len());
        }
        let t = &series.time[from..to];
        let span = t.iter().map(|t| (t - time).abs()).fold(0.0, f64::max).max(DT);
        let order = 3.min(t.len().saturating_sub(2));
        Self {
            position: &series.value[from..to],
            powers: DMatrix::from_fn(t.len(), order + 1, |i, j| ((t[i] - time) / span).powi(j as i32)),
            span,
        }
    }

    /// What noise of the readings makes of position (in units of it) and velocity (a second).
    pub fn spread(&self) -> (f64, f64) {
        let inverse = (self.powers.transpose() * &self.powers)
            .cholesky()
            .map(|factor| factor.inverse());
        let root = |i: usize| {
            inverse
                .as_ref()
                .filter(|own| i < own.nrows())
                .map(|own| own[(i, i)].sqrt())
        };
        (root(0).unwrap_or(1.0), root(1).unwrap_or(1.0) / self.span)
    }
}

/// Position and velocity at `time` by a polynomial through the readings about it (Savitzky and Golay 1964): a cubic where
/// there are readings enough, less where there are few.
pub fn state(series: &Series, time: f64) -> (f64, f64) {
    let Near { position, powers, span } = Near::new(series, time);
    let normal = powers.transpose() * &powers;
    let right = powers.transpose() * DVector::from_column_slice(position);
    match normal.cholesky().map(|factor| factor.solve(&right)) {
        // Two readings give no line worth following.
        Some(fit) => (fit[0], if powers.ncols() > 1 { fit[1] / span } else { 0.0 }),
        None => (position[0], 0.0),
    }
}
