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
    /// What kept the policy from this step: `stale`, `not_finite`, `fallen`, `over_rate` or None.
    fault: Option<&'static str>,
    /// The fault in a sentence; empty without one.
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
        let fault = self.fault.map_or(String::new(), |_| format!(", {}", self.message));
        let range = self
            .out_of_range
            .as_ref()
            .map_or(String::new(), |it| format!(", {}", it.__repr__()));
        format!(
            "Status({}{fault}{range}, command {}, late {} s)",
            self.mode, self.command, self.late
        )
    }
}

impl Status {
    /// The status in Python's words.
    pub fn new(status: &rust::Status, spec: &rust::Spec) -> Self {
        let (fault, message) = status.fault.map_or((None, String::new()), |fault| {
            let (name, message) = describe(&fault);
            (Some(name), message)
        });
        Self {
            mode: match status.mode {
                rust::Mode::Walking => "walking",
                rust::Mode::Holding => "holding",
                rust::Mode::Ramping => "ramping",
                rust::Mode::Resting => "resting",
            },
            fault,
            message,
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

fn describe(fault: &rust::Fault) -> (&'static str, String) {
    match fault {
        rust::Fault::Stale { age } => ("stale", format!("the newest reading is {age:.3} s old")),
        rust::Fault::NotFinite { reading, index } => {
            ("not_finite", format!("{reading}[{index}] is not a finite number"))
        }
        rust::Fault::Fallen => ("fallen", "the robot has fallen; reset the controller".to_owned()),
        rust::Fault::OverRate => (
            "over_rate",
            "the step came sooner than the control rate allows".to_owned(),
        ),
    }
}
