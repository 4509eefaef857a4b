//! How well a commanded velocity is held: the norm of command minus velocity averaged over a second, mean over the
//! time after the command's ramp plus a second (thesis 7.5).

use serde::{Deserialize, Serialize};

/// Running error of one environment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrackingMeter {
    window: Vec<[f64; 3]>,
    next: usize,
    sum: [f64; 3],
    /// Steps since the commanded velocity last changed.
    steady: usize,
    commanded: [f64; 3],
    samples: u32,
    error_xy: f64,
    error_turn: f64,
    mean: [f64; 3],
}

/// Tracking of an episode; `None` where the command was never held for a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Mean norm of the horizontal error, m/s.
    pub error_xy_mps: f64,
    /// Mean absolute error of the turn rate, rad/s.
    pub error_yaw_radps: f64,
    /// Mean velocity, (m/s, m/s, rad/s).
    pub velocity: [f64; 3],
}

impl TrackingMeter {
    /// A meter with a window of `steps` control steps (one second).
    pub fn new(steps: usize) -> Self {
        Self {
            window: vec![[0.0; 3]; steps.max(1)],
            next: 0,
            sum: [0.0; 3],
            steady: 0,
            commanded: [0.0; 3],
            samples: 0,
            error_xy: 0.0,
            error_turn: 0.0,
            mean: [0.0; 3],
        }
    }

    /// Whether the window is as long as that of `own`, and the next place is in it.
    pub(super) fn has_shape_of(&self, own: &Self) -> bool {
        self.window.len() == own.window.len() && self.next < self.window.len()
    }

    /// Starts an episode.
    pub fn reset(&mut self) {
        self.window.fill([0.0; 3]);
        (self.next, self.steady, self.samples) = (0, 0, 0);
        (self.error_xy, self.error_turn) = (0.0, 0.0);
        (self.sum, self.commanded, self.mean) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    }

    /// Takes in a step: velocity in the heading frame (m/s, m/s, rad/s), commanded velocity, and whether that
    /// has reached the desired one.
    pub fn step(&mut self, velocity: [f64; 3], commanded: [f64; 3], reached: bool) {
        let n = self.window.len();
        let oldest = std::mem::replace(&mut self.window[self.next], velocity);
        self.next = (self.next + 1) % n;
        for k in 0..3 {
            self.sum[k] += velocity[k] - oldest[k];
        }
        self.steady = if reached && commanded == self.commanded {
            self.steady + 1
        } else {
            0
        };
        self.commanded = commanded;
        if self.steady < n {
            return;
        }
        let average = self.sum.map(|sum| sum / n as f64);
        self.samples += 1;
        self.error_xy += (commanded[0] - average[0]).hypot(commanded[1] - average[1]);
        self.error_turn += (commanded[2] - average[2]).abs();
        for (mean, average) in self.mean.iter_mut().zip(average) {
            *mean += average;
        }
    }

    /// The episode so far.
    pub fn tracking(&self) -> Option<Tracking> {
        let n = f64::from(self.samples);
        (self.samples > 0).then(|| Tracking {
            error_xy_mps: self.error_xy / n,
            error_yaw_radps: self.error_turn / n,
            velocity: self.mean.map(|sum| sum / n),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_oscillation_of_the_step_frequency_is_no_error_but_an_offset_is() {
        let mut meter = TrackingMeter::new(40);
        for step in 0..400 {
            let sway = (std::f64::consts::TAU * f64::from(step) / 20.0).sin();
            meter.step([0.35, 0.2 * sway, 0.1], [0.4, 0.0, 0.0], true);
        }
        let tracking = meter.tracking().unwrap();
        assert!((tracking.error_xy_mps - 0.05).abs() < 1e-9);
        assert!((tracking.error_yaw_radps - 0.1).abs() < 1e-9);
    }

    #[test]
    fn nothing_is_counted_while_the_command_ramps() {
        let mut meter = TrackingMeter::new(40);
        for step in 0..200 {
            meter.step([0.0; 3], [f64::from(step) * 0.01, 0.0, 0.0], false);
        }
        assert_eq!(meter.tracking(), None);
    }
}
