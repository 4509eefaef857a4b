//! Step by step (`step`) from the re-tuned nominal model to the effects the data ask for.
//!
//! In a step every effect that the model lacks (of a robot with many joints: those that may take most to first order, `screen`) is
//! fitted beside what it has and judged by cross-validation. The best is taken when it falls significantly (corrected for the number tried) and by more than a trifle, or a pair where no
//! single one does; then what earlier steps took is tried without (`settle`). At the end each effect is exchanged for every other: what
//! predicts as well cannot be told apart with these logs.

mod curve;
mod doubtful;
mod fits;
mod settle;
mod step;
mod tables;
mod together;
mod untold;
mod worth;

pub use tables::Tabled;
pub use worth::is_above;

use omniwalk_env::effect::{Kind, Site};
use omniwalk_env::robot::Robot;

use super::candidates::{self, Candidate};
use super::cross::Folds;
use super::fit::{Data, Fit, Loss, total};
use super::floor::Floor;
use super::gain::Gain;
use super::leftover::{self, TOO_COARSE};
use super::model::{Model, Term};
use super::scales::Scales;
use super::screen;
use step::Stage;

/// Share of what the best effect takes of the loss from which on another may stand for it.
const RIVAL: f64 = 0.25;
/// Most effects.
const MOST: usize = 8;
/// Where a fit is so much of its loss above what it could be, it has ended in a lesser minimum.
pub const LESSER: f64 = 0.02;
/// Singles of which pairs are made.
const PAIRED: usize = 5;
/// Effects that are fitted in a step where there are many: those that may take most.
const FITTED: usize = 8;

/// An effect that was tried and not taken.
#[derive(Clone, Debug)]
pub struct Rejected {
    /// Which.
    pub kind: Kind,
    /// Where.
    pub target: usize,
    /// What it gained in the last step it was tried in.
    pub gain: Gain,
    /// Largest share of the loss it took in any step.
    pub most: f64,
    /// Share of the loss it would take to first order or of rough data, where that was too little for a fit to the end in the
    /// last step.
    pub at_best: Option<f64>,
    /// Why not.
    pub reason: String,
}

/// Effects that predict the same with these logs.
#[derive(Clone, Debug)]
pub struct Alike {
    /// The one that is in the model.
    pub chosen: (Kind, usize),
    /// The others.
    pub others: Vec<(Kind, usize)>,
    /// The models with those in its place.
    pub models: Vec<Model>,
    /// The numbers that those have there.
    pub values: Vec<Vec<f64>>,
}

/// What the steps led to.
pub struct Selection {
    /// The nominal model re-tuned.
    pub refit: Fit,
    /// The last model.
    pub last: Fit,
    /// Probability by chance of each effect's gain beside the others, in the order of the model's terms, corrected for the
    /// number of effects tried.
    pub p_values: Vec<f64>,
    /// What was not taken.
    pub rejected: Vec<Rejected>,
    /// What cannot be told apart.
    pub alike: Vec<Alike>,
    /// Effects tried in the largest step.
    pub tried: usize,
    /// Among how many each effect that was taken was the best.
    pub counts: Vec<Count>,
    /// Largest share of the loss that an effect took in any step.
    pub best: f64,
}

impl Selection {
    /// What may stand for an effect of the model: what it has, what predicts as well as one of those, and what in some step took a good part of
    /// what the best took.
    pub fn rivals(&self) -> Vec<(Kind, usize)> {
        let best = self.rejected.iter().map(|r| r.most).fold(self.best, f64::max);
        let good = self.rejected.iter().filter(|r| r.most >= RIVAL * best);
        let own = self.last.model.terms.iter().map(|term| (term.kind, term.target));
        let alike = self.alike.iter().flat_map(|alike| &alike.others).copied();
        good.map(|r| (r.kind, r.target)).chain(own).chain(alike).collect()
    }

    /// With what an `earlier` selection, from whose effects this one went on, did not take.
    pub fn after(mut self, earlier: Self) -> Self {
        let known = |r: &Rejected| {
            self.rejected
                .iter()
                .any(|own| (own.kind, own.target) == (r.kind, r.target))
        };
        let taken = |r: &Rejected| self.last.model.has(r.kind, r.target);
        let more: Vec<Rejected> = earlier
            .rejected
            .into_iter()
            .filter(|r| !known(r) && !taken(r))
            .collect();
        self.rejected.extend(more);
        self.tried = self.tried.max(earlier.tried);
        self
    }

    /// Notes that `own` is in the model no more, and why; without a reason where it is in a set with one that is.
    fn note_gone(&mut self, (kind, target): (Kind, usize), reason: &str) {
        self.rejected.push(Rejected {
            kind,
            target,
            gain: Gain::NONE,
            most: 0.0,
            at_best: None,
            reason: reason.to_owned(),
        });
    }

    /// Takes out the effects of which `out` says so, and the sets that they stand for; `without` is the fit to the others.
    fn take_out(&mut self, out: &dyn Fn(&Term) -> bool, without: Fit, reason: &str) {
        let terms = std::mem::replace(&mut self.last, without).model.terms;
        let mut kept = terms.iter().map(|term| !out(term));
        self.p_values.retain(|_| kept.next().unwrap_or(true));
        for Term { kind, target, .. } in terms.iter().filter(|term| out(term)) {
            self.alike.retain(|alike| alike.chosen != (*kind, *target));
            self.note_gone((*kind, *target), reason);
        }
    }
}

/// What a selection works with.
pub struct Selector<'a> {
    /// The nominal robot.
    pub robot: &'a Robot,
    /// Logs to fit.
    pub data: &'a Data,
    /// Typical values.
    pub scales: &'a Scales,
    /// Folds of the cross-validation.
    pub folds: &'a Folds,
    /// Those of tables: logs.
    pub logs: Folds,
    /// Weighted loss that noise and the integrator leave.
    pub floor: f64,
    /// The same by degree of freedom.
    pub floors: Vec<f64>,
    /// Weighted loss beyond the floor that is too little for an effect to be missing, by degree of freedom.
    pub negligible: Vec<f64>,
    /// Effects that may take another's place; all when `None`.
    pub rivals: Option<&'a [(Kind, usize)]>,
    /// Limbs that are looked at alike, this among them: an effect is the best of those of all of them.
    pub limbs: usize,
    /// Among how many each effect was chosen that is there from the beginning.
    pub counts: &'a [Count],
}

/// An effect on a degree of freedom or link, and among how many it was the best.
pub type Count = ((Kind, usize), usize);

/// A fit with its cross-validated loss.
#[derive(Clone)]
struct Judged {
    fit: Fit,
    cross: Vec<Loss>,
}

/// Of a candidate: judged, or, where it was left on the way, the share of the loss that it takes.
type Attempted = Result<Judged, f64>;

/// Effects of a model with the numbers that are fitted, in a fixed order.
type Terms = Vec<(&'static str, usize, Vec<usize>)>;

fn terms(model: &Model) -> Terms {
    let own = model
        .terms
        .iter()
        .map(|term| (term.kind.id(), term.target, term.free.clone()));
    let mut own: Terms = own.collect();
    own.sort_unstable();
    own
}

/// Where the steps are.
struct Steps {
    now: Judged,
    rejected: Vec<Rejected>,
    /// Effects tried in the largest step.
    most: usize,
    /// Effects among which each that was taken was the best.
    counts: Vec<Count>,
    /// What was fitted already, by the effects it has.
    known: Vec<(Terms, Judged)>,
    /// What was tried already, by the effects it was tried beside.
    tried: Vec<(Terms, (Kind, usize, usize), Attempted)>,
}

impl<'a> Selector<'a> {
    /// Of `data`, whose `floor` is known; every effect may take another's place.
    pub fn new(robot: &'a Robot, data: &'a Data, scales: &'a Scales, folds: &'a Folds, floor: &Floor) -> Self {
        let floors = floor.squares(data);
        Self {
            robot,
            data,
            scales,
            folds,
            logs: folds.of_logs(data),
            floor: floors.iter().sum(),
            floors,
            negligible: floor.negligible_squares(data),
            rivals: None,
            limbs: 1,
            counts: &[],
        }
    }

    /// Whether `model` cannot be judged at this physics step: steps then end.
    fn is_coarse(&self, model: &Model) -> bool {
        // An engine that simulated all of them before does so now.
        let coarse = || leftover::is_coarse(self.data, model, TOO_COARSE).unwrap_or(false);
        self.data.finer == 1 && !self.data.is_free() && coarse()
    }

    /// Runs all steps from the re-tuned `nominal` with the effects of `first`; `log` hears of progress.
    pub fn run(&self, nominal: &Model, first: &[Term], log: &dyn Fn(&str)) -> Selection {
        let refit = self.fit(nominal);
        let mut steps = Steps {
            now: refit.clone(),
            rejected: Vec::new(),
            most: 0,
            counts: self.counts.to_vec(),
            known: vec![(Terms::new(), refit.clone())],
            tried: Vec::new(),
        };
        if !first.is_empty() {
            let mut model = refit.fit.model.clone();
            model.terms.extend_from_slice(first);
            steps.now = self.fit_near(&model);
            self.drop_needless(&mut steps);
            self.refine(&mut steps);
        }
        // Everything else leans on when things happened, and where. What was taken and proved needless once would be taken again.
        let mut been = vec![terms(&steps.now.fit.model)];
        for stage in [Stage::Readings, Stage::All] {
            while steps.now.fit.model.terms.len() < MOST
                && self.above_floor(&steps.now.fit).contains(&true)
                && !self.is_coarse(&steps.now.fit.model)
            {
                if !self.step(&mut steps, stage) {
                    break;
                }
                let here = terms(&steps.now.fit.model);
                if been.contains(&here) {
                    break;
                }
                been.push(here);
                let names = steps.now.fit.model.terms.iter().map(|term| term.kind.id());
                log(&format!(
                    "loss {:.1}: {}",
                    total(&steps.now.cross),
                    names.collect::<Vec<_>>().join(" + ")
                ));
            }
        }
        if !steps.now.fit.model.terms.is_empty() {
            log("no more effects; next: whether one explains what two do, and what could take the place of each");
        }
        self.merge(&mut steps);
        let curves = self.undo_curves(&mut steps);
        let alike = self.exchange(&mut steps);
        let p_values = self.p_values(&mut steps);
        if self.data.is_free() && !steps.now.fit.model.terms.is_empty() {
            steps.now = self.fit(&steps.now.fit.model);
        }
        let most_taken = steps.rejected.iter().map(|r| r.most).fold(0.0, f64::max);
        let tried = steps.most * self.limbs;
        let Steps {
            now,
            mut rejected,
            counts,
            ..
        } = steps;
        for rejected in &mut rejected {
            rejected.reason = match rejected.at_best {
                _ if curves.contains(&(rejected.kind, rejected.target)) => {
                    "one of several that together are a curve over position".to_owned()
                }
                Some(share) => format!(
                    "not fitted to the end: takes about {:.1} % with re-tuning, others more",
                    100.0 * share
                ),
                None => self.reason(&rejected.gain, tried),
            };
        }
        rejected.retain(|r| !now.fit.model.has(r.kind, r.target));
        Selection {
            refit: refit.fit,
            last: now.fit,
            p_values,
            rejected,
            alike,
            tried,
            counts,
            best: most_taken,
        }
    }

    /// What may be tried beside `model`.
    fn candidates(&self, model: &Model) -> Vec<Candidate> {
        let found = leftover::ripples(self.data, model, self.scales);
        candidates::all(self.robot, self.data, model, self.scales, &found)
    }

    /// What may take the place of `terms` beside `model`.
    fn rivals(&self, model: &Model, terms: &[&Term]) -> Vec<Candidate> {
        let mut candidates = self.candidates(model);
        let own = |c: &Candidate| terms.iter().any(|term| (term.kind, term.target) == (c.kind, c.target));
        let worth = |c: &Candidate| self.rivals.is_none_or(|rivals| rivals.contains(&(c.kind, c.target)));
        candidates.retain(|candidate| !own(candidate) && worth(candidate));
        self.promising(model, candidates).0
    }

    /// Those of `candidates` that are worth a fit beside `model`, and the others with the share of the loss they would take to first
    /// order. A single joint's are few: all of them. So are those of the joint that is farthest above its floor, and what links weigh: where
    /// re-tuning bent to make up for an effect, the way to it is uphill, and of a load it makes up for most, at every joint.
    fn promising(&self, model: &Model, candidates: Vec<Candidate>) -> (Vec<Candidate>, Vec<(Candidate, f64)>) {
        if self.robot.dofs.len() == 1 || candidates.len() <= FITTED {
            return (candidates, Vec::new());
        }
        let rough = self.data.is_free().then(|| self.data.rough());
        let data = rough.as_ref().unwrap_or(self.data);
        let shares = screen::shares(self.robot, data, model, &candidates, self.scales);
        let mut order: Vec<usize> = (0..shares.len()).collect();
        order.sort_by(|&a, &b| shares[b].total_cmp(&shares[a]));
        let mut fitted = vec![false; shares.len()];
        order.iter().take(FITTED).for_each(|&i| fitted[i] = true);
        let worst = self.worst(model);
        for (fitted, candidate) in fitted.iter_mut().zip(&candidates) {
            let is_weight = matches!(candidate.kind, Kind::Mass | Kind::Payload) && !data.is_free();
            *fitted |= is_weight || candidate.kind.info().site == Site::Joint && candidate.target == worst;
        }
        let (mut kept, mut left) = (Vec::new(), Vec::new());
        for (i, candidate) in candidates.into_iter().enumerate() {
            if fitted[i] {
                kept.push(candidate);
            } else {
                left.push((candidate, shares[i]));
            }
        }
        (kept, left)
    }

    /// The degree of freedom of which `model` leaves most above its floor.
    fn worst(&self, model: &Model) -> usize {
        let left = leftover::squares(self.data, model);
        let above = |d: &usize| left[*d] / self.floors[*d];
        let order = (0..left.len()).max_by(|a, b| above(a).total_cmp(&above(b)));
        order.unwrap_or(0)
    }
}

/// Numbers of the effects that are fitted.
fn size(model: &Model) -> usize {
    model.terms.iter().map(|term| term.free.len()).sum()
}
