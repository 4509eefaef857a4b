//! What a step of the controller says beside its targets.

use omniwalk_controller as rust;
use pyo3::prelude::*;

/// An entry of the observation beyond what training saw; it was clipped.
#[pyclass(module = "omniwalk", frozen, get_all)]
#[derive(Clone)]
pub struct OutOfRange {
    /// Index into the observation; of several, the one farthest out by its range.
    entry: usize,
    /// Its name.
    name: String,
    /// The value before it was clipped.
    value: f32,
    /// By how much it was beyond the nearer bound, positive.
    excess: f32,
    /// How many entries were out of range.
    entries: usize,
}

#[pymethods]
impl OutOfRange {
    fn __repr__(&self) -> String {
        format!(
            "OutOfRange({} = {}, beyond training by {}, {} entries)",
            self.name, self.value, self.excess, self.entries
        )
    }
}

/// What a step says beside its targets.
#[pyclass(module = "omniwalk", frozen, get_all)]
pub struct Status {
    /// What the targets are: `walking`, `holding`, `ramping` or `resting`.
    mode: &'static str,
    /// What kept the policy from this step: `stale`, `not_finite`, `absurd`, `fallen`, `over_rate` or None.
    fault: Option<&'static str>,
    /// What is not as it should be, in words; empty if all is.
    message: String,
    /// An observation that training did not see.
    out_of_range: Option<OutOfRange>,
    /// What became of the desired velocity: `taken`, `clipped` or `not_finite`.
    command: &'static str,
    /// How much later the step came than its period after the one before, s; 0 if within half a period.
    late: f32,
    /// True if the policy walks on readings and a command like those of training, in time.
    ok: bool,
}

#[pymethods]
impl Status {
    fn __repr__(&self) -> String {
        let message = if self.message.is_empty() { "ok" } else { &self.message };
        format!("Status({}, {message})", self.mode)
    }
}

impl Status {
    /// The status in Python's words.
    pub fn new(status: &rust::Status, spec: &rust::Spec) -> Self {
        Self {
            mode: match status.mode {
                rust::Mode::Walking => "walking",
                rust::Mode::Holding => "holding",
                rust::Mode::Ramping => "ramping",
                rust::Mode::Resting => "resting",
            },
            fault: status.fault.map(name),
            message: status.sentence(spec).to_string(),
            out_of_range: status.out_of_range.map(|it| OutOfRange {
                entry: it.entry,
                name: spec.entry_name(it.entry).unwrap_or_default(),
                value: it.value,
                excess: it.excess,
                entries: it.entries,
            }),
            command: match status.command {
                rust::Command::Taken => "taken",
                rust::Command::Clipped => "clipped",
                rust::Command::NotFinite => "not_finite",
            },
            late: status.late,
            ok: status.is_ok(),
        }
    }
}

fn name(fault: rust::Fault) -> &'static str {
    match fault {
        rust::Fault::Stale { .. } => "stale",
        rust::Fault::NotFinite { .. } => "not_finite",
        rust::Fault::Absurd { .. } => "absurd",
        rust::Fault::Fallen => "fallen",
        rust::Fault::OverRate => "over_rate",
    }
}
