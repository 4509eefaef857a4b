//! What a rehearsal measured.

use serde_json::{Value, json};

/// Names of [`omniwalk_controller::Mode`] by number.
const MODES: [&str; 4] = ["walking", "holding", "ramping", "resting"];
/// Names of faults by number; 0 is none.
const FAULTS: [&str; 5] = ["stale", "not_finite", "fallen", "over_rate", "absurd"];

/// Figures of a rehearsal, taken on the robot's side.
#[derive(Debug, Default)]
pub struct Report {
    /// Length of the rehearsal, s.
    pub seconds: f64,
    /// The latency that was drawn, s.
    pub latency: f64,
    /// By how much single readings came later at most, as configured, s.
    pub jitter: f64,
    /// Readings that were sent, one each physics step.
    pub readings: u64,
    /// Control steps of the simulation.
    pub control_steps: u64,
    /// Commands that came.
    pub commands: u64,
    /// Steps of the controller that came more than half a period late.
    pub deadline_misses: u64,
    /// Physics steps that were left out because the simulation was late.
    pub physics_skipped: u64,
    /// From a measurement to the targets that follow from it, s.
    pub latencies: Vec<f64>,
    /// Time of the controller's steps, s.
    pub steps: Vec<f64>,
    /// Longest time without a command, s.
    pub silence: f64,
    /// Controllers that were started in place of one that died.
    pub restarts: u32,
    /// Number of commands with each mode.
    pub modes: [u64; 4],
    /// Changes of the mode: when, s, and the new one.
    pub changes: Vec<(f64, u32)>,
    /// Number of commands with each fault.
    pub faults: [u64; 5],
    /// Commands whose observation was out of the range of training.
    pub out_of_range: u64,
    /// When the robot fell, s.
    pub fell: Option<f64>,
    /// Sums over the control steps in which the robot walked.
    pub walk: Walk,
}

/// How it walked.
#[derive(Debug, Default)]
pub struct Walk {
    /// Control steps.
    pub steps: u64,
    /// Sum of the velocity along and left of the heading and the turn rate, m/s, m/s, rad/s.
    pub velocity: [f64; 3],
    /// Sum of the squared error of the estimated velocity, (m/s)^2, and how many there were.
    pub estimator: (f64, u64),
}

impl Report {
    /// Notes a mode and a fault of a command that came at `time`, s.
    pub fn note(&mut self, time: f64, mode: u32, fault: u32) {
        let last = self.changes.last().map(|(_, mode)| *mode);
        if last != Some(mode) {
            self.changes.push((time, mode));
        }
        if let Some(count) = self.modes.get_mut(mode as usize) {
            *count += 1;
        }
        let fault = (fault as usize).checked_sub(1);
        if let Some(count) = fault.and_then(|fault| self.faults.get_mut(fault)) {
            *count += 1;
        }
    }

    /// Mean velocity while walking, m/s, m/s, rad/s.
    fn velocity(&self) -> [f64; 3] {
        self.walk.velocity.map(|sum| sum / self.walk.steps as f64)
    }

    fn estimator_error(&self) -> f64 {
        let (sum, count) = self.walk.estimator;
        (sum / count as f64).sqrt()
    }

    /// For programs.
    pub fn json(&mut self) -> Value {
        let named = |names: &[&str], counts: &[u64]| -> Value {
            let pairs = names.iter().zip(counts);
            pairs.map(|(name, count)| ((*name).to_owned(), json!(count))).collect()
        };
        let changes = self.changes.iter();
        let changes: Vec<_> = changes.map(|(time, mode)| json!([time, name(*mode)])).collect();
        let number = |x: f64| x.is_finite().then_some(x);
        json!({
            "seconds": self.seconds,
            "latency_s": self.latency,
            "jitter_s": self.jitter,
            "readings": self.readings,
            "commands": self.commands,
            "control_periods": self.control_steps,
            "deadline_misses": self.deadline_misses,
            "physics_skipped": self.physics_skipped,
            "latency_ms": percentiles(&mut self.latencies, 1e3),
            "step_us": percentiles(&mut self.steps, 1e6),
            "longest_silence_s": self.silence,
            "restarts": self.restarts,
            "modes": named(&MODES, &self.modes),
            "changes": changes,
            "faults": named(&FAULTS, &self.faults),
            "out_of_range": self.out_of_range,
            "fell_after_s": self.fell,
            "walked_s": self.walk.steps as f64 * self.seconds / self.control_steps.max(1) as f64,
            "velocity": self.velocity().map(number),
            "estimator_rms_mps": number(self.estimator_error()),
        })
    }

    /// For people.
    pub fn text(&mut self) -> String {
        let json = self.json();
        let figures = |key: &str| {
            let of = |name: &str| json[key][name].as_f64().unwrap_or(f64::NAN);
            let [p50, p90, p99, max] = ["p50", "p90", "p99", "max"].map(of);
            format!("p50 {p50:.2}, p90 {p90:.2}, p99 {p99:.2}, largest {max:.2}")
        };
        let [x, y, turn] = self.velocity();
        let walk = if self.walk.estimator.1 > 0 {
            format!(
                "walking, on average {x:.3} m/s forward, {y:.3} m/s left, {turn:.3} rad/s\n\
                 estimated velocity of the base: {:.3} m/s root mean square error",
                self.estimator_error()
            )
        } else {
            "it never walked; the faults say why".to_owned()
        };
        let outcome = match self.fell {
            Some(time) => format!("the robot fell after {time:.1} s"),
            None => "the robot did not fall".to_owned(),
        };
        let modes: Vec<_> = MODES
            .iter()
            .zip(self.modes)
            .map(|(name, n)| format!("{name} {n}"))
            .collect();
        let faults: Vec<_> = FAULTS
            .iter()
            .zip(self.faults)
            .map(|(name, n)| format!("{name} {n}"))
            .collect();
        format!(
            "{:.1} s, {} readings, {} commands in {} control periods, {} late, {} physics steps left out, controller restarted {} times\n\
             latency {:.1} ms, jitter up to {:.1} ms; from measurement to targets, ms: {}\n\
             step of the controller, us: {}\n\
             longest silence of the controller: {:.3} s\n\
             modes: {}; faults: {}; out of range {}\n\
             {outcome}; {walk}\n",
            self.seconds,
            self.readings,
            self.commands,
            self.control_steps,
            self.deadline_misses,
            self.physics_skipped,
            self.restarts,
            self.latency * 1e3,
            self.jitter * 1e3,
            figures("latency_ms"),
            figures("step_us"),
            self.silence,
            modes.join(", "),
            faults.join(", "),
            self.out_of_range,
        )
    }
}

fn name(mode: u32) -> &'static str {
    MODES.get(mode as usize).copied().unwrap_or("unknown")
}

/// Percentiles of `values`, which are sorted, times `factor`; null without values.
fn percentiles(values: &mut [f64], factor: f64) -> Value {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * values.len().saturating_sub(1) as f64).round() as usize;
        values.get(index).map(|x| x * factor)
    };
    json!({ "p50": at(0.5), "p90": at(0.9), "p99": at(0.99), "p999": at(0.999), "max": at(1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_a_sorted_list() {
        let mut values: Vec<f64> = (0..=1000).rev().map(|i| f64::from(i) * 1e-6).collect();
        let found = percentiles(&mut values, 1e6);
        for (key, expected) in [("p50", 500.0), ("p90", 900.0), ("p99", 990.0), ("max", 1000.0)] {
            assert!((found[key].as_f64().unwrap() - expected).abs() < 1e-6, "{key}");
        }
        assert!(percentiles(&mut [], 1.0)["p50"].is_null());
    }
}
