//! Readings that no working sensor gives.

use core::f32::consts::PI;

use libm::fabsf;

use super::{Fault, Reading};
use crate::{
    pipeline::Sensors,
    spec::{JointSpec, Spec},
};

/// Share of its range by which a joint may be beyond its limits: stops give, and limits are set with a margin to them.
const BEYOND_LIMITS: f32 = 0.1;

/// By how much an encoder's zero may be off beside that, rad or m: what training varies it by.
const ZERO: f32 = 0.02;

/// Largest rate of a joint or of the base, rad/s or m/s: some ten times what the fastest motors turn and gyroscopes measure.
const LARGEST_RATE: f32 = 1000.0;

/// Largest angle of the base, rad: half a turn, whatever angles they are, with room for rounding.
const LARGEST_ANGLE: f32 = 1.001 * PI;

/// The first reading that is not finite or absurd.
pub(super) fn judge(spec: &Spec, sensors: &Sensors) -> Option<Fault> {
    judge_positions(spec, sensors.position)
        .or_else(|| judge_all(Reading::Velocity, sensors.velocity, LARGEST_RATE))
        .or_else(|| judge_all(Reading::Attitude, &sensors.attitude, LARGEST_ANGLE))
        .or_else(|| judge_all(Reading::Gyro, &sensors.gyro, LARGEST_RATE))
        .or_else(|| {
            let velocity = sensors.base_velocity.as_ref()?;
            judge_all(Reading::BaseVelocity, velocity, LARGEST_RATE)
        })
}

/// [`judge`] of the joints' positions alone, rad or m.
pub(super) fn judge_positions(spec: &Spec, position: &[f32]) -> Option<Fault> {
    let mut pairs = position.iter().zip(&spec.joints).enumerate();
    pairs.find_map(|(index, (&value, joint))| judge_one(Reading::Position, index, value, is_possible(joint, value)))
}

fn judge_all(reading: Reading, values: &[f32], largest: f32) -> Option<Fault> {
    let mut values = values.iter().enumerate();
    values.find_map(|(index, &value)| judge_one(reading, index, value, fabsf(value) <= largest))
}

fn judge_one(reading: Reading, index: usize, value: f32, possible: bool) -> Option<Fault> {
    if !value.is_finite() {
        Some(Fault::NotFinite { reading, index })
    } else if !possible {
        Some(Fault::Absurd { reading, index, value })
    } else {
        None
    }
}

fn is_possible(joint: &JointSpec, position: f32) -> bool {
    let slack = BEYOND_LIMITS * (joint.upper - joint.lower) + ZERO;
    position >= joint.lower - slack && position <= joint.upper + slack
}
