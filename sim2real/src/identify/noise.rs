//! What no model can reach: noise and steps of the encoder, spread of repeats, and what the simulation's own step leaves open.

use omniwalk_env::engine::EngineError;

use super::fit::Data;
use super::model::Model;
use super::own::Logged;
use super::starts::predict;
use super::trial::Trial;

/// Readings of a window that a cubic is laid through.
const WINDOW: usize = 5;
/// Mean of the squares of a normal variable without their largest tenth, over their variance: P(chi^2 of 3 degrees of freedom
/// < 2.7055) / 0.9, where 2.7055 is the 90 % point for one.
const WITHOUT_TENTH: f64 = 0.623;

/// Classes of speed in which noise is measured.
const CLASSES: usize = 8;

/// Root mean square noise of the readings of degree of freedom `d`, by how far readings are from a cubic through them and
/// their neighbours; at least what rounding leaves. Stamps that are off by some time make it grow with speed.
pub fn sensor(trials: &[Trial], d: usize) -> f64 {
    let mut windows = Vec::new();
    let mut values = Vec::new();
    for trial in trials {
        let own: Vec<(f64, f64)> = trial
            .readings
            .iter()
            .filter(|r| r.dof == d)
            .map(|r| (r.at, r.position))
            .collect();
        values.extend(own.iter().map(|(_, q)| *q));
        // Stamps that are one rounding apart are the same step.
        let apart = |window: &&[(f64, f64)]| window.windows(2).all(|pair| pair[0].0 < pair[1].0);
        let measured = |window: &[(f64, f64)]| (speed(window).powi(2), roughness(window));
        windows.extend(own.windows(WINDOW).filter(apart).map(measured));
    }
    if windows.is_empty() {
        return 0.0;
    }
    windows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let classes: Vec<(f64, f64)> = windows.chunks(windows.len().div_ceil(CLASSES)).map(class).collect();
    let (still, per_speed) = line(&classes);
    let fast = windows.iter().map(|(speed, _)| speed).sum::<f64>() / windows.len() as f64;
    let quantum = quantum(&mut values);
    (still + per_speed * fast).max(quantum * quantum / 12.0).sqrt()
}

/// Speed over a window, rad or m a step.
fn speed(window: &[(f64, f64)]) -> f64 {
    let (first, last) = (window[0], window[window.len() - 1]);
    (last.1 - first.1) / (last.0 - first.0)
}

/// Mean squared speed and noise variance of windows of like speed. Steps and stops are not noise: the roughest tenth is left out.
fn class(windows: &[(f64, f64)]) -> (f64, f64) {
    let mut squares: Vec<f64> = windows.iter().map(|(_, roughness)| *roughness).collect();
    squares.sort_by(f64::total_cmp);
    let kept = &squares[..(squares.len() * 9).div_ceil(10)];
    let fast = windows.iter().map(|(speed, _)| speed).sum::<f64>() / windows.len() as f64;
    (fast, kept.iter().sum::<f64>() / (kept.len() as f64 * WITHOUT_TENTH))
}

/// The least-squares line through points, neither falling nor below zero where it starts.
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let spread: f64 = points.iter().map(|p| (p.0 - mean.0).powi(2)).sum();
    let joint: f64 = points.iter().map(|p| (p.0 - mean.0) * (p.1 - mean.1)).sum();
    let steepest = if mean.0 > 0.0 { mean.1 / mean.0 } else { 0.0 };
    let slope = if spread > 0.0 {
        (joint / spread).clamp(0.0, steepest)
    } else {
        0.0
    };
    (mean.1 - slope * mean.0, slope)
}

/// The part of five values that no cubic over their times explains, squared: with one value more than the cubic has
/// coefficients, it is the square of a combination of them, of unit length.
fn roughness(window: &[(f64, f64)]) -> f64 {
    // Divided differences of fourth order vanish on cubics.
    let weight = |i: usize| {
        let others = (0..window.len()).filter(|&j| j != i);
        1.0 / others.map(|j| window[i].0 - window[j].0).product::<f64>()
    };
    let (mut sum, mut norm) = (0.0, 0.0);
    for (i, (_, q)) in window.iter().enumerate() {
        let w = weight(i);
        sum += w * q;
        norm += w * w;
    }
    sum * sum / norm
}

/// Distance of the values that occur, where few of them do; else 0.
fn quantum(values: &mut Vec<f64>) -> f64 {
    let readings = values.len();
    values.sort_by(f64::total_cmp);
    values.dedup();
    if values.len() * 3 > readings {
        return 0.0;
    }
    let mut steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 4).copied().unwrap_or(0.0)
}

/// Root mean square change of the readings of each degree of freedom when the simulation takes half the step: what is
/// this small is the integrator's, not the machine's.
///
/// # Errors
/// When an engine does not take the robot.
pub fn discretisation(data: &Data, model: &Model) -> Result<Vec<f64>, EngineError> {
    changes(data, |trial, robot| {
        let robot = [robot.with(model)];
        Ok((
            predict(trial, &robot, data.finer)?,
            predict(trial, &robot, 2 * data.finer)?,
        ))
    })
}

/// The same when commands are given at other moments that the logs allow as well.
///
/// # Errors
/// When an engine does not take the robot.
pub fn timing(data: &Data, model: &Model) -> Result<Vec<f64>, EngineError> {
    if !data
        .trials
        .iter()
        .flat_map(|trial| &trial.told)
        .any(|told| told.otherwise.is_some())
    {
        return Ok(vec![0.0; data.weights.len()]);
    }
    changes(data, |trial, robot| {
        let robot = [robot.with(model)];
        let mut other = trial.clone();
        for told in &mut other.told {
            if let Some(otherwise) = told.otherwise.take() {
                told.command = otherwise;
            }
        }
        Ok((
            predict(trial, &robot, data.finer)?,
            predict(&other, &robot, data.finer)?,
        ))
    })
}

/// Root mean square difference between two predictions of the readings of each degree of freedom.
fn changes(
    data: &Data,
    both: impl Fn(&Trial, &Logged) -> Result<(Vec<f64>, Vec<f64>), EngineError>,
) -> Result<Vec<f64>, EngineError> {
    let dofs = data.weights.len();
    let (mut squares, mut count) = (vec![0.0; dofs], vec![0.0_f64; dofs]);
    for (trial, robot) in data.trials.iter().zip(&*data.robots) {
        let (one, other) = both(trial, robot)?;
        for ((a, b), reading) in one.iter().zip(&other).zip(&trial.readings) {
            squares[reading.dof] += (a - b).powi(2);
            count[reading.dof] += 1.0;
        }
    }
    let root = |(squares, count): (&f64, &f64)| (squares / count.max(1.0)).sqrt();
    Ok(squares.iter().zip(&count).map(root).collect())
}

/// Spread of logs that repeat each other, of each degree of freedom: root mean square deviation from their mean, where
/// the same robot got the same commands. `None` where no two logs do.
pub fn repeats(trials: &[Trial], d: usize) -> Option<f64> {
    // What walks freely does not repeat itself, whatever it is told.
    if trials.iter().any(|trial| trial.base.is_some()) {
        return None;
    }
    let (mut squares, mut count) = (0.0, 0.0);
    for (i, a) in trials.iter().enumerate() {
        for b in trials[i + 1..]
            .iter()
            .filter(|b| b.log != a.log && b.overrides == a.overrides)
        {
            let steps = a.steps.min(b.steps);
            if steps * 10 < a.steps.max(b.steps) * 9 || !alike(a, b, steps) {
                continue;
            }
            for k in 0..=steps {
                squares += 0.5 * (a.measured[d][k] - b.measured[d][k]).powi(2);
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| (squares / f64::max(count, 1.0)).sqrt())
}

/// Whether all joints got the same commands, to a hundredth of their range.
fn alike(a: &Trial, b: &Trial, steps: usize) -> bool {
    a.told.iter().zip(&b.told).all(|(a, b)| {
        let own = &a.command.mean[..=steps];
        let (low, high) = own.iter().fold((f64::MAX, f64::MIN), |(l, h), &c| (l.min(c), h.max(c)));
        let squares: f64 = own.iter().zip(&b.command.mean).map(|(a, b)| (a - b).powi(2)).sum();
        let same_power = a.enabled[..=steps]
            .iter()
            .zip(&b.enabled)
            .filter(|(a, b)| a != b)
            .count();
        (squares / (steps + 1) as f64).sqrt() <= 0.01 * (high - low) && same_power * 100 < steps
    })
}

#[cfg(test)]
mod tests {
    use omniwalk_env::random::Stream;

    use super::*;
    use crate::identify::trial::Reading;

    #[test]
    fn the_noise_of_readings_is_measured_without_bias() {
        let mut stream = Stream::new(3, 0, 0);
        let readings = (0..4000).map(|k| Reading {
            at: 5.0 * f64::from(k),
            dof: 0,
            position: (0.004 * f64::from(k)).sin() + stream.normal(1e-3),
            block: 0,
        });
        let trial = Trial {
            readings: readings.collect(),
            ..Trial::default()
        };
        // Some 1000 independent squares: their mean is known to 5 %, its root to 2.5 %.
        assert!((sensor(&[trial], 0) / 1e-3 - 1.0).abs() < 0.075);
    }

    #[test]
    fn stamps_of_the_same_step_are_no_noise() {
        let at = |k: u32| if k % 50 == 1 { f64::from(k - 1) } else { f64::from(k) };
        let reading = |k: u32| Reading {
            at: 5.0 * at(k),
            dof: 0,
            position: (0.004 * f64::from(k)).sin(),
            block: 0,
        };
        let trial = Trial {
            readings: (0..2000).map(reading).collect(),
            ..Trial::default()
        };
        let noise = sensor(&[trial], 0);
        assert!(noise.is_finite() && noise < 1e-4, "{noise}");
    }

    #[test]
    fn stamps_that_are_off_make_the_noise_of_fast_readings() {
        let mut stream = Stream::new(4, 0, 0);
        let at = |k: i32| 5.0 * f64::from(k);
        // Half of the time at rest, half of it at 4 rad/s (steps are milliseconds): stamps off by 0.2 ms are 0.8 mrad there.
        let path = |t: f64| 4e-3 * (t - at(2000)).max(0.0);
        let readings = (0..4000).map(|k| Reading {
            at: at(k),
            dof: 0,
            position: path(at(k) + stream.normal(0.2)) + stream.normal(3e-4),
            block: 0,
        });
        let trial = Trial {
            readings: readings.collect(),
            ..Trial::default()
        };
        let expected = (3e-4_f64.powi(2) + 0.5 * 8e-4_f64.powi(2)).sqrt();
        assert!((sensor(&[trial], 0) / expected - 1.0).abs() < 0.075);
    }

    #[test]
    fn a_cubic_is_smooth_and_noise_counts_in_full() {
        let cubic: Vec<(f64, f64)> = [0.0, 1.1, 1.9, 3.2, 4.0]
            .iter()
            .map(|&t: &f64| (t, 1.0 + t - 0.5 * t * t + 0.1 * t.powi(3)))
            .collect();
        assert!(roughness(&cubic) < 1e-20);
        // Alternating values of 1: for even times the weights are 1, -4, 6, -4, 1 over the root of 70.
        let noisy: Vec<(f64, f64)> = (0..5).map(|k| (f64::from(k), f64::from(1 - k % 2 * 2))).collect();
        assert!((roughness(&noisy) - 256.0 / 70.0).abs() < 1e-9);
    }
}
