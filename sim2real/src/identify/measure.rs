//! How far a robot's simulation is from the logs, in measured quantities.

use std::collections::BTreeMap;

use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::{JointKind, Robot};
use rayon::prelude::*;
use serde::Serialize;

use super::starts;
use super::trial::{Trial, TrialError};

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

/// Simulates `robot` (as it was in each log) through `trials` at `finer` physics steps a millisecond, and compares.
///
/// # Errors
/// A log that overrides what the robot does not have, or an engine that does not take the robot.
pub fn measure(robot: &Robot, trials: &[Trial], finer: usize) -> Result<Measure, super::IdentifyError> {
    let robots = trials.iter().map(|trial| Ok((trial.robot(robot)?, trial)));
    let robots: Vec<(Robot, &Trial)> = robots.collect::<Result<_, TrialError>>()?;
    Ok(measure_each(robot, &robots, finer)?)
}

/// The same with the robot of each log at hand.
pub(super) fn measure_each(robot: &Robot, trials: &[(Robot, &Trial)], finer: usize) -> Result<Measure, EngineError> {
    let predictions: Result<Vec<Vec<f64>>, EngineError> = trials
        .par_iter()
        .map(|(own, trial)| starts::predict(trial, std::slice::from_ref(own), finer))
        .collect();
    let predictions = predictions?;
    let mut measure = Measure::default();
    let dofs = robot.dofs.len();
    let mut sums = vec![(0.0, 0.0, 0.0_f64); dofs];
    for ((_, trial), predicted) in trials.iter().zip(&predictions) {
        for (reading, p) in trial.readings.iter().zip(predicted) {
            let error = p - reading.position;
            let sum = &mut sums[reading.dof];
            sum.0 += error * error;
            sum.1 += error.abs();
            sum.2 += 1.0;
        }
    }
    let mut overall = (0.0, 0.0, 0.0);
    // Radians where any joint turns.
    let turning = (0..dofs).any(|d| robot.dof(d).kind == JointKind::Revolute);
    for (d, (squares, absolute, count)) in sums.into_iter().enumerate().filter(|(_, sum)| sum.2 > 0.0) {
        let joint = robot.dof(d);
        measure.rmse.0.insert(joint.name.clone(), (squares / count).sqrt());
        measure.mae.0.insert(joint.name.clone(), absolute / count);
        if (joint.kind == JointKind::Revolute) == turning {
            overall = (
                overall.0 + squares / count,
                overall.1 + absolute / count,
                overall.2 + 1.0,
            );
        }
    }
    if overall.2 > 0.0 {
        let (rmse, mae) = ((overall.0 / overall.2).sqrt(), overall.1 / overall.2);
        measure.rmse.0.insert("overall".into(), rmse);
        measure.mae.0.insert("overall".into(), mae);
        let own = BTreeMap::from([("rmse".to_owned(), rmse), ("mae".to_owned(), mae)]);
        measure.by_quantity.insert("joint_position".into(), own);
    }
    measure.predictions = predictions;
    Ok(measure)
}
