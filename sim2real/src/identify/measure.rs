//! How far a robot's simulation is from the logs, in measured quantities.

use std::collections::BTreeMap;

use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::{JointKind, Robot};
use rayon::prelude::*;
use serde::Serialize;

use super::starts;
use super::trial::Trial;

/// Errors of positions: by joint, and over all joints of one unit under `overall`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Errors(pub BTreeMap<String, f64>);

/// Root mean square and mean absolute errors.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Measure {
    /// Root mean square, rad or m.
    pub rmse: Errors,
    /// Mean absolute, rad or m.
    pub mae: Errors,
    /// The same of every quantity, by name.
    pub by_quantity: BTreeMap<String, BTreeMap<String, f64>>,
    /// Predictions at every reading of every trial.
    #[serde(skip)]
    pub predictions: Vec<Vec<f64>>,
}

impl Measure {
    /// Root mean square over all joints of one unit.
    pub fn overall(&self) -> f64 {
        self.rmse.0.get("overall").copied().unwrap_or(f64::NAN)
    }
}

/// Simulates each robot, `robot` as it was in a log or with a model, through its trial at `finer` physics steps a millisecond, and compares.
pub(super) fn measure_each(robot: &Robot, trials: &[(Robot, &Trial)], finer: usize) -> Result<Measure, EngineError> {
    let predictions: Result<Vec<Vec<f64>>, EngineError> = trials
        .par_iter()
        .map(|(own, trial)| starts::predict(trial, std::slice::from_ref(own), finer))
        .collect();
    let predictions = predictions?;
    let mut sums = Sums::new(robot.dofs.len());
    for ((_, trial), predicted) in trials.iter().zip(&predictions) {
        for (reading, p) in trial.readings.iter().zip(predicted) {
            sums.add(reading.dof, p - reading.position);
        }
    }
    let mut measure = Measure::default();
    for d in 0..robot.dofs.len() {
        let name = &robot.dof(d).name;
        if let Some((rmse, mae)) = sums.of(d) {
            measure.rmse.0.insert(name.clone(), rmse);
            measure.mae.0.insert(name.clone(), mae);
        }
    }
    if let Some((rmse, mae)) = sums.overall(robot) {
        measure.rmse.0.insert("overall".into(), rmse);
        measure.mae.0.insert("overall".into(), mae);
        let own = BTreeMap::from([("rmse".to_owned(), rmse), ("mae".to_owned(), mae)]);
        measure.by_quantity.insert("joint_position".into(), own);
    }
    measure.predictions = predictions;
    Ok(measure)
}

/// Sums of squared and of absolute errors and their number, by degree of freedom.
pub(super) struct Sums(Vec<(f64, f64, f64)>);

impl Sums {
    pub fn new(dofs: usize) -> Self {
        Self(vec![(0.0, 0.0, 0.0); dofs])
    }

    pub fn add(&mut self, dof: usize, error: f64) {
        let sum = &mut self.0[dof];
        *sum = (sum.0 + error * error, sum.1 + error.abs(), sum.2 + 1.0);
    }

    /// Adds those of other readings.
    pub fn and(&mut self, other: &Self) {
        for (sum, more) in self.0.iter_mut().zip(&other.0) {
            *sum = (sum.0 + more.0, sum.1 + more.1, sum.2 + more.2);
        }
    }

    /// Root mean square and mean absolute error of a degree of freedom, if it was read.
    pub fn of(&self, dof: usize) -> Option<(f64, f64)> {
        let (squares, absolute, count) = self.0[dof];
        (count > 0.0).then(|| ((squares / count).sqrt(), absolute / count))
    }

    /// The same over all degrees of freedom of one unit: radians where any joint of `robot` turns.
    pub fn overall(&self, robot: &Robot) -> Option<(f64, f64)> {
        let turns = |d: usize| robot.dof(d).kind == JointKind::Revolute;
        let turning = (0..self.0.len()).any(turns);
        let own = (0..self.0.len()).filter(|&d| turns(d) == turning && self.0[d].2 > 0.0);
        let (mut squares, mut absolute, mut dofs) = (0.0, 0.0, 0.0);
        for (s, a, count) in own.map(|d| self.0[d]) {
            (squares, absolute, dofs) = (squares + s / count, absolute + a / count, dofs + 1.0);
        }
        (dofs > 0.0).then(|| ((squares / dofs).sqrt(), absolute / dofs))
    }
}
