//! Noise or structure: what the residual of a model depends on.

use omniwalk_env::effect::{Kind, Table};
use omniwalk_env::engine::EngineError;

use super::candidates::Ripples;
use super::cross::{Folds, robust};
use super::fit::{Data, Loss, total};
use super::floor::Floor;
use super::found::sums;
use super::model::{Model, Term};
use super::noise;
use super::scales::Scales;
use super::select::{Selection, is_above};
use super::torque::{self, Dependence, Moment};

/// Starts of a ripple's fit.
const RIPPLES: usize = 3;
/// Beside accepted effects, structure is more than this share of what the re-tuned model leaves above the floor: a quarter of the error.
const SHARE_LEFT: f64 = 0.0625;
/// Beyond so many times the floor's square something is missing even where nothing predicts it.
const FAR_ABOVE: f64 = 9.0;
/// Autocorrelation over 0.1 s from which on what is so far above the floor is no noise, however much effects took.
const COLOURED: f64 = 0.25;
/// A physics step is too coarse to report with when half of it changes more than this share of the residual: values would
/// be off by as much as noise lets them be known.
pub const COARSE: f64 = 0.1;
/// The same to choose with: the integrator then makes a tenth of the squared residual, and the floor knows.
pub const TOO_COARSE: f64 = 0.3;
/// Points of a measured table: what is smooth is known better with few, what repeats within the range needs many.
const GRIDS: [usize; 2] = [torque::KNOTS, 4 * torque::KNOTS];
/// Least fall of the loss by a measured table.
const WORTH: f64 = 0.05;
/// One over the root mean square residual of each degree of freedom under `model`.
pub fn weights(data: &Data, model: &Model) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0_f64); data.weights.len()];
    for (trial, residuals) in data.trials.iter().zip(data.residuals(model)) {
        for (reading, r) in trial.readings.iter().zip(residuals).filter(|(_, r)| r.is_finite()) {
            sums[reading.dof].0 += r * r;
            sums[reading.dof].1 += 1.0;
        }
    }
    let weight = |(squares, count): (f64, f64)| if squares > 0.0 { (count / squares).sqrt() } else { 1.0 };
    sums.into_iter().map(weight).collect()
}

/// Whether half the physics step changes any joint's readings by more than `share` of what `model` leaves: what is then
/// fitted would be the integrator.
///
/// # Errors
/// When an engine does not take the robot.
pub fn is_coarse(data: &Data, model: &Model, share: f64) -> Result<bool, EngineError> {
    let left = weights(data, model);
    let changes = noise::discretisation(data, model)?;
    Ok(changes.iter().zip(left).any(|(change, weight)| change * weight > share))
}

/// Weighted root mean square residual.
pub fn root(data: &Data, model: &Model) -> f64 {
    let losses = &data.losses(std::slice::from_ref(model))[0];
    (total(losses) / losses.iter().map(|l| l.count).sum::<f64>().max(1.0)).sqrt()
}

/// Frequencies at which what `model` lacks repeats over position.
pub fn ripples(data: &Data, model: &Model, scales: &Scales) -> Ripples {
    let Ok(moments) = torque::lacking(data, model, scales) else {
        return vec![Vec::new(); data.weights.len()];
    };
    let of = |(d, own): (usize, &Vec<Moment>)| torque::ripples(own, scales.joints[d].position, RIPPLES);
    moments.iter().enumerate().map(of).collect()
}

/// What is left of one joint's torque.
pub struct Left {
    /// Degree of freedom.
    pub dof: usize,
    /// The torque over time.
    pub moments: Vec<Moment>,
    /// Names of what it may depend on.
    pub names: Vec<String>,
    /// What it depends on, in order.
    pub depends_on: Vec<Dependence>,
    /// A table of it, where simulations can have one and it helps.
    pub table: Option<Table>,
    /// Whether it is structure: more than noise, and predicted or far more.
    pub structured: bool,
    losses: Losses,
}

/// What the last model leaves.
pub struct Leftover {
    /// Every joint.
    pub joints: Vec<Left>,
    /// Autocorrelation of the residual over 0.1 s, by degree of freedom.
    pub autocorrelation: Vec<f64>,
    /// The last model with the tables.
    pub model: Model,
}

/// Weighted losses of a joint, or of several.
#[derive(Clone, Copy, Default)]
struct Losses {
    /// Of the re-tuned model.
    refit: f64,
    /// Of the last model.
    last: f64,
    /// What noise leaves.
    floor: f64,
    /// What is too little beyond that.
    negligible: f64,
}

impl Losses {
    /// By degree of freedom; of a robot on the ground all are one, as its ground is in all of them.
    ///
    /// They are those of the fits, not of predictions: where joints stick, those of blocks that were left out are as bad as one likes.
    fn by_dof(data: &Data, selection: &Selection, floor: &Floor) -> Vec<Self> {
        let [refit, last] = [&selection.refit, &selection.last].map(|fit| squares(data, &fit.model));
        let (own, negligible) = (floor.squares(data), floor.negligible_squares(data));
        let of = |d: usize| Self {
            refit: refit[d],
            last: last[d],
            floor: own[d],
            negligible: negligible[d],
        };
        let dofs = data.weights.len();
        let own: Vec<Self> = (0..dofs).map(of).collect();
        if data.is_free() {
            return vec![own.into_iter().fold(Self::default(), Self::and); dofs];
        }
        own
    }

    /// With those of other joints.
    fn and(self, other: Self) -> Self {
        Self {
            refit: self.refit + other.refit,
            last: self.last + other.last,
            floor: self.floor + other.floor,
            negligible: self.negligible + other.negligible,
        }
    }

    /// Share of the re-tuned model's loss above the floor that is left.
    fn share_left(&self) -> f64 {
        let gap = (self.refit - self.floor).max(1e-12 * self.refit);
        ((self.last - self.floor) / gap).clamp(0.0, 1.0)
    }

    /// Share of the last model's loss that noise does not explain, and no more than is left of what there was to explain.
    fn fraction(&self) -> f64 {
        if self.last <= 0.0 {
            return 0.0;
        }
        ((self.last - self.floor) / self.last)
            .clamp(0.0, 1.0)
            .min(self.share_left())
    }

    /// Whether more is left than noise and, `beside` effects, than a trifle of what there was to explain, and either something predicts
    /// it or it is far more; far more that is not white over time is no trifle.
    fn is_structure(&self, beside: bool, predicted: bool, autocorrelation: f64) -> bool {
        let far = self.last > FAR_ABOVE * self.floor;
        is_above(self.last, self.floor, self.negligible)
            && (!beside || self.share_left() > SHARE_LEFT || far && autocorrelation > COLOURED)
            && (predicted || far)
    }
}

/// Weighted sum of squared residuals of each degree of freedom under `model`.
pub fn squares(data: &Data, model: &Model) -> Vec<f64> {
    let mut sums = vec![0.0; data.weights.len()];
    for (trial, residuals) in data.trials.iter().zip(data.residuals(model)) {
        for (reading, r) in trial.readings.iter().zip(residuals) {
            sums[reading.dof] += (data.weights[reading.dof] * r).powi(2);
        }
    }
    sums
}

impl Leftover {
    /// The joints of which structure is left.
    pub fn structured(&self) -> impl Iterator<Item = &Left> {
        self.joints.iter().filter(|left| left.structured)
    }

    /// Share of the last model's loss at these joints that noise does not explain, and no more than is left of what there was to explain.
    pub fn fraction(&self) -> f64 {
        let losses = self.structured().map(|left| left.losses);
        losses.fold(Losses::default(), Losses::and).fraction()
    }

    /// With what is left of other joints.
    pub fn and(self, other: Self) -> Self {
        let mut joints = self.joints;
        joints.extend(other.joints);
        joints.sort_by_key(|left| left.dof);
        Self {
            joints,
            autocorrelation: sums(&self.autocorrelation, &other.autocorrelation),
            model: self.model.and(&other.model),
        }
    }
}

/// Examines what the last model leaves.
///
/// # Errors
/// When an engine does not take the robot.
pub fn leftover(
    data: &Data,
    selection: &Selection,
    scales: &Scales,
    folds: &Folds,
    floor: &Floor,
) -> Result<Leftover, EngineError> {
    let model = &selection.last.model;
    let losses = Losses::by_dof(data, selection, floor);
    let fold = |block: usize| folds.of_block[block];
    let autocorrelation = autocorrelations(data, model);
    let mut joints = Vec::new();
    for (dof, moments) in torque::lacking(data, model, scales)?.into_iter().enumerate() {
        let depends_on = torque::dependence(&moments, &fold, folds.count);
        joints.push(Left {
            dof,
            structured: losses[dof].is_structure(!model.terms.is_empty(), !depends_on.is_empty(), autocorrelation[dof]),
            losses: losses[dof],
            depends_on,
            names: torque::names(&data.trials[0], dof),
            moments,
            table: None,
        });
    }
    let mut with = model.clone();
    add_tables(data, folds, &mut with, &mut joints);
    Ok(Leftover {
        autocorrelation,
        joints,
        model: with,
    })
}

/// Gives every joint of which structure is left a table of the torque it lacks, over what simulations know of what that depends on,
/// where that helps rollouts of blocks the table was not made from.
fn add_tables(data: &Data, folds: &Folds, model: &mut Model, joints: &mut [Left]) {
    let fold = |block: usize| folds.of_block[block];
    for left in joints.iter_mut().filter(|left| left.structured) {
        let known = torque::simulated_dependence(&left.moments, &fold, folds.count);
        let before = total(&robust(data, data.cells(std::slice::from_ref(model)).swap_remove(0)));
        let tables = tables(data, folds, model, (left.dof, &left.moments), &known).into_iter();
        let best = tables.min_by(|a, b| total(&a.1).total_cmp(&total(&b.1)));
        if let Some((table, _)) = best.filter(|(_, cross)| total(cross) < (1.0 - WORTH) * before) {
            *model = with_table(model, left.dof, &table);
            left.table = Some(table);
        }
    }
}

/// Tables of the `moments` of a joint over each of the variables `known`, coarse and fine, with the losses of every block by one that was made without
/// its fold. None where some fold allows of no table.
pub fn tables(
    data: &Data,
    folds: &Folds,
    model: &Model,
    (dof, moments): (usize, &[Moment]),
    known: &[Dependence],
) -> Vec<(Table, Vec<Loss>)> {
    let fold = |block: usize| folds.of_block[block];
    let shapes: Vec<(&Dependence, usize)> = known.iter().flat_map(|d| GRIDS.map(|points| (d, points))).collect();
    let shapes = &shapes;
    let without = |own: usize| {
        let table = move |&(leading, points): &(&Dependence, usize)| {
            torque::table(moments, leading, points, &|b| fold(b) != own)
        };
        shapes.iter().map(table)
    };
    let left_out: Option<Vec<Table>> = (0..folds.count).flat_map(without).collect();
    let whole = shapes
        .iter()
        .map(|&(leading, points)| torque::table(moments, leading, points, &|_| true));
    let (Some(left_out), Some(whole)) = (left_out, whole.collect::<Option<Vec<_>>>()) else {
        return Vec::new();
    };
    let models: Vec<Model> = left_out.iter().map(|table| with_table(model, dof, table)).collect();
    let (dofs, losses) = (data.weights.len(), data.cells(&models));
    let of = |k: usize, b: usize| &losses[fold(b) * shapes.len() + k][b * dofs..(b + 1) * dofs];
    let cross = |k: usize| robust(data, (0..data.blocks).flat_map(|b| of(k, b).to_vec()).collect());
    whole
        .into_iter()
        .enumerate()
        .map(|(k, table)| (table, cross(k)))
        .collect()
}

/// `model` with a table of torque on a joint.
fn with_table(model: &Model, dof: usize, table: &Table) -> Model {
    let mut with = model.clone();
    with.terms.push(Term {
        kind: Kind::ResidualTorque,
        target: dof,
        values: Vec::new(),
        free: Vec::new(),
        table: Some(table.clone()),
        held: false,
    });
    with
}

fn autocorrelations(data: &Data, model: &Model) -> Vec<f64> {
    let residuals = data.residuals(model);
    let of = |d: usize| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (trial, own) in data.trials.iter().zip(&residuals) {
            let readings = trial.readings.iter().zip(own).filter(|(r, _)| r.dof == d);
            let values: Vec<f64> = readings.map(|(_, r)| *r).collect();
            let rate = values.len() as f64 / (trial.steps as f64 * super::trial::DT).max(1e-9);
            let lag = ((0.1 * rate).round() as usize).max(1);
            sum += torque::autocorrelation(&values, lag) * values.len() as f64;
            weight += values.len() as f64;
        }
        sum / f64::max(weight, 1.0)
    };
    (0..data.weights.len()).map(of).collect()
}
