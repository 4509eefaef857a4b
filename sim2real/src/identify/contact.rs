//! How far a model of ground contact can be believed: one on a slippery ground, at half the physics step, is compared with the other.
//!
//! Neither is the ground's. Where the two differ by more than the encoder's noise, which is about touchdown, a stretch says nothing of
//! the robot and is left out; what they differ by in the others is part of the floor, and no effect is named of which another ground would make half.

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
/// The ground may be so many times as far from the model as the other one that is tried.
const FARTHER: f64 = 1.5;
/// What stands for a reading of a simulation that broke, rad or m.
const BROKEN: f64 = 1.0;

/// A ground on which soles turn as hard as on one that gives: of large soles, carpet, turf.
const GRIPPING: Friction = Friction {
    torsional: 0.1,
    ..GROUND
};

/// A ground that is more slippery than the model's.
const SLIPPERY: Friction = Friction {
    tangential: 0.6,
    torsional: 0.005,
    rolling: 0.0005,
};

/// By how much other models of contact change the readings of `robot`, in units of `noise` (by degree of freedom, rad or m): rapier's,
/// and a ground on which soles turn less easily.
///
/// # Errors
/// When an engine does not take the robot.
pub fn directions(trial: &Trial, robot: &Robot, noise: &[f64]) -> Result<[DVector<f64>; 2], EngineError> {
    let rapier: Box<dyn Engine> = Box::new(Rapier::new(robot, DT, 1)?);
    let lanes: Box<dyn Engine> = Box::new(Lanes::new(robot, DT, 1, level())?);
    let direction = |other| -> Result<DVector<f64>, EngineError> {
        let change = change(trial, robot, other, 1)?;
        let readings = trial.readings.iter().zip(&change);
        let entries = readings.map(|(r, change)| change / noise[r.dof]);
        Ok(DVector::from_iterator(change.len(), entries))
    };
    Ok([direction((rapier, GROUND))?, direction((lanes, GRIPPING))?])
}

/// By how much a ground that is more slippery and half the physics step change the readings, beyond what starts and rapier's contact
/// explain: one a reading, rad or m. Empty where the base is held.
fn differences(trial: &Trial, robot: &Robot) -> Result<Vec<f64>, EngineError> {
    let Some(starts) = &trial.starts else {
        return Ok(Vec::new());
    };
    let mut change = DVector::from_vec(slippery(trial, robot)?);
    starts.project(trial, &mut change);
    Ok(change.iter().copied().collect())
}

/// By how much a ground that is more slippery and half the physics step change the readings, rad or m.
fn slippery(trial: &Trial, robot: &Robot) -> Result<Vec<f64>, EngineError> {
    let engine = Box::new(Lanes::new(robot, DT / 2.0, 1, level())?);
    change(trial, robot, (engine, SLIPPERY), 2)
}

/// `data` as they would be if `model` lacked nothing and the ground were another: what an effect explains of them is no effect.
pub fn elsewhere(data: &Data, model: &Model) -> Data {
    let mut there = data.clone();
    Arc::make_mut(&mut there.trials)
        .par_iter_mut()
        .zip(&*data.robots)
        .for_each(|(trial, robot)| {
            let robot = robot.with(model);
            let own = starts::perfect(trial, &robot, 1).and_then(|own| Ok((own, slippery(trial, &robot)?)));
            // An engine that took the nominal robot takes all of them.
            if let Ok((own, change)) = own {
                let positions = own.iter().zip(change).map(|(own, change)| own + change);
                trial
                    .readings
                    .iter_mut()
                    .zip(positions)
                    .for_each(|(r, q)| r.position = q);
            }
        });
    there
}

/// By how much `other` changes the readings of `robot`.
fn change(
    trial: &Trial,
    robot: &Robot,
    other: (Box<dyn Engine>, Friction),
    finer: usize,
) -> Result<Vec<f64>, EngineError> {
    let own = std::slice::from_ref(robot);
    let lanes = rollout::predict(trial, own, 1)?;
    let rollout = Rollout::on(other, trial, own, DT / finer as f64, std::slice::from_ref(&trial.shift));
    let there = rollout::follow(trial, rollout, finer);
    let change = there.iter().zip(&lanes).map(|(a, b)| a - b);
    // Where one of them broke there is nothing to learn.
    Ok(change
        .map(|change| if change.is_finite() { change } else { BROKEN })
        .collect())
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
    let root = |(squares, count): (&f64, &f64)| FARTHER * (squares / count.max(1.0)).sqrt();
    Ok(squares.iter().zip(&count).map(root).collect())
}
