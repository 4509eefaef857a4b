//! A clock that splits repeated work into phases; it costs nothing until it is started.

use std::time::Instant;

/// Wall time of each of `N` phases.
pub(crate) struct Clock<const N: usize> {
    running: bool,
    seconds: [f64; N],
    last: Instant,
}

impl<const N: usize> Clock<N> {
    pub fn new() -> Self {
        Self {
            running: false,
            seconds: [0.0; N],
            last: Instant::now(),
        }
    }

    /// Starts to measure, or stops, from zero.
    pub fn run(&mut self, running: bool) {
        *self = Self { running, ..Self::new() };
    }

    /// What is measured next begins now.
    #[inline(always)]
    pub fn begin(&mut self) {
        if self.running {
            self.last = Instant::now();
        }
    }

    /// Books the time since the last call on `phase`.
    #[inline(always)]
    pub fn lap(&mut self, phase: usize) {
        if self.running {
            let now = Instant::now();
            self.seconds[phase] += (now - self.last).as_secs_f64();
            self.last = now;
        }
    }

    /// Time by phase since the clock was started, s.
    pub fn seconds(&self) -> [f64; N] {
        self.seconds
    }
}
