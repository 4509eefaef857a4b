//! What nobody measured of the start of a stretch, where a robot walks freely: how fast its joints and its trunk move, how the
//! trunk is inclined, and how deep the soles are in the ground (multiple shooting).
//!
//! These numbers, s, are no part of a model: every stretch has its own, known beforehand to some spread P (by the noise of what
//! they are measured with). To first order in s the residual of a stretch is r + J s, J by finite differences in SIMD lanes. Its
//! covariance is N (1 + A A') N, N the noise of the encoders and A = N^-1 J P^(1/2), so that
//!
//! ```text
//! e = N (1 + A A')^(-1/2) N^-1 (r - J s0),   s0: the start that r is simulated from
//! ```
//!
//! is as white as the noise, and its squares are the least that any start leaves, its own improbability included (variable
//! projection, Golub and Pereyra 1973, with J kept). All that compares models compares by e: [`predict`] gives the readings that e
//! is off by. A held base has no such numbers, and nothing is computed.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};
use omniwalk_env::engine::{EngineError, Start};
use omniwalk_env::robot::Robot;
use rayon::prelude::*;

use super::contact;
use super::rollout::{self, Rollout};
use super::trial::{DT, Trial};

/// Spread of the trunk's inclination, rad: what an inertial unit's attitude is good for.
const INCLINATION: f64 = 0.02;
/// Spread of the trunk's angular velocity, rad/s.
const TURNING: f64 = 0.1;
/// Spread of the trunk's velocity about that with which the soles rest, m/s.
const MOVING: f64 = 0.1;
/// Spread of the trunk's height about that at which the lowest sole touches, m.
const HEIGHT: f64 = 1e-3;
/// Numbers of the base: inclination 2, angular velocity 3, velocity 3, height 1.
const BASE: usize = 9;
/// Spread of a joint's position and velocity in units of what the noise of the readings about the start makes of them: a cubic
/// does not follow what ground contact does to a joint.
const WIDER: f64 = 3.0;
/// Least spread of a joint's velocity, rad/s or m/s.
const SPEED: f64 = 0.3;
/// Least spread of a joint's position, rad or m.
const POSITION: f64 = 3e-3;
/// Steps of finite differences in units of the spread: contacts have kinks, and what counts is the slope over what is likely.
const STEP: f64 = 0.25;
/// Spread of the part of another model's contact: what that changes may be there twice, or turned.
const CONTACT: f64 = 2.0;
/// Directions that starts change less, in units of the noise, squared, are none.
const LEAST: f64 = 1e-6;
/// No encoder is taken to be better, rad or m.
const QUIETEST: f64 = 1e-5;
/// Candidates in one rollout.
const LANES: usize = super::fit::LANES;
/// Steps to the start that explains a stretch best (Gauss and Newton).
const ITERATIONS: usize = 3;

/// What a stretch's start can explain of its readings.
#[derive(Clone, Debug)]
pub struct Starts {
    /// Noise of the encoders, by degree of freedom, rad or m.
    pub noise: Vec<f64>,
    /// By how much the residual would be more were the start the measured one, by reading, rad or m.
    offset: Vec<f64>,
    /// Directions (columns, of unit length, one entry a reading in units of the noise) that starts explain.
    directions: DMatrix<f64>,
    /// The share of a residual in each of them that they take.
    shares: DVector<f64>,
}

impl Starts {
    /// Takes what starts explain out of `residuals`: one a reading of `trial`, rad or m.
    pub fn project(&self, trial: &Trial, residuals: &mut DVector<f64>) {
        let noise = |i: usize| self.noise[trial.readings[i].dof];
        residuals.iter_mut().enumerate().for_each(|(i, r)| *r /= noise(i));
        let taken = self.directions.tr_mul(residuals).component_mul(&self.shares);
        residuals.gemv(-1.0, &self.directions, &taken, 1.0);
        residuals.iter_mut().enumerate().for_each(|(i, r)| *r *= noise(i));
    }

    /// The residual at the measured start of what was simulated from the fitted one, `predicted` by reading.
    fn residuals(&self, trial: &Trial, predicted: impl Iterator<Item = f64>) -> DVector<f64> {
        let measured = trial.readings.iter().zip(&self.offset);
        let all = predicted.zip(measured).map(|(p, (r, offset))| p - r.position - offset);
        DVector::from_iterator(trial.readings.len(), all)
    }
}

/// As [`rollout::predict`], less what starts explain of the distance to the readings.
///
/// # Errors
/// When an engine does not take the robot.
pub fn predict(trial: &Trial, robots: &[Robot], finer: usize) -> Result<Vec<f64>, EngineError> {
    let mut out = rollout::predict(trial, robots, finer)?;
    let Some(starts) = &trial.starts else {
        return Ok(out);
    };
    let worlds = robots.len();
    for w in 0..worlds {
        let mut left = starts.residuals(trial, out.iter().skip(w).step_by(worlds).copied());
        starts.project(trial, &mut left);
        let readings = trial.readings.iter().zip(left.iter());
        let column = out.iter_mut().skip(w).step_by(worlds);
        column.zip(readings).for_each(|(p, (r, e))| *p = r.position + e);
    }
    Ok(out)
}

/// Readings that `robot` predicts to the last digit, whatever the start: what the gradient of a change of engine is taken against.
///
/// # Errors
/// When an engine does not take the robot.
pub fn perfect(trial: &Trial, robot: &Robot, finer: usize) -> Result<Vec<f64>, EngineError> {
    let mut out = rollout::predict(trial, std::slice::from_ref(robot), finer)?;
    if let Some(starts) = &trial.starts {
        out.iter_mut().zip(&starts.offset).for_each(|(p, offset)| *p -= offset);
    }
    Ok(out)
}

/// How many numbers a start of `dofs` degrees of freedom has.
pub fn size(dofs: usize) -> usize {
    BASE + 2 * dofs
}

/// Moves `start` by the numbers `s`; its soles are put on the ground (`place`) once the joints are where they are.
pub fn moved(start: &mut Start, s: &[f64], place: impl Fn(&mut Start)) {
    let dofs = start.joints.len();
    let (base, joints) = s.split_at(BASE);
    for d in 0..dofs {
        start.joints[d] += joints[d];
        start.joint_velocities[d] += joints[dofs + d];
    }
    place(start);
    start.position.z += base[8];
    start.linear_velocity += Vector3::new(base[5], base[6], base[7]);
}

/// The inclination and the angular velocity of the base moved by the numbers `s`.
pub fn inclined(base: &super::base::MeasuredBase, s: &[f64]) -> super::base::MeasuredBase {
    super::base::MeasuredBase {
        orientation: UnitQuaternion::from_scaled_axis(Vector3::new(s[0], s[1], 0.0)) * base.orientation,
        angular_velocity: base.angular_velocity + Vector3::new(s[2], s[3], s[4]),
    }
}

/// Spread of the numbers of a start of `trial`, whose encoders have `noise`.
fn spread(trial: &Trial, noise: &[f64]) -> Vec<f64> {
    let base = [INCLINATION; 2]
        .into_iter()
        .chain([TURNING; 3])
        .chain([MOVING; 3])
        .chain([HEIGHT]);
    let of = |part: fn(&(f64, f64)) -> f64, least: f64| {
        let own = trial.spread.iter().zip(noise);
        own.map(move |(own, noise)| (WIDER * part(own) * noise).hypot(least))
    };
    base.chain(of(|own| own.0, POSITION))
        .chain(of(|own| own.1, SPEED))
        .collect()
}

/// Noise of the encoders of `dofs` degrees of freedom in `trials`, rad or m.
pub fn noise(trials: &[Trial], dofs: usize) -> Vec<f64> {
    (0..dofs)
        .map(|d| super::noise::sensor(trials, d).max(QUIETEST))
        .collect()
}

/// Fits the starts of `trials`, which `robots` are at, whose encoders have `noise`; nothing where the base is held.
///
/// # Errors
/// When an engine does not take a robot.
pub fn fit(trials: &mut [Trial], robots: &[Robot], noise: &[f64], finer: usize) -> Result<(), EngineError> {
    let all = trials
        .par_iter_mut()
        .zip(robots)
        .filter(|(trial, _)| trial.base.is_some());
    all.map(|(trial, robot)| fit_one(trial, robot, noise, finer)).collect()
}

fn fit_one(trial: &mut Trial, robot: &Robot, noise: &[f64], finer: usize) -> Result<(), EngineError> {
    let spread = spread(trial, noise);
    trial.shift = vec![0.0; spread.len()];
    let mut best: Option<(f64, Line)> = None;
    for step in 0..=ITERATIONS {
        let line = Line::at(trial, robot, &spread, noise, finer)?;
        let cost = line.residual.norm_squared() + line.at.norm_squared();
        match &best {
            // A step that made it worse is not gone: the start before it stays.
            Some((before, _)) if cost >= *before || cost.is_nan() => break,
            _ => {}
        }
        let next = line.best();
        best = Some((cost, line));
        if step < ITERATIONS {
            trial.shift = next.iter().zip(&spread).map(|(s, spread)| s * spread).collect();
        }
    }
    if let Some((_, line)) = best {
        trial.shift = line.at.iter().zip(&spread).map(|(s, spread)| s * spread).collect();
        let contact = contact::directions(trial, robot, noise)?;
        trial.starts = Some(Arc::new(line.starts(trial, noise, &contact)));
    }
    Ok(())
}

/// A stretch's residual as a linear function of its start, residuals in units of the noise, starts in units of their spread.
struct Line {
    at: DVector<f64>,
    residual: DVector<f64>,
    slope: DMatrix<f64>,
}

impl Line {
    /// About the start that `trial` has.
    fn at(trial: &Trial, robot: &Robot, spread: &[f64], noise: &[f64], finer: usize) -> Result<Self, EngineError> {
        let n = spread.len();
        // Entry 0 is the start itself, then a step up and one down along every number.
        let shift = |m: usize| {
            let mut shift = trial.shift.clone();
            if m > 0 {
                let (i, sign) = ((m - 1) / 2, if m % 2 == 1 { STEP } else { -STEP });
                shift[i] += sign * spread[i];
            }
            shift
        };
        let shifts: Vec<Vec<f64>> = (0..=2 * n).map(shift).collect();
        let readings = trial.readings.len();
        let mut columns = DMatrix::zeros(readings, shifts.len());
        for (c, chunk) in shifts.chunks(LANES).enumerate() {
            let robots = vec![robot.clone(); chunk.len()];
            let rollout = Rollout::shifted(trial, &robots, DT / finer as f64, chunk)?;
            let predicted = rollout::follow(trial, rollout, finer);
            for (i, row) in predicted.chunks(chunk.len()).enumerate() {
                for (w, p) in row.iter().enumerate() {
                    columns[(i, c * LANES + w)] = p / noise[trial.readings[i].dof];
                }
            }
        }
        let slope = |i: usize, s: usize| {
            let slope = (columns[(i, 2 * s + 1)] - columns[(i, 2 * s + 2)]) / (2.0 * STEP);
            if slope.is_finite() { slope } else { 0.0 }
        };
        let measured = |i: usize| trial.readings[i].position / noise[trial.readings[i].dof];
        Ok(Self {
            at: DVector::from_fn(n, |s, _| trial.shift[s] / spread[s]),
            residual: DVector::from_fn(readings, |i, _| columns[(i, 0)] - measured(i)),
            slope: DMatrix::from_fn(readings, n, slope),
        })
    }

    /// The start that is best on the line, its own improbability included.
    fn best(&self) -> DVector<f64> {
        let n = self.at.len();
        let curvature = self.slope.tr_mul(&self.slope) + DMatrix::identity(n, n);
        let measured = &self.residual - &self.slope * &self.at;
        let right = -self.slope.tr_mul(&measured);
        curvature
            .cholesky()
            .map_or_else(|| self.at.clone(), |factor| factor.solve(&right))
    }

    /// What starts explain, and `contact` with them: the residuals other models of contact would make, in units of the noise.
    fn starts(&self, trial: &Trial, noise: &[f64], contact: &[DVector<f64>]) -> Starts {
        let offset = &self.slope * &self.at;
        let starts = self.at.len();
        let n = starts + contact.len();
        let mut slope = self.slope.clone().insert_columns(starts, contact.len(), 0.0);
        for (column, direction) in (starts..).zip(contact) {
            slope.set_column(column, &(CONTACT * direction));
        }
        // The eigenvectors of A'A give the directions of A A' without a decomposition as large as the readings are many.
        let eigen = slope.tr_mul(&slope).symmetric_eigen();
        let told: Vec<usize> = (0..n).filter(|&k| eigen.eigenvalues[k] > LEAST).collect();
        let mut directions = DMatrix::zeros(offset.len(), told.len());
        for (column, &k) in told.iter().enumerate() {
            let direction = &slope * eigen.eigenvectors.column(k);
            directions.set_column(column, &(direction / eigen.eigenvalues[k].sqrt()));
        }
        let share = |c: usize, _| 1.0 - 1.0 / (1.0 + eigen.eigenvalues[told[c]]).sqrt();
        Starts {
            noise: noise.to_vec(),
            offset: (0..offset.len())
                .map(|i| offset[i] * noise[trial.readings[i].dof])
                .collect(),
            directions,
            shares: DVector::from_fn(told.len(), share),
        }
    }
}
