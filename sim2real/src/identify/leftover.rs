//! Noise or structure: what the residual of a model depends on.

use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::Robot;

use super::bent;
use super::candidates::Ripples;
use super::fit::{Data, total};
use super::floor::Floor;
use super::found::sums;
use super::lacking::Lacking;
use super::model::{Model, Term, joint_of};
use super::noise;
use super::ripples;
use super::scales::Scales;
use super::select::{Selection, Selector, Tabled, is_above};
use super::torque::{self, Dependence, Moment};

/// Starts of a ripple's fit.
const RIPPLES: usize = 3;
/// Beside accepted effects, structure is more than this share of what the re-tuned model leaves above the floor: a quarter of the error.
const SHARE_LEFT: f64 = 0.0625;
/// Effects that leave more than this share explain less than half: something is missing even where nothing predicts it.
const MOST_LEFT: f64 = 0.5;
/// Beyond so many times the floor's square something is missing even where nothing predicts it.
const FAR_ABOVE: f64 = 6.25;
/// Autocorrelation over 0.1 s from which on what is so far above the floor is no noise, however much effects took.
const COLOURED: f64 = 0.25;
/// A physics step is too coarse to report with when half of it changes more than this share of the residual: values would
/// be off by as much as noise lets them be known.
pub const COARSE: f64 = 0.1;
/// The same to choose with: the integrator then makes a tenth of the squared residual, and the floor knows.
pub const TOO_COARSE: f64 = 0.3;
/// Most variables that are named of a joint.
const NAMED: usize = 3;

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
    let of = |(d, own): (usize, &Vec<Moment>)| ripples::ripples(own, scales.joints[d].position, RIPPLES);
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
    /// What the torque that the nominal robot lacks depends on, where that says more.
    pub leading: Option<Dependence>,
    /// Whether it is structure: more than noise, and predicted or far more.
    pub structured: bool,
    /// Squared error beyond what noise leaves, in units of that: what joints are compared by.
    pub above_floor: f64,
    losses: Losses,
}

impl Left {
    /// For the report, of a joint of `robot`.
    pub fn lacking(&self, robot: &Robot) -> Lacking {
        let name = &robot.dof(self.dof).name;
        Lacking::new(name, self.names.clone(), self.moments.clone(), &self.depends_on)
    }
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
    /// By degree of freedom.
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
        (0..data.weights.len()).map(of).collect()
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

    /// Share of the last model's loss that noise does not explain.
    fn above(&self) -> f64 {
        if self.last <= 0.0 {
            return 0.0;
        }
        ((self.last - self.floor) / self.last).clamp(0.0, 1.0)
    }

    /// The same, and no more than is left of what there was to explain.
    fn fraction(&self) -> f64 {
        self.above().min(self.share_left())
    }

    /// Whether more is left than noise and, `beside` effects, than a trifle of what there was to explain; far more that is not white over
    /// time is no trifle.
    fn is_much(&self, beside: bool, autocorrelation: f64) -> bool {
        is_above(self.last, self.floor, self.negligible)
            && (!beside || self.share_left() > SHARE_LEFT || self.is_far() && autocorrelation.abs() > COLOURED)
    }

    /// Whether something is missing even where nothing predicts it.
    fn is_far(&self) -> bool {
        self.last > FAR_ABOVE * self.floor
    }
}

/// The degrees of freedom of which more is left than noise and a trifle.
pub fn open(data: &Data, selection: &Selection, floor: &Floor) -> Vec<usize> {
    let autocorrelation = autocorrelations(data, &selection.last.model);
    let beside = !selection.last.model.terms.is_empty();
    let losses = Losses::by_dof(data, selection, floor);
    let much = |d: &usize| losses[*d].is_much(beside, autocorrelation[*d]);
    (0..losses.len()).filter(much).collect()
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
pub fn leftover(selector: &Selector<'_>, selection: &Selection, floor: &Floor) -> Result<Leftover, EngineError> {
    let (data, folds, model) = (selector.data, selector.folds, &selection.last.model);
    let losses = Losses::by_dof(data, selection, floor);
    let fold = |block: usize| folds.of_block[block];
    let has_effect = |dof: usize| {
        let on = |term: &Term| joint_of(selector.robot, term.kind.info().site, term.target);
        model.terms.iter().any(|term| on(term) == Some(dof))
    };
    let open = open(data, selection, floor);
    let above = squares(data, model).into_iter().zip(floor.squares(data));
    let above: Vec<f64> = above.map(|(left, floor)| ((left - floor) / floor).max(0.0)).collect();
    let mut with = model.clone();
    let mut joints = Vec::new();
    for (dof, moments) in torque::lacking(data, model, selector.scales)?.into_iter().enumerate() {
        let mut depends_on = torque::dependence(&moments, &fold, folds.count);
        let (own, is_open) = (losses[dof], open.contains(&dof));
        let table = is_open
            .then(|| selector.table(&selection.last, dof, &moments))
            .flatten();
        if let Some(table) = &table {
            lead(&mut depends_on, table);
            with.take_joint(dof, &table.model);
        }
        let most = has_effect(dof) && own.share_left() > MOST_LEFT;
        let structured = is_open && (!depends_on.is_empty() || own.is_far() || most);
        joints.push(Left {
            dof,
            structured,
            above_floor: above[dof],
            losses: own,
            depends_on,
            leading: None,
            names: torque::names(&data.trials[0], dof),
            moments,
        });
    }
    let may_be_bent = |left: &Left| left.structured && !data.is_free() && !has_effect(left.dof);
    let untold = |left: &Left| may_be_bent(left) && bent::is_untold(&left.depends_on, left.losses.above());
    if joints.iter().any(untold) {
        let lacks = bent::lacking(selector, model)?;
        for left in joints.iter_mut().filter(|left| untold(left)) {
            left.leading = bent::leading(folds, &lacks[left.dof], &left.depends_on);
        }
    }
    Ok(Leftover {
        autocorrelation: autocorrelations(data, model),
        joints,
        model: with,
    })
}

/// Puts the variable of a `table`, which rollouts tell, among those that predict the torque of moments, by what share each takes.
fn lead(depends_on: &mut Vec<Dependence>, table: &Tabled) {
    let (variable, form) = table.over;
    depends_on.retain(|other| other.variable != variable);
    depends_on.push(Dependence {
        variable,
        form,
        gain: table.share(),
    });
    depends_on.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    depends_on.truncate(NAMED);
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
