//! How far a model of ground contact can be believed: what other grounds change is compared.
//!
//! None of them is the ground that the robot walked on. What each of many changes is taken out of every stretch with its start
//! ([`directions`]); what that leaves of one that is none of them is part of the floor. Where it is more than the encoder's noise,
//! a stretch says nothing of the robot and is left out, and no effect is named of which that ground would make half.

use std::sync::Arc;

use nalgebra::DVector;
use omniwalk_env::engine::lanes::Lanes;
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Engine, EngineError, Friction};
use omniwalk_env::robot::Robot;
use rayon::prelude::*;

use super::fit::Data;
use super::model::Model;
use super::own::Logged;
use super::rollout::{self, GROUND, Rollout, level};
use super::starts;
use super::trial::{DT, Trial};

/// A stretch is kept where the grounds differ by less than so many times the noise, root mean square.
const AGREED: f64 = 2.0;
/// A stretch is left out where it is so many times as far off as half of them are at most.
const UNUSUAL: f64 = 2.5;
/// What stands for a reading of a simulation that broke, rad or m.
const BROKEN: f64 = 1.0;

/// A way to model the ground.
struct Ground {
    /// Whether the engine is rapier's.
    rapier: bool,
    /// How hard it is beside ours.
    hardness: f64,
    /// Friction.
    friction: Friction,
    /// Physics steps a millisecond.
    finer: usize,
}

/// The one that is fitted with.
const OURS: Ground = Ground {
    rapier: false,
    hardness: 1.0,
    friction: GROUND,
    finer: 1,
};

/// What other grounds change, and how much of each there is nobody knows: softer and harder ones, those that slip, turn and roll
/// more easily or less, and what the integration and another solver make of contact.
const GROUNDS: [Ground; 11] = [
    Ground { rapier: true, ..OURS },
    Ground { hardness: 0.3, ..OURS },
    Ground { hardness: 0.5, ..OURS },
    Ground { hardness: 2.0, ..OURS },
    Ground { finer: 2, ..OURS },
    Ground {
        friction: Friction {
            tangential: 0.6,
            ..GROUND
        },
        ..OURS
    },
    Ground {
        friction: Friction {
            tangential: 0.3,
            ..GROUND
        },
        ..OURS
    },
    // Soles turn as hard as on one that gives: of large soles, carpet, turf.
    Ground {
        friction: Friction {
            torsional: 0.1,
            ..GROUND
        },
        ..OURS
    },
    Ground {
        friction: Friction {
            torsional: 0.003,
            ..GROUND
        },
        ..OURS
    },
    Ground {
        friction: Friction { rolling: 0.0, ..GROUND },
        ..OURS
    },
    Ground {
        friction: Friction {
            rolling: 0.01,
            ..GROUND
        },
        ..OURS
    },
];

/// A ground that is none of those, nor between them: what is left of it is what nobody can tell from the robot.
const OTHER: Ground = Ground {
    hardness: 0.3,
    friction: Friction {
        tangential: 0.3,
        torsional: 0.05,
        rolling: 0.005,
    },
    ..OURS
};

/// By how much other models of contact change the readings of `robot`, in units of `noise` (by degree of freedom, rad or m).
///
/// # Errors
/// When an engine does not take the robot.
pub fn directions(trial: &Trial, robot: &Robot, noise: &[f64]) -> Result<Vec<DVector<f64>>, EngineError> {
    let ours = rollout::predict(trial, std::slice::from_ref(robot), 1)?;
    let direction = |ground: &Ground| -> Result<DVector<f64>, EngineError> {
        let change = ground.change(trial, robot, &ours)?;
        let readings = trial.readings.iter().zip(&change);
        let entries = readings.map(|(r, change)| change / noise[r.dof]);
        Ok(DVector::from_iterator(change.len(), entries))
    };
    GROUNDS.iter().map(direction).collect()
}

impl Ground {
    /// By how much the readings of `robot` change where it stands on this ground instead of on [`OURS`], where they are `ours`, rad or m.
    fn change(&self, trial: &Trial, robot: &Robot, ours: &[f64]) -> Result<Vec<f64>, EngineError> {
        let own = std::slice::from_ref(robot);
        let shift = std::slice::from_ref(&trial.shift);
        let rollout = Rollout::on((self.engine(robot)?, self.friction), trial, own, self.dt(), shift);
        let there = rollout::follow(trial, rollout, self.finer);
        let change = there.iter().zip(ours).map(|(a, b)| a - b);
        // Where one of them broke there is nothing to learn.
        Ok(change
            .map(|change| if change.is_finite() { change } else { BROKEN })
            .collect())
    }

    fn engine(&self, robot: &Robot) -> Result<Box<dyn Engine>, EngineError> {
        if self.rapier {
            return Ok(Box::new(Rapier::new(robot, self.dt(), 1)?));
        }
        let mut lanes = Lanes::new(robot, self.dt(), 1, level())?;
        lanes.harden(self.hardness);
        Ok(Box::new(lanes))
    }

    /// Physics step, s.
    fn dt(&self) -> f64 {
        DT / self.finer as f64
    }
}

/// By how much the [`OTHER`] ground changes the readings, beyond what starts and [`GROUNDS`] explain: one a reading, rad or m. Empty
/// where the base is held.
fn differences(trial: &Trial, robot: &Robot) -> Result<Vec<f64>, EngineError> {
    let Some(starts) = &trial.starts else {
        return Ok(Vec::new());
    };
    let ours = rollout::predict(trial, std::slice::from_ref(robot), 1)?;
    let mut change = DVector::from_vec(OTHER.change(trial, robot, &ours)?);
    starts.project(trial, &mut change);
    Ok(change.iter().copied().collect())
}

/// `data` as they would be if `model` lacked nothing and the ground were another: what an effect explains of them is no effect.
pub fn elsewhere(data: &Data, model: &Model) -> Data {
    let mut there = data.clone();
    Arc::make_mut(&mut there.trials)
        .par_iter_mut()
        .zip(&*data.robots)
        .for_each(|(trial, robot)| {
            let robot = robot.with(model);
            // An engine that took the nominal robot takes all of them.
            if let Ok(positions) = on_other(trial, &robot) {
                let readings = trial.readings.iter_mut().zip(positions);
                readings.for_each(|(r, q)| r.position = q);
            }
        });
    there
}

/// Readings that `robot` predicts on the [`OTHER`] ground to the last digit, whatever the start.
fn on_other(trial: &Trial, robot: &Robot) -> Result<Vec<f64>, EngineError> {
    let ours = rollout::predict(trial, std::slice::from_ref(robot), 1)?;
    let change = OTHER.change(trial, robot, &ours)?;
    let own = starts::perfect(trial, robot, 1)?;
    Ok(own.iter().zip(change).map(|(own, change)| own + change).collect())
}

/// Each of `trials` with its robot, the nominal one.
fn at<'a>(trials: &'a [Trial], robots: &[Logged]) -> Vec<(&'a Trial, Robot)> {
    let nominal = Model::default();
    trials
        .iter()
        .zip(robots.iter().map(|robot| robot.with(&nominal)))
        .collect()
}

/// Leaves those of `trials`, which `robots` are at, whose starts are fitted and about which the grounds agree.
///
/// # Errors
/// When an engine does not take a robot.
pub fn keep_agreed(trials: &mut Vec<Trial>, robots: &[Logged]) -> Result<(), EngineError> {
    let own: Vec<(&Trial, Robot)> = at(trials, robots);
    let agreed = own.par_iter().map(|(trial, robot)| is_agreed(trial, robot));
    let agreed = agreed.collect::<Result<Vec<bool>, EngineError>>()?;
    let mut agreed = agreed.into_iter();
    trials.retain(|_| agreed.next().unwrap_or(false));
    Ok(())
}

/// Leaves those of `trials`, which `robots` are at, that are not far worse than half of them are: something else happened there, a
/// fall, say. What the model lacks shows in more than a few.
///
/// # Errors
/// When an engine does not take a robot.
pub fn keep_usual(trials: &mut Vec<Trial>, robots: &[Logged]) -> Result<(), EngineError> {
    let own: Vec<(&Trial, Robot)> = at(trials, robots);
    let errors = own.par_iter().map(|(trial, robot)| error(trial, robot));
    let errors = errors.collect::<Result<Vec<Option<f64>>, EngineError>>()?;
    let mut sorted: Vec<f64> = errors.iter().filter_map(|error| *error).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(&usual) = sorted.get(sorted.len() / 2) else {
        return Ok(());
    };
    let mut errors = errors.into_iter();
    trials.retain(|_| {
        errors
            .next()
            .is_some_and(|error| error.is_none_or(|error| error <= UNUSUAL * usual))
    });
    Ok(())
}

/// Root mean square residual in units of the noise; `None` where the base is held.
fn error(trial: &Trial, robot: &Robot) -> Result<Option<f64>, EngineError> {
    let Some(starts) = &trial.starts else {
        return Ok(None);
    };
    let predicted = starts::predict(trial, std::slice::from_ref(robot), 1)?;
    let readings = trial.readings.iter().zip(&predicted);
    let squares: f64 = readings
        .map(|(r, p)| ((p - r.position) / starts.noise[r.dof]).powi(2))
        .sum();
    Ok(Some((squares / predicted.len() as f64).sqrt()))
}

fn is_agreed(trial: &Trial, robot: &Robot) -> Result<bool, EngineError> {
    let Some(starts) = &trial.starts else {
        return Ok(true);
    };
    let change = differences(trial, robot)?;
    let readings = trial.readings.iter().zip(&change);
    let squares: f64 = readings.map(|(r, change)| (change / starts.noise[r.dof]).powi(2)).sum();
    Ok(squares <= AGREED * AGREED * change.len() as f64)
}

/// What the ground leaves open of each degree of freedom under `model`, root mean square, rad or m; 0 where the base is held.
///
/// # Errors
/// When an engine does not take the robot.
pub fn floor(data: &Data, model: &Model) -> Result<Vec<f64>, EngineError> {
    let own: Vec<(&Trial, &Logged)> = data.trials.iter().zip(&*data.robots).collect();
    let changes = own
        .par_iter()
        .map(|(trial, robot)| differences(trial, &robot.with(model)));
    let changes = changes.collect::<Result<Vec<Vec<f64>>, EngineError>>()?;
    let (mut squares, mut count) = (vec![0.0; data.weights.len()], vec![0.0_f64; data.weights.len()]);
    for (trial, changes) in data.trials.iter().zip(&changes) {
        for (reading, change) in trial.readings.iter().zip(changes) {
            squares[reading.dof] += change * change;
            count[reading.dof] += 1.0;
        }
    }
    let root = |(squares, count): (&f64, &f64)| (squares / count.max(1.0)).sqrt();
    Ok(squares.iter().zip(&count).map(root).collect())
}
