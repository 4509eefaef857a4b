//! Motions as samples: how far they are apart, and what they are without a step.

/// A motion's samples, rad or m.
pub type Motion = Vec<f64>;

/// Largest distance of two motions.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// `2 fine - coarse`: what the motion is without a step, but for terms of second order.
pub fn extrapolated(coarse: &[f64], fine: &[f64]) -> Motion {
    coarse.iter().zip(fine).map(|(c, f)| 2.0 * f - c).collect()
}
