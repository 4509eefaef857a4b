//! Whether all logs together hold enough of everything.

use omniwalk_env::robot::Robot;

use super::findings::{At, Findings};
use super::rules::LEAST_RANGE;
use super::text::fixed;
use super::{Fault, JointCheck, LogCheck};

/// Fewest readings of a joint, over all logs: below it no interval of any parameter is worth its name.
const FEWEST_READINGS: usize = 100;
/// Least time of motion of all logs together, s: no less than identification needs to fit to, so that one of the two says so.
const LEAST_SECONDS: f64 = 3.0;
/// No bus reads encoders faster, Hz.
const FASTEST_RATE: f64 = 5e4;
/// Motion within this share of the range is little.
const LITTLE: f64 = 0.02;
/// The range of a joint that turns freely, rad or m.
const NEVER_LITTLE: f64 = 3.0;

impl Findings {
    /// Whether there is enough of everything, over all logs.
    pub(super) fn amounts(&mut self, logs: &[LogCheck], robot: &Robot) {
        let mut moved = 0;
        let mut seen = 0;
        for d in 0..robot.dofs.len() {
            let name = robot.dof(d).name.as_str();
            let checks: Vec<&JointCheck> = logs
                .iter()
                .flat_map(|log| &log.joints)
                .filter(|check| check.name == name)
                .collect();
            let readings: usize = checks.iter().map(|check| check.position.samples).sum();
            if readings == 0 {
                continue;
            }
            seen += 1;
            let at = At {
                log: None,
                joint: Some(name),
            };
            if readings < FEWEST_READINGS {
                let message =
                    format!("{readings} readings in all logs together; at least {FEWEST_READINGS} are needed");
                self.refuse(Fault::TooShort, at, message);
            }
            self.rate(&checks, at);
            let moves = |check: &&&JointCheck| check.excitation.range_over_noise > LEAST_RANGE;
            let [forward, backward] = [0, 1].map(|way| {
                checks
                    .iter()
                    .any(|check| check.excitation.forward_backward_rest[way] > 0.05)
            });
            if checks.iter().find(moves).is_none() {
                self.remark(
                    Fault::LittleMotion,
                    at,
                    "does not move by more than noise and resolution: nothing can be said of it",
                );
                continue;
            }
            moved += 1;
            let width = |check: &&JointCheck| check.position.width();
            let widest = checks.iter().map(width).fold(0.0, f64::max);
            let (lower, upper) = robot.dof(d).limits;
            if widest < LITTLE * (upper - lower).min(NEVER_LITTLE) {
                let message = format!(
                    "moves within {} only: what shows farther off, or at higher speed, cannot be known",
                    fixed(widest, 4)
                );
                self.remark(Fault::LittleMotion, at, message);
            }
            if !(forward && backward) {
                self.remark(
                    Fault::LittleMotion,
                    at,
                    "moves one way only: friction cannot be told from a constant torque",
                );
            }
        }
        let seconds: f64 = logs.iter().map(|log| log.seconds).sum();
        if seconds < LEAST_SECONDS {
            let fastest = logs
                .iter()
                .flat_map(|log| &log.joints)
                .map(|check| check.position.rate)
                .fold(0.0, f64::max);
            let unit = match fastest > FASTEST_RATE {
                true => format!(" (readings at {} Hz: the time's unit is another)", fixed(fastest, 0)),
                false => String::new(),
            };
            let seconds = fixed(seconds, 2);
            let message = format!(
                "{seconds} s in all logs together; at least {LEAST_SECONDS} s are needed, and 20 s are good{unit}"
            );
            self.refuse(Fault::TooShort, At::default(), message);
        }
        if moved == 0 && seen > 0 {
            self.refuse(
                Fault::NoExcitation,
                At::default(),
                "no joint moves by more than noise and resolution: record motions, such as those of `omniwalk excite`",
            );
        }
    }
}
