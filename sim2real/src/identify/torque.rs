//! The residual as generalised torque: what a simulation lacks to follow the measurement, and what that depends on.
//!
//! A weak, critically damped spring pulls each joint of the simulation along the measured motion. What it has to pull
//! with, over time, is the torque the model lacks, slower than the spring's own time.

use omniwalk_env::effect::Variable;
use omniwalk_env::engine::EngineError;

use super::fit::Data;
use super::model::Model;
use super::past;
use super::rollout::Rollout;
use super::scales::Scales;
use super::trial::{DT, Trial};

/// Angular frequency of the spring, rad/s.
const FOLLOW: f64 = 40.0;
/// Steps between samples of the torque.
const EVERY: usize = 10;
/// Time over which the measured velocity is taken, steps.
const SLOPE: usize = 12;

/// A moment of a trial: the torque that one joint lacks, and everything it may depend on.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Trial it is from.
    pub trial: usize,
    /// Log that is of.
    pub log: usize,
    /// Block of time, over all trials.
    pub block: usize,
    /// Torque the model lacks, N m or N.
    pub torque: f64,
    /// Values of [`names`].
    pub values: Vec<f64>,
}

/// Index of the motor's torque among [`names`].
pub const MOTOR_TORQUE: usize = 3;
/// So many of [`names`], those of [`Variable::ALL`], are known to simulations too.
const SIMULATED: usize = Variable::ALL.len();

/// What the torque may depend on, in the order of [`Moment::values`].
pub fn names(trial: &Trial, dof: usize) -> Vec<String> {
    let own = Variable::ALL.map(|variable| variable.name().to_owned());
    let own = own.into_iter().chain(["acceleration".to_owned()]);
    let more = trial
        .conditions
        .iter()
        .filter(|(joint, _, _)| joint.is_none_or(|d| d == dof));
    own.chain(more.map(|(_, name, _)| name.clone())).collect()
}

/// The torque that every joint of `model` lacks in every trial, one list of moments a degree of freedom.
///
/// # Errors
/// When an engine does not take the robot.
pub fn lacking(data: &Data, model: &Model, scales: &Scales) -> Result<Vec<Vec<Moment>>, EngineError> {
    let dofs = data.weights.len();
    let mut out = vec![Vec::new(); dofs];
    for (t, trial) in data.trials.iter().enumerate() {
        let robot = [data.robots[t].with(model)];
        let mut rollout = Rollout::new(trial, &robot, DT)?;
        let mut readings = vec![0.0; dofs];
        let mut pulled = vec![0.0; dofs];
        let mut before = vec![0.0; dofs];
        let begin = trial.readings.first().map_or(0.0, |first| first.at);
        for step in 0..trial.steps {
            rollout.command(step, 0, 1);
            rollout.read(&mut readings);
            for d in 0..dofs {
                let measured = &trial.measured[d];
                let (a, b) = (step.saturating_sub(SLOPE), (step + SLOPE).min(trial.steps));
                let velocity = (measured[b] - measured[a]) / ((b - a) as f64 * DT);
                let inertia = scales.joints[d].inertia;
                let (engine, actuators) = rollout.parts();
                let moving = engine.joints().velocity[d];
                let spring = inertia * FOLLOW * FOLLOW * (measured[step] - readings[d]);
                let torque = spring + 2.0 * inertia * FOLLOW * (velocity - moving);
                actuators.set_outside(d, 0, torque);
                pulled[d] += torque;
                if step % EVERY == EVERY - 1 {
                    let share = pulled[d] / EVERY as f64;
                    pulled[d] = 0.0;
                    if step as f64 >= begin {
                        let motor = actuators.motor_torque(d, 0, engine.joints());
                        let own = [
                            engine.joints().position[d],
                            moving,
                            trial.told[d].command.mean[step],
                            motor,
                            trial.start + step as f64 * DT,
                            (moving - before[d]) / (EVERY as f64 * DT),
                        ];
                        let more = trial
                            .conditions
                            .iter()
                            .filter(|(joint, _, _)| joint.is_none_or(|j| j == d));
                        out[d].push(Moment {
                            trial: t,
                            log: trial.log,
                            block: data.first_block[t] + block_of(trial, step as f64),
                            torque: share,
                            values: own.into_iter().chain(more.map(|(_, _, at)| at[step])).collect(),
                        });
                    }
                    before[d] = moving;
                }
            }
            rollout.advance();
        }
    }
    Ok(out)
}

/// The trial's block that holds a step: that of the reading before it.
fn block_of(trial: &Trial, step: f64) -> usize {
    let next = trial.readings.partition_point(|reading| reading.at <= step);
    trial
        .readings
        .get(next.saturating_sub(1))
        .map_or(0, |reading| reading.block)
}

/// How the torque goes with one variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A function of it.
    Plain,
    /// A function of it against the direction of motion: friction that varies.
    Friction,
    /// What it was in the last 0.2 s.
    Past,
}

impl Form {
    /// What a function of the variable is multiplied with.
    fn factor(self, moment: &Moment, slow: f64) -> f64 {
        match self {
            Self::Plain | Self::Past => 1.0,
            Self::Friction => (moment.values[1] / slow).clamp(-1.0, 1.0),
        }
    }
}

/// What predicts the torque that is lacking.
#[derive(Clone, Debug)]
pub struct Dependence {
    /// Index of the variable in [`names`].
    pub variable: usize,
    /// How.
    pub form: Form,
    /// Share of the torque's square that it predicts on data left out, beside what was there before.
    pub gain: f64,
}

/// Fewest moments that tell what a torque depends on.
const FEWEST: usize = 200;
/// Points of a function's grid.
const KNOTS: usize = 12;
/// Least share of the square that a variable must predict to be named.
const LEAST: f64 = 0.05;
/// What simulations know is named before what is only measured (a load, say, that is the motor's torque) where it predicts this
/// share as much.
const NEARLY: f64 = 0.9;

/// The variables that predict the torque, in order, by how well piecewise linear functions of them predict blocks they
/// were not fitted to; where none does, the one whose past does. `fold` gives the fold of a block.
pub fn dependence(moments: &[Moment], fold: &dyn Fn(usize) -> usize, folds: usize) -> Vec<Dependence> {
    if moments.len() < FEWEST {
        return Vec::new();
    }
    let mut left: Vec<f64> = moments.iter().map(|m| m.torque).collect();
    let mut found: Vec<Dependence> = Vec::new();
    for _ in 0..3 {
        let next = of_now(moments, &left, &found, fold, folds);
        let Some((best, predicted)) = next.filter(|(best, _)| best.gain > LEAST) else {
            break;
        };
        left.iter_mut().zip(&predicted).for_each(|(a, b)| *a -= b);
        found.push(best);
    }
    if found.is_empty() {
        found.extend(of_past(moments, fold, folds));
    }
    found
}

/// The variable that alone predicts most of the torque, as it is now or by its past.
pub fn leading(moments: &[Moment], fold: &dyn Fn(usize) -> usize, folds: usize) -> Option<Dependence> {
    if moments.len() < FEWEST {
        return None;
    }
    let whole: Vec<f64> = moments.iter().map(|m| m.torque).collect();
    let now = of_now(moments, &whole, &[], fold, folds).map(|(now, _)| now);
    let both = now.into_iter().chain(of_past(moments, fold, folds));
    let best = both.max_by(|a, b| a.gain.total_cmp(&b.gain));
    best.filter(|best| best.gain > LEAST)
}

/// The variable that predicts most of what is `left` of the torque beside those that were `found`, and its predictions.
fn of_now(
    moments: &[Moment],
    left: &[f64],
    found: &[Dependence],
    fold: &dyn Fn(usize) -> usize,
    folds: usize,
) -> Option<(Dependence, Vec<f64>)> {
    let whole: f64 = moments.iter().map(|m| m.torque * m.torque).sum();
    let explained: f64 = found.iter().map(|f| f.gain).sum();
    let mut best: Option<(Dependence, Vec<f64>)> = None;
    for variable in 0..moments[0].values.len() {
        for form in [Form::Plain, Form::Friction] {
            if form == Form::Friction && variable == 1 || found.iter().any(|f| f.variable == variable && f.form == form)
            {
                continue;
            }
            let predicted = predict(moments, left, variable, form, fold, folds);
            let rest: f64 = left.iter().zip(&predicted).map(|(a, b)| (a - b).powi(2)).sum();
            let gain = 1.0 - explained - rest / whole;
            // Simulated variables come first.
            let ahead = |old: &Dependence| {
                let share = if variable >= SIMULATED && old.variable < SIMULATED {
                    NEARLY
                } else {
                    1.0
                };
                share * gain > old.gain
            };
            if best.as_ref().is_none_or(|(old, _)| ahead(old)) {
                best = Some((Dependence { variable, form, gain }, predicted));
            }
        }
    }
    best
}

/// The variable whose past predicts most of the torque, where no variable does as it is now.
fn of_past(moments: &[Moment], fold: &dyn Fn(usize) -> usize, folds: usize) -> Option<Dependence> {
    let whole: f64 = moments.iter().map(|m| m.torque * m.torque).sum();
    let of = |variable: usize| {
        let predicted = past::predict(moments, variable, fold, folds);
        let left = moments.iter().zip(&predicted).map(|(m, p)| (m.torque - p).powi(2));
        Dependence {
            variable,
            form: Form::Past,
            gain: 1.0 - left.sum::<f64>() / whole,
        }
    };
    let all = (0..moments[0].values.len()).map(of);
    let best = all.max_by(|a, b| a.gain.total_cmp(&b.gain));
    best.filter(|best| best.gain > LEAST)
}

/// Predictions of `left` by a piecewise linear function of one variable, each block by the function fitted without its fold.
fn predict(
    moments: &[Moment],
    left: &[f64],
    variable: usize,
    form: Form,
    fold: &dyn Fn(usize) -> usize,
    folds: usize,
) -> Vec<f64> {
    let knots = knots(moments, variable, KNOTS);
    if knots.len() < 2 {
        return vec![0.0; left.len()];
    }
    let slow = slow(moments);
    let factor = |m: &Moment| form.factor(m, slow);
    let weights: Vec<(usize, f64, f64)> = moments
        .iter()
        .map(|m| {
            let (i, s) = cell(&knots, m.values[variable]);
            (i, s, factor(m))
        })
        .collect();
    let mut out = vec![0.0; left.len()];
    for own in 0..folds {
        let train = (0..left.len()).filter(|&k| fold(moments[k].block) != own);
        let values = least_squares(knots.len(), train.map(|k| (weights[k], left[k])));
        for k in (0..left.len()).filter(|&k| fold(moments[k].block) == own) {
            let (i, s, f) = weights[k];
            out[k] = f * (values[i] + s * (values[i + 1] - values[i]));
        }
    }
    out
}

/// Speed from which on friction is that of motion, rad/s or m/s.
fn slow(moments: &[Moment]) -> f64 {
    0.02 * moments.iter().map(|m| m.values[1].abs()).fold(0.0, f64::max) + 1e-12
}

/// Grid of a variable: quantiles of its values.
pub(super) fn knots(moments: &[Moment], variable: usize, points: usize) -> Vec<f64> {
    let mut values: Vec<f64> = moments.iter().map(|m| m.values[variable]).collect();
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else {
        return Vec::new();
    };
    let mut knots: Vec<f64> = (0..points).map(|k| values[k * last / (points - 1)]).collect();
    let apart = 1e-6 * (values[last] - values[0]).abs() + 1e-12;
    knots.dedup_by(|a, b| (*a - *b).abs() <= apart);
    knots
}

fn cell(knots: &[f64], x: f64) -> (usize, f64) {
    let i = knots.partition_point(|&g| g <= x).clamp(1, knots.len() - 1) - 1;
    (i, ((x - knots[i]) / (knots[i + 1] - knots[i])).clamp(0.0, 1.0))
}

/// Values at the knots of the piecewise linear function that fits best; a tridiagonal system, held together by a weak
/// pull of neighbours towards each other.
fn least_squares(knots: usize, data: impl Iterator<Item = ((usize, f64, f64), f64)>) -> Vec<f64> {
    let (mut diagonal, mut off, mut right) = (vec![0.0; knots], vec![0.0; knots], vec![0.0; knots]);
    let mut count = 0.0;
    for ((i, s, f), y) in data {
        let (a, b) = (f * (1.0 - s), f * s);
        diagonal[i] += a * a;
        diagonal[i + 1] += b * b;
        off[i] += a * b;
        right[i] += a * y;
        right[i + 1] += b * y;
        count += 1.0;
    }
    let pull = 1e-3 * f64::max(count, 1.0) / knots as f64;
    for i in 0..knots {
        let neighbours = usize::from(i > 0) + usize::from(i + 1 < knots);
        diagonal[i] += pull * neighbours as f64 + 1e-9 * count;
        if i + 1 < knots {
            off[i] -= pull;
        }
    }
    for i in 1..knots {
        let share = off[i - 1] / diagonal[i - 1];
        diagonal[i] -= share * off[i - 1];
        right[i] -= share * right[i - 1];
    }
    for i in (0..knots).rev() {
        let next = if i + 1 < knots { off[i] * right[i + 1] } else { 0.0 };
        right[i] = (right[i] - next) / diagonal[i];
    }
    right
}

/// Every variable that simulations know, and every way in which torque can go with it.
pub fn simulated() -> impl Iterator<Item = (usize, Form)> {
    let both = (0..SIMULATED).flat_map(|variable| [Form::Plain, Form::Friction].map(|form| (variable, form)));
    both.filter(|&(variable, form)| (Variable::ALL[variable], form) != (Variable::Velocity, Form::Friction))
}

/// Autocorrelation of `values` at the first lag that is at least `lag` samples; near zero for noise.
pub fn autocorrelation(values: &[f64], lag: usize) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let centred: Vec<f64> = values.iter().map(|v| v - mean).collect();
    let power: f64 = centred.iter().map(|v| v * v).sum();
    let shifted: f64 = centred.iter().zip(centred.iter().skip(lag)).map(|(a, b)| a * b).sum();
    if power > 0.0 { shifted / power } else { 0.0 }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn moments(torque: impl Fn(f64, f64) -> f64) -> Vec<Moment> {
        let at = |k: usize| {
            let (q, v) = ((0.013 * k as f64).sin(), (0.0371 * k as f64).cos());
            Moment {
                trial: 0,
                log: 0,
                block: k / 100,
                torque: torque(q, v),
                values: vec![q, v, 0.0, 0.0, 0.0, k as f64],
            }
        };
        (0..4000).map(at).collect()
    }

    #[test]
    fn without_moments_there_is_nothing_to_depend_on() {
        assert!(knots(&[], 0, 5).is_empty());
        assert!(dependence(&[], &|b| b % 4, 4).is_empty());
    }

    #[test]
    fn the_variable_that_makes_the_torque_is_found() {
        let found = dependence(&moments(|q, _| (4.0 * q).sin()), &|b| b % 4, 4);
        assert_eq!((found[0].variable, found[0].form), (0, Form::Plain));
        assert!(found[0].gain > 0.9);
        let found = dependence(&moments(|q, v| q * v.signum()), &|b| b % 4, 4);
        assert_eq!((found[0].variable, found[0].form), (0, Form::Friction));
    }

    #[test]
    fn the_past_of_a_variable_leads_where_it_predicts_more_than_any_does_now() {
        let late = |k: usize| (0.013 * k.saturating_sub(8) as f64).sin() + (0.19 * k.saturating_sub(8) as f64).sin();
        let mut all = moments(|_, _| 0.0);
        for (k, moment) in all.iter_mut().enumerate() {
            moment.values[0] = late(k + 8);
            moment.torque = late(k);
        }
        let found = leading(&all, &|b| b % 4, 4).expect("a variable");
        assert_eq!((found.variable, found.form), (0, Form::Past));
        let now = leading(&moments(|q, _| (4.0 * q).sin()), &|b| b % 4, 4).expect("a variable");
        assert_eq!((now.variable, now.form), (0, Form::Plain));
        let noise = |q: f64, v: f64| ((q * 12_345.678 + v * 98_765.432).sin() * 43_758.545).fract();
        assert!(leading(&moments(noise), &|b| b % 4, 4).is_none());
    }

    #[test]
    fn noise_depends_on_nothing() {
        let noise = |q: f64, v: f64| ((q * 12_345.678 + v * 98_765.432).sin() * 43_758.545).fract();
        assert!(dependence(&moments(noise), &|b| b % 4, 4).is_empty());
    }
}
