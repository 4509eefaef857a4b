//! The floor no model gets below, and what is too little beyond it.

use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::Limb;

use super::contact;
use super::fit::Data;
use super::found::{spread, sums};
use super::model::Model;
use super::noise;
use super::scales::Scales;
use super::torque::{self, MOTOR_TORQUE, Moment};

/// A joint's residual is negligible below this share of what its servo gives way under its own torque: friction that builds up
/// over a hair's breadth and motors that answer a fraction of a millisecond later, which every machine has, leave more
/// than two hundredths on one of the sealed rigs (docs/how-identify-works.md).
const NEGLIGIBLE: f64 = 0.04;
/// Soft servos give way so far that this is no bound for them: what is farther above the noise than this is not negligible.
const NEGLIGIBLE_OVER_FLOOR: f64 = 1.5;

/// What noise and integration leave, by degree of freedom, rad or m.
pub struct Floor {
    /// Noise of the sensors.
    pub sensor: Vec<f64>,
    /// What the physics step leaves open.
    pub integration: Vec<f64>,
    /// What another model of contact changes; 0 where the base is held.
    pub contact: Vec<f64>,
    /// What other moments of the commands change; 0 where the log says when each was given.
    pub timing: Vec<f64>,
    /// Spread of repeats, where there are any.
    pub repeats: Vec<Option<f64>>,
    /// Beyond that, what is too little to be an effect that is missing.
    pub negligible: Vec<f64>,
    weights: Vec<f64>,
}

impl Floor {
    /// The floor under `model`'s residual.
    ///
    /// # Errors
    /// When an engine does not take the robot.
    pub fn new(data: &Data, model: &Model, scales: &Scales) -> Result<Self, EngineError> {
        let dofs = 0..data.weights.len();
        let negligible = if data.is_free() {
            // What other grounds change is more than that, and nothing builds up over the stretches between landings.
            vec![0.0; dofs.len()]
        } else {
            let moments = torque::lacking(data, model, scales)?.into_iter().enumerate();
            moments
                .map(|(d, own)| NEGLIGIBLE * deflection(data, model, d, &own))
                .collect()
        };
        Ok(Self {
            negligible,
            sensor: dofs.clone().map(|d| noise::sensor(&data.trials, d)).collect(),
            integration: integration(data, model)?,
            contact: contact::floor(data, model)?,
            timing: noise::timing(data, model)?,
            repeats: dofs.map(|d| noise::repeats(&data.trials, d)).collect(),
            weights: data.weights.clone(),
        })
    }

    /// Of a degree of freedom, rad or m: what repeats show, else noise and integration.
    pub fn of(&self, d: usize) -> f64 {
        let parts = [&self.sensor, &self.integration, &self.contact, &self.timing];
        let own = parts.iter().fold(0.0, |sum: f64, part| sum.hypot(part[d]));
        self.repeats[d].map_or(own, |spread| spread.max(own))
    }

    /// Whether of some degree of freedom the physics step leaves more open than all else that is too little to be missing: a finer one would
    /// then show more.
    pub fn is_of_step(&self) -> bool {
        let other = |d: usize| {
            let noise = self.sensor[d].hypot(self.timing[d]);
            self.repeats[d]
                .map_or(noise, |spread| spread.max(noise))
                .max(self.negligible[d])
        };
        (0..self.weights.len()).any(|d| self.integration[d] > other(d))
    }

    /// Among the `dofs` degrees of freedom of the whole robot, of which its own are `limb`.
    pub fn of_whole(&self, limb: &Limb, dofs: usize) -> Self {
        let own = |values: &Vec<f64>| spread(values, limb, dofs);
        Self {
            sensor: own(&self.sensor),
            integration: own(&self.integration),
            contact: own(&self.contact),
            timing: own(&self.timing),
            repeats: spread(&self.repeats, limb, dofs),
            negligible: own(&self.negligible),
            weights: own(&self.weights),
        }
    }

    /// With that of other joints.
    pub fn and(&self, other: &Self) -> Self {
        let repeats = self.repeats.iter().zip(&other.repeats);
        Self {
            sensor: sums(&self.sensor, &other.sensor),
            integration: sums(&self.integration, &other.integration),
            contact: sums(&self.contact, &other.contact),
            timing: sums(&self.timing, &other.timing),
            repeats: repeats.map(|(a, b)| a.or(*b)).collect(),
            negligible: sums(&self.negligible, &other.negligible),
            weights: sums(&self.weights, &other.weights),
        }
    }

    /// Weighted sum of squares over all readings, by degree of freedom.
    pub fn squares(&self, data: &Data) -> Vec<f64> {
        self.weighted_squares(data, |d| self.of(d))
    }

    /// One over the floor of each degree of freedom: what contact spoils more counts less.
    pub fn inverse(&self) -> Vec<f64> {
        (0..self.weights.len()).map(|d| 1.0 / self.of(d)).collect()
    }

    /// The same floor, weighted by `weights`.
    pub fn weighted(self, weights: &[f64]) -> Self {
        Self {
            weights: weights.to_vec(),
            ..self
        }
    }

    /// Weighted sum of squares of what is negligible beyond that, by degree of freedom.
    pub fn negligible_squares(&self, data: &Data) -> Vec<f64> {
        self.weighted_squares(data, |d| self.negligible[d].min(NEGLIGIBLE_OVER_FLOOR * self.of(d)))
    }

    /// Weighted sum of squares over all readings were each as far off as `of` says of its degree of freedom, by degree of freedom.
    fn weighted_squares(&self, data: &Data, of: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; self.weights.len()];
        for reading in data.trials.iter().flat_map(|trial| &trial.readings) {
            sums[reading.dof] += (self.weights[reading.dof] * of(reading.dof)).powi(2);
        }
        sums
    }

    /// Weighted root mean square over the degrees of freedom.
    pub fn root(&self) -> f64 {
        let n = self.weights.len().max(1) as f64;
        let squares = (0..self.weights.len()).map(|d| (self.weights[d] * self.of(d)).powi(2));
        (squares.sum::<f64>() / n).sqrt()
    }
}

/// How far the simulation's readings of each degree of freedom are off for its physics step, rad or m: of a method of first order twice what half
/// the step changes. Where the base is free that is what another step does to contact, and no way to none of it.
fn integration(data: &Data, model: &Model) -> Result<Vec<f64>, EngineError> {
    let order = if data.is_free() { 1.0 } else { 2.0 };
    let changes = noise::discretisation(data, model)?;
    Ok(changes.into_iter().map(|change| order * change).collect())
}

/// How far the servo of degree of freedom `d` gives way under the torque it gives, root mean square, rad or m; 0 where
/// torques are commanded, so that nothing pulls the joint to where it should be.
fn deflection(data: &Data, model: &Model, d: usize, moments: &[Moment]) -> f64 {
    let (mut squares, mut count) = (0.0, 0.0_f64);
    let stiffness = |log: usize| {
        let t = data.trials.iter().position(|trial| trial.log == log)?;
        let actuator = data.robots[t].with(model).dof(d).actuator?;
        (!data.trials[t].told[d].effort && actuator.stiffness() > 0.0).then(|| actuator.stiffness())
    };
    let logs = 1 + data.trials.iter().map(|trial| trial.log).max().unwrap_or(0);
    let stiffnesses: Vec<Option<f64>> = (0..logs).map(stiffness).collect();
    for moment in moments {
        if let Some(stiffness) = stiffnesses[moment.log] {
            squares += (moment.values[MOTOR_TORQUE] / stiffness).powi(2);
        }
        count += 1.0;
    }
    (squares / count.max(1.0)).sqrt()
}
