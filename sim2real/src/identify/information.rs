//! What logs can tell of the nominal model: the Fisher information of its parameters.
//!
//! With encoders whose noise is white, no estimate without bias spreads less than the inverse of the information allows
//! (Cramér and Rao). Real residuals are neither white nor small: intervals of what was fitted are wider.

use nalgebra::DMatrix;
use omniwalk_env::robot::{JointKind, Robot};
use serde::Serialize;

use super::descent::sum;
use super::fit::Data;
use super::interval::told;
use super::model::Model;
use super::noise;
use super::scales::Scales;

/// Noise of an encoder is at least this share of the range of motion.
const QUIETEST: f64 = 1e-6;

/// What the logs can tell of a parameter of the nominal model.
#[derive(Clone, Debug, Serialize)]
pub struct Information {
    /// The joint.
    pub joint: String,
    /// What the parameter is called: a key of a joint, or an effect and its key.
    pub parameter: String,
    /// Its nominal value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// Smallest standard deviation that an estimate can have beside the others'; none where the logs do not tell it, or do not
    /// tell it from others.
    pub deviation: Option<f64>,
}

/// The information that `data` hold about the parameters that `model` has of the nominal one, at its values.
pub fn information(robot: &Robot, data: &mut Data, model: &Model, scales: &Scales) -> Vec<Information> {
    let weight = |d: usize| 1.0 / noise::sensor(&data.trials, d).max(QUIETEST * scales.joints[d].position);
    let by_noise = (0..robot.dofs.len()).map(weight).collect();
    let weights = std::mem::replace(&mut data.weights, by_noise);
    let n = model.tuned.len();
    let (_, slopes) = data.slopes(model, scales);
    data.weights = weights;
    let (_, fisher) = sum(&slopes, &|_| true, n);
    let told = told(&fisher);
    let small = DMatrix::from_fn(told.len(), told.len(), |a, b| fisher[(told[a], told[b])]);
    let inverse = small.cholesky().map(|factor| factor.inverse());
    let scale: Vec<f64> = model.free(scales).iter().map(|free| free.scale).collect();
    let deviation = |i: usize| {
        let at = told.iter().position(|&own| own == i)?;
        let variance = inverse.as_ref()?[(at, at)];
        Some(variance.max(0.0).sqrt() * scale[i])
    };
    let of = |(i, tuned): (usize, &super::model::Tuned)| {
        let joint = robot.dof(tuned.dof);
        Information {
            joint: joint.name.clone(),
            parameter: tuned.own.name(),
            value: tuned.nominal,
            unit: tuned.own.scale().unit(joint.kind == JointKind::Prismatic),
            deviation: deviation(i),
        }
    };
    model.tuned.iter().enumerate().map(of).collect()
}

/// What cannot be told, for the terminal; empty where all can.
pub fn untold(information: &[Information]) -> String {
    let own = information.iter().filter(|own| own.deviation.is_none());
    let names: Vec<String> = own.map(|own| format!("{} of {}", own.parameter, own.joint)).collect();
    names.join(", ")
}
