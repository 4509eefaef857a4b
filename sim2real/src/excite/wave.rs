//! The shapes of motion of one joint about its middle; all start and end there.

use std::f64::consts::TAU;

/// What a joint can do: largest deviation (rad or m), speed (rad/s or m/s), acceleration (rad/s^2 or m/s^2), and
/// jump of the target (rad or m).
pub(super) struct Room {
    pub amplitude: f64,
    pub speed: f64,
    pub acceleration: f64,
    pub jump: f64,
}

/// Kinds of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    Staircase,
    Triangle,
    Steps,
    Chirp,
    Multisine,
}

/// One joint's motion.
pub(super) struct Wave {
    shape: Shape,
    amplitude: f64,
    speed: f64,
    acceleration: f64,
    /// Amplitude, frequency (Hz) and phase of each sine.
    sines: Vec<[f64; 3]>,
    /// Levels that are held.
    levels: Vec<f64>,
    /// Triangles per motion: different for joints that move together.
    periods: f64,
}

/// Levels of a staircase, as shares of the amplitude: up and down, so that friction shows from both sides.
const STAIRS: [f64; 9] = [0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0, 0.0];
/// Steps, likewise: small and large, both ways.
const STEPS: [f64; 11] = [0.0, 1.0, -1.0, 0.5, -0.25, 0.75, 0.25, -0.75, -0.5, 0.25, 0.0];
/// Speed of triangles as a share of what the joint may: where friction at low speed shows.
const SLOW: f64 = 0.1;
/// Frequencies that a chirp sweeps, Hz: from quasi-static to beyond what servos of walking robots follow.
const SWEEP: [f64; 2] = [0.1, 4.0];
/// Frequencies of a multisine, Hz, without common harmonics.
const TONES: [f64; 6] = [0.13, 0.31, 0.53, 0.89, 1.51, 2.33];
/// The golden ratio's fractional part spreads phases evenly for any number of joints.
const SPREAD: f64 = 0.618_033_988_749_894_8;

impl Shape {
    pub const ALL: [Self; 5] = [
        Self::Staircase,
        Self::Triangle,
        Self::Steps,
        Self::Chirp,
        Self::Multisine,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Staircase => "staircase",
            Self::Triangle => "triangle",
            Self::Steps => "steps",
            Self::Chirp => "chirp",
            Self::Multisine => "multisine",
        }
    }

    /// Length of a motion, s.
    pub fn seconds(self) -> f64 {
        match self {
            Self::Staircase => 13.5,
            Self::Triangle => 16.0,
            Self::Steps => 8.0,
            Self::Chirp | Self::Multisine => 12.0,
        }
    }
}

impl Wave {
    /// The motion in `room` of the joint at `place` among those that move together.
    pub fn new(shape: Shape, room: &Room, place: usize) -> Self {
        let phase = TAU * (SPREAD * place as f64).fract();
        let tones = TONES.iter().enumerate();
        let sines = tones.map(|(i, frequency)| [1.0 / (0.3 + frequency), *frequency, phase + TAU * SPREAD * i as f64]);
        let mut wave = Self {
            shape,
            amplitude: room.amplitude,
            speed: room.speed,
            acceleration: room.acceleration,
            sines: sines.collect(),
            levels: Vec::new(),
            periods: 1.0 + (place % 3) as f64,
        };
        match shape {
            Shape::Staircase => wave.levels = turned(&STAIRS, place, room.amplitude),
            Shape::Steps => wave.levels = turned(&STEPS, place, room.amplitude.min(0.5 * room.jump)),
            Shape::Multisine => wave.fit(room),
            Shape::Triangle => {
                let fastest = 4.0 * wave.periods * room.amplitude / shape.seconds();
                wave.amplitude *= (SLOW * room.speed / fastest).min(1.0);
            }
            Shape::Chirp => {}
        }
        wave
    }

    /// Scales the sines so that the sums of their amplitudes, speeds and accelerations fit.
    fn fit(&mut self, room: &Room) {
        let sum = |power: i32| {
            self.sines
                .iter()
                .map(|[size, f, _]| size * (TAU * f).powi(power))
                .sum::<f64>()
        };
        let fits = [(room.amplitude, 0), (room.speed, 1), (room.acceleration, 2)];
        let scale = fits
            .iter()
            .map(|(most, power)| most / sum(*power))
            .fold(f64::INFINITY, f64::min);
        self.sines.iter_mut().for_each(|[size, ..]| *size *= scale);
    }

    /// Deviation from the middle at `time` (s), 0 at the start and at the end.
    pub fn at(&self, time: f64) -> f64 {
        let seconds = self.shape.seconds();
        // Half a second in and out.
        let fade = super::smooth((time / 0.5).min((seconds - time) / 0.5));
        match self.shape {
            Shape::Triangle => self.amplitude * triangle(self.periods * time / seconds),
            Shape::Steps => self.level(time, seconds),
            Shape::Staircase => self.stair(time, seconds),
            Shape::Chirp => fade * self.chirp(time, seconds),
            Shape::Multisine => {
                let sines = self.sines.iter();
                fade * sines
                    .map(|[size, f, phase]| size * (TAU * f * time + phase).sin())
                    .sum::<f64>()
            }
        }
    }

    fn level(&self, time: f64, seconds: f64) -> f64 {
        let held = seconds / self.levels.len() as f64;
        self.levels[((time / held) as usize).min(self.levels.len() - 1)]
    }

    /// From level to level at a speed and acceleration that fit, then still.
    fn stair(&self, time: f64, seconds: f64) -> f64 {
        let held = seconds / self.levels.len() as f64;
        let index = ((time / held) as usize).min(self.levels.len() - 1);
        let from = if index == 0 { 0.0 } else { self.levels[index - 1] };
        let way = self.levels[index] - from;
        // The smooth step's largest slope is 1.875, its largest curvature 5.78.
        let by_speed = 1.875 * way.abs() / self.speed;
        let moving = by_speed
            .max((5.78 * way.abs() / self.acceleration).sqrt())
            .clamp(0.05, held);
        from + way * super::smooth((time - index as f64 * held) / moving)
    }

    fn chirp(&self, time: f64, seconds: f64) -> f64 {
        let rate = (SWEEP[1] / SWEEP[0]).ln() / seconds;
        let frequency = SWEEP[0] * (rate * time).exp();
        let phase = TAU * (frequency - SWEEP[0]) / rate;
        let omega = TAU * frequency;
        let size = self
            .amplitude
            .min(self.speed / omega)
            .min(self.acceleration / (omega * omega));
        size * phase.sin()
    }
}

/// Shares of an amplitude; every other joint goes the other way.
fn turned(levels: &[f64], place: usize, amplitude: f64) -> Vec<f64> {
    let sign = if place.is_multiple_of(2) { 1.0 } else { -1.0 };
    levels.iter().map(|level| sign * level * amplitude).collect()
}

/// A triangle wave between -1 and 1 that starts upward at 0.
fn triangle(turns: f64) -> f64 {
    let x = turns.fract();
    if x < 0.25 {
        4.0 * x
    } else if x < 0.75 {
        2.0 - 4.0 * x
    } else {
        4.0 * x - 4.0
    }
}
