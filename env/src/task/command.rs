//! Desired velocities: where they are drawn from, and when.

use serde::{Deserialize, Serialize};

use crate::random::Stream;

/// The region desired velocities are drawn from; the curriculum widens it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CommandRange {
    /// Lower bounds (m/s, m/s, rad/s).
    pub lower: [f64; 3],
    /// Upper bounds (m/s, m/s, rad/s).
    pub upper: [f64; 3],
    /// Share of the draws that are exactly zero.
    pub zero_share: f64,
    /// Share of the draws that keep one axis only.
    pub axis_share: f64,
}

impl CommandRange {
    /// Always `velocity`.
    pub fn fixed(velocity: [f64; 3]) -> Self {
        Self {
            lower: velocity,
            upper: velocity,
            zero_share: 0.0,
            axis_share: 0.0,
        }
    }

    /// One draw. The number of random numbers it takes does not depend on their values.
    pub fn draw(&self, stream: &mut Stream) -> [f64; 3] {
        let kind = stream.unit();
        let axis = (3.0 * stream.unit()) as usize;
        let velocity = [0, 1, 2].map(|k| stream.uniform(self.lower[k], self.upper[k]));
        if kind < self.zero_share {
            [0.0; 3]
        } else if kind < self.zero_share + self.axis_share {
            [0, 1, 2].map(|k| if k == axis { velocity[k] } else { 0.0 })
        } else {
            velocity
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_stay_in_the_region_and_keep_their_shares() {
        let range = CommandRange {
            lower: [-0.6; 3],
            upper: [0.6; 3],
            zero_share: 0.2,
            axis_share: 0.3,
        };
        let mut stream = Stream::new(1, 0, 0);
        let draws: Vec<_> = (0..20_000).map(|_| range.draw(&mut stream)).collect();
        assert!(draws.iter().flatten().all(|x| x.abs() <= 0.6));
        let share = |n: usize| {
            draws
                .iter()
                .filter(|v| v.iter().filter(|&&x| x == 0.0).count() == n)
                .count() as f64
                / 2e4
        };
        assert!((share(3) - 0.2).abs() < 0.02);
        assert!((share(2) - 0.3).abs() < 0.02);
    }
}
