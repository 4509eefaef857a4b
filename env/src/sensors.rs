//! What the robot measures: encoders, gyroscope and attitude with noise, and a latency by a history of
//! readings (thesis 7.4, after Tan et al. 2018).

use omniwalk_controller::attitude::fused_from_up;
use serde::{Deserialize, Serialize};

use crate::config::NoiseConfig;
use crate::engine::GRAVITY;
use crate::random::Stream;
use crate::truth::Truth;

/// One reading of all sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Joint positions in the policy's order, rad or m.
    pub position: Vec<f32>,
    /// Joint velocities in the policy's order, rad/s or m/s.
    pub velocity: Vec<f32>,
    /// Fused roll and pitch, rad.
    pub attitude: [f32; 2],
    /// Angular velocity in the base frame, rad/s.
    pub gyro: [f32; 3],
}

impl Reading {
    /// All zero, for `joints` joints.
    pub fn zero(joints: usize) -> Self {
        Self {
            position: vec![0.0; joints],
            velocity: vec![0.0; joints],
            attitude: [0.0; 2],
            gyro: [0.0; 3],
        }
    }

    /// Measures the true state, with noise where it is enabled. `joints` are position and velocity of the policy's joints.
    pub fn measure(
        &mut self,
        truth: &Truth,
        joints: impl Iterator<Item = (f64, f64)>,
        noise: &NoiseConfig,
        stream: &mut Stream,
    ) {
        let mut add = |deviation: f64| if noise.enabled { stream.normal(deviation) } else { 0.0 };
        let readings = self.position.iter_mut().zip(&mut self.velocity);
        for ((position, velocity), (true_position, true_velocity)) in readings.zip(joints) {
            *position = (true_position + add(noise.position)) as f32;
            *velocity = (true_velocity + add(noise.velocity)) as f32;
        }
        let [roll, pitch] = fused_from_up([truth.up.x, truth.up.y, truth.up.z].map(|x| x as f32));
        let tilt = noise.accelerometer / GRAVITY;
        self.attitude = [roll + add(tilt) as f32, pitch + add(tilt) as f32];
        self.gyro = [truth.turn.x, truth.turn.y, truth.turn.z].map(|x| (x + add(noise.gyro)) as f32);
    }

    /// Becomes `other`, without the allocations of a clone.
    fn copy_from(&mut self, other: &Self) {
        self.position.copy_from_slice(&other.position);
        self.velocity.copy_from_slice(&other.velocity);
        (self.attitude, self.gyro) = (other.attitude, other.gyro);
    }

    /// `(1 - share) a + share b`.
    fn blend(&mut self, a: &Self, b: &Self, share: f32) {
        let mix = |out: &mut [f32], a: &[f32], b: &[f32]| {
            for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
                *out = a + share * (b - a);
            }
        };
        mix(&mut self.position, &a.position, &b.position);
        mix(&mut self.velocity, &a.velocity, &b.velocity);
        mix(&mut self.attitude, &a.attitude, &b.attitude);
        mix(&mut self.gyro, &a.gyro, &b.gyro);
    }
}

/// The last readings at the control rate, newest first in time behind `newest`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct History {
    readings: Vec<Reading>,
    newest: usize,
    /// Latency in control steps.
    delay: f64,
    /// How old the reading was that reached the policy last, control steps.
    age: f64,
    delayed: Reading,
}

impl History {
    /// A history for latencies up to `longest` control steps.
    pub fn new(joints: usize, longest: f64) -> Self {
        Self {
            readings: vec![Reading::zero(joints); longest.ceil() as usize + 2],
            newest: 0,
            delay: 0.0,
            age: 0.0,
            delayed: Reading::zero(joints),
        }
    }

    /// Whether there are as many readings of as many joints as in `own`, and the newest is one of them.
    pub(crate) fn has_shape_of(&self, own: &Self) -> bool {
        let joints = own.delayed.position.len();
        let fits = |reading: &Reading| reading.position.len() == joints && reading.velocity.len() == joints;
        let count = self.readings.len();
        count == own.readings.len() && self.newest < count && self.readings.iter().all(fits) && fits(&self.delayed)
    }

    /// Starts an episode: every reading is `first`, the latency `delay` control steps.
    pub fn reset(&mut self, delay: f64, fill: impl FnOnce(&mut Reading)) {
        self.newest = 0;
        self.set_delay(delay);
        self.age = self.delay;
        let (first, rest) = self
            .readings
            .split_first_mut()
            .expect("a history holds at least two readings");
        fill(first);
        rest.iter_mut().for_each(|reading| reading.copy_from(first));
    }

    /// Sets the latency, control steps, as far as the history reaches.
    pub fn set_delay(&mut self, delay: f64) {
        self.delay = delay.min((self.readings.len() - 2) as f64);
    }

    /// Records a reading.
    pub fn record(&mut self, fill: impl FnOnce(&mut Reading)) {
        let n = self.readings.len();
        self.newest = (self.newest + 1) % n;
        fill(&mut self.readings[self.newest]);
    }

    /// The reading that reaches the policy now: the one that is as old as the latency and `jitter` more, control steps, by linear
    /// interpolation. Readings arrive in the order in which they were made: none is older than the one before it.
    pub fn delayed(&mut self, jitter: f64) -> &Reading {
        let n = self.readings.len();
        self.age = (self.delay + jitter).min(self.age + 1.0).min((n - 2) as f64);
        let whole = self.age.floor() as usize;
        let younger = &self.readings[(self.newest + n - whole) % n];
        let older = &self.readings[(self.newest + n - whole - 1) % n];
        self.delayed.blend(younger, older, (self.age - whole as f64) as f32);
        &self.delayed
    }

    /// The newest reading, without latency.
    pub fn newest(&self) -> &Reading {
        &self.readings[self.newest]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latency_interpolates_between_adjacent_readings() {
        let mut history = History::new(1, 2.0);
        history.reset(1.25, |reading| reading.position[0] = 0.0);
        for k in 1..=10 {
            history.record(|reading| reading.position[0] = k as f32);
            assert_eq!(history.delayed(0.0).position[0], (k as f32 - 1.25).max(0.0), "step {k}");
        }
    }

    #[test]
    fn readings_that_come_later_still_stay_in_order() {
        let mut history = History::new(1, 3.0);
        history.reset(0.5, |reading| reading.position[0] = 0.0);
        let mut last = 0.0;
        for k in 1..=200 {
            history.record(|reading| reading.position[0] = k as f32);
            let jitter = 2.5 * f64::from(k * 7 % 10) / 10.0;
            let age = k as f32 - history.delayed(jitter).position[0];
            assert!(
                k as f32 - age >= last,
                "step {k}: an older reading came after a younger one"
            );
            assert!(
                k < 4 || (0.5..=0.5 + jitter as f32).contains(&age),
                "step {k}: {age} old"
            );
            last = k as f32 - age;
        }
    }

    #[test]
    fn no_latency_gives_the_newest_reading() {
        let mut history = History::new(1, 0.0);
        history.reset(0.0, |reading| reading.position[0] = 5.0);
        history.record(|reading| reading.position[0] = 7.0);
        assert_eq!(history.delayed(0.0).position[0], 7.0);
    }
}
