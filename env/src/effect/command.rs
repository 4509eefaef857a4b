//! What a command goes through before the servo: rounding, delay, rate limit, gain, dead band.

use super::catalogue::{Info, Parameter, Place, Scale, Site, positive, signed};

/// Longest delay, s.
pub(super) const LONGEST_DELAY: f64 = 0.5;

pub(super) const DELAY: Info = Info {
    id: "command_delay",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "time",
        scale: Scale::Time,
        neutral: Some(0.0),
        starts: &[0.004, 0.015, 0.04],
        bounds: positive(LONGEST_DELAY),
        default: None,
        what: "time from command to action",
    }],
    what: "a command acts later than it was given",
};

pub(super) const RATE_LIMIT: Info = Info {
    id: "command_rate_limit",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "speed",
        scale: Scale::Speed,
        neutral: None,
        starts: &[0.8, 0.5, 0.25],
        bounds: positive(1e6),
        default: None,
        what: "fastest change of the target",
    }],
    what: "the target the servo follows moves no faster than a speed",
};

pub(super) const DEAD_BAND: Info = Info {
    id: "command_dead_band",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "width",
        scale: Scale::Position,
        neutral: Some(0.0),
        starts: &[0.01, 0.05],
        bounds: positive(1e3),
        default: None,
        what: "position error up to which there is no torque",
    }],
    what: "a position error up to a width makes no torque, a larger one that much less",
};

pub(super) const GAIN: Info = Info {
    id: "command_gain",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "gain",
        scale: Scale::One,
        neutral: Some(1.0),
        starts: &[0.97, 1.03],
        bounds: signed(10.0),
        default: None,
        what: "target followed over target commanded",
    }],
    what: "the target is multiplied by a factor",
};

pub(super) const QUANTISATION: Info = Info {
    id: "command_quantisation",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "step",
        scale: Scale::Position,
        neutral: Some(0.0),
        starts: &[0.01, 0.03, 0.1],
        bounds: positive(1e3),
        default: None,
        what: "distance of the targets that can be commanded",
    }],
    what: "the target is rounded to multiples of a step",
};

/// Parameters of one joint.
#[derive(Clone, Debug)]
pub(super) struct Command {
    pub quantum: f64,
    /// Physics steps.
    pub delay: f64,
    /// rad or m a physics step.
    pub rate: f64,
    pub gain: f64,
    pub dead_band: f64,
}

impl Default for Command {
    fn default() -> Self {
        Self {
            quantum: 0.0,
            delay: 0.0,
            rate: f64::INFINITY,
            gain: 1.0,
            dead_band: 0.0,
        }
    }
}

impl Command {
    /// The target as commanded, rounded.
    pub fn rounded(&self, target: f64) -> f64 {
        if self.quantum > 0.0 {
            (target / self.quantum).round() * self.quantum
        } else {
            target
        }
    }

    /// The target after the delay, behind rate limit and gain; `last` is the rate limiter's state.
    pub fn follow(&self, delayed: f64, last: &mut f64) -> f64 {
        *last += (delayed - *last).clamp(-self.rate, self.rate);
        self.gain * *last
    }

    /// The target that gives the servo at `position` the error beyond the dead band.
    pub fn beyond_dead_band(&self, target: f64, position: f64) -> f64 {
        let error = target - position;
        target - error.clamp(-self.dead_band, self.dead_band)
    }
}
