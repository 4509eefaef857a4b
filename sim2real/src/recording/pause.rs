//! Times that jump: a clock that was set while it was recorded, or logs that were joined.

use std::fmt;

use super::Samples;

/// A longer pause, s, is none of a recording: clocks are set by hours and years, and what comes after is another log.
pub(crate) const LONGEST_PAUSE: f64 = 600.0;
/// What has less than a sample a second, on average over more than this time, s, has no time of its own: following it would cost memory by
/// its clock, not by its size.
const SPARSE: f64 = 60.0;

/// Where times jump.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Time before the longest pause, or before the step back, s.
    pub from: f64,
    /// Its length, s; not positive for a step back.
    pub seconds: f64,
    /// Samples of the series.
    pub samples: usize,
    /// From the first to the last of them, s.
    pub span: f64,
}

impl Jump {
    /// What to do about it.
    pub const HELP: &str = "split the log there, or name a `segment` column in the map; set the clock before recording, not meanwhile; if readings came \
         faster than that throughout, the time's unit is another";
}

impl<T> Samples<T> {
    /// Where the times jump; `None` for those of one log. Without a jump a series lasts at most a minute, or a second for each sample.
    pub fn jump(&self) -> Option<Jump> {
        let pauses = || self.time.windows(2).map(|pair| (pair[0], pair[1] - pair[0]));
        let longer = |a: (f64, f64), b: (f64, f64)| if b.1 > a.1 { b } else { a };
        let back = pauses().find(|(_, seconds)| *seconds <= 0.0);
        let (from, seconds) = back.unwrap_or_else(|| pauses().fold((0.0, 0.0), longer));
        let (samples, span) = (self.len(), self.span());
        let sparse = span > SPARSE && span > samples as f64;
        (sparse || back.is_some() || seconds > LONGEST_PAUSE).then_some(Jump {
            from,
            seconds,
            samples,
            span,
        })
    }
}

impl fmt::Display for Jump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.seconds <= 0.0 {
            return write!(f, "time goes backwards after {}", lasting(self.from));
        }
        let what = if self.seconds > LONGEST_PAUSE {
            "time jumps"
        } else {
            "readings are too far apart"
        };
        let [seconds, from, span] = [self.seconds, self.from, self.span].map(lasting);
        let samples = self.samples;
        write!(
            f,
            "{what}: the longest pause, of {seconds}, is after {from}, with {samples} readings in {span}"
        )
    }
}

/// A time in words: what clocks jump by is more than one wants to read in seconds.
fn lasting(seconds: f64) -> String {
    let days = seconds / 86_400.0;
    if seconds < 1e5 {
        format!("{seconds:.2} s")
    } else if days < 1e6 {
        format!("{days:.1} days")
    } else {
        format!("{seconds:.1e} s")
    }
}

#[cfg(test)]
mod tests {
    use super::super::Series;

    fn at(time: Vec<f64>) -> Series {
        Series {
            value: vec![0.0; time.len()],
            time,
        }
    }

    #[test]
    fn times_of_one_log_do_not_jump_and_those_of_a_clock_that_was_set_do() {
        let steady: Vec<f64> = (0..600).map(|k| f64::from(k) * 0.01).collect();
        let later = |seconds: f64| at(steady.iter().map(|t| if *t < 3.0 { *t } else { t + seconds }).collect());
        assert_eq!(at(vec![]).jump().or(at(vec![0.0, 59.0]).jump()), None);
        assert_eq!(later(0.0).jump().or(later(300.0).jump()), None);
        let month = later(30.0 * 86_400.0).jump().expect("a jump");
        assert_eq!((month.from, month.samples), (2.99, 600));
        assert!(month.to_string().contains("of 30.0 days, is after 2.99 s"), "{month}");
        assert!(later(1e300).jump().expect("a jump").to_string().contains("1.0e300 s"));
        // Many pauses that are short each.
        let sparse = (0..100).map(|k| f64::from(k) * 2.0).collect();
        assert!(at(sparse).jump().is_some());
        let back = later(-1.0).jump().expect("a jump").to_string();
        assert_eq!(back, "time goes backwards after 2.99 s");
    }
}
