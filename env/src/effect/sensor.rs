//! Encoders: zero, scale, delay. Servos hold what their encoder says, and are damped by how fast the joint moves; the delay is that of the reading
//! alone.

use super::catalogue::{Bounds, Info, Parameter, Place, Scale, Site, positive, signed};
use super::command::LONGEST_DELAY;

pub(super) const OFFSET: Info = Info {
    id: "sensor_offset",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "offset",
        scale: Scale::Position,
        neutral: Some(0.0),
        starts: &[0.01, -0.01],
        bounds: signed(1e3),
        default: None,
        what: "reading at the joint's zero",
    }],
    what: "the encoder's zero is not the joint's",
};

pub(super) const SCALE: Info = Info {
    id: "sensor_scale",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "scale",
        scale: Scale::One,
        neutral: Some(1.0),
        starts: &[0.98, 1.02],
        bounds: Bounds {
            lower: 0.01,
            upper: 100.0,
        },
        default: None,
        what: "change of the reading over change of the position",
    }],
    what: "the encoder reads more or less than the joint moves",
};

pub(super) const DELAY: Info = Info {
    id: "sensor_delay",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "time",
        scale: Scale::Time,
        neutral: Some(0.0),
        starts: &[0.004, 0.015, 0.04],
        bounds: positive(LONGEST_DELAY),
        default: None,
        what: "age of a reading when it arrives",
    }],
    what: "readings arrive later than they were taken",
};

/// Parameters of one joint.
#[derive(Clone, Debug)]
pub(super) struct Sensor {
    pub offset: f64,
    pub scale: f64,
    /// Physics steps.
    pub delay: f64,
}

impl Default for Sensor {
    fn default() -> Self {
        Self {
            offset: 0.0,
            scale: 1.0,
            delay: 0.0,
        }
    }
}

impl Sensor {
    /// What the encoder says at `position`.
    pub fn read(&self, position: f64) -> f64 {
        self.scale * position + self.offset
    }

    /// The position at which the encoder says `reading`.
    pub fn position(&self, reading: f64) -> f64 {
        (reading - self.offset) / self.scale
    }
}
