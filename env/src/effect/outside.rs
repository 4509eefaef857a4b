//! Torques that no model of the drive explains: constant ones, and those that repeat over position.

use std::f64::consts::TAU;

use super::catalogue::{Info, Parameter, Place, Scale, Site, positive, signed};

pub(super) const CONSTANT: Info = Info {
    id: "external_force",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "torque",
        scale: Scale::Torque,
        neutral: Some(0.0),
        starts: &[0.02, -0.02],
        bounds: signed(1e9),
        default: None,
        what: "constant torque (force) on the joint",
    }],
    what: "a constant torque (force for a sliding joint) from outside",
};

pub(super) const RIPPLE: Info = Info {
    id: "position_ripple",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "sine",
            scale: Scale::Torque,
            neutral: Some(0.0),
            starts: &[0.03],
            bounds: signed(1e9),
            default: None,
            what: "amplitude of the sine over position",
        },
        Parameter {
            name: "cosine",
            scale: Scale::Torque,
            neutral: Some(0.0),
            starts: &[0.03],
            bounds: signed(1e9),
            default: Some(0.0),
            what: "amplitude of the cosine over position",
        },
        Parameter {
            name: "frequency",
            scale: Scale::Frequency,
            neutral: None,
            starts: &[1.0],
            bounds: positive(1e6),
            default: None,
            what: "how often it repeats",
        },
    ],
    what: "a torque that repeats over position: cogging, eccentric gears",
};

/// Parameters of one joint.
#[derive(Clone, Debug, Default)]
pub(super) struct Outside {
    pub constant: f64,
    pub sine: f64,
    pub cosine: f64,
    pub frequency: f64,
}

impl Outside {
    /// Torque at `position`.
    pub fn torque(&self, position: f64) -> f64 {
        if self.sine == 0.0 && self.cosine == 0.0 {
            return self.constant;
        }
        let (sin, cos) = (TAU * self.frequency * position).sin_cos();
        self.constant + self.sine * sin + self.cosine * cos
    }
}
