//! Step by step from the re-tuned nominal model to the effects the data ask for.
//!
//! In a step every effect that the model lacks is fitted beside what it has and judged by cross-validation. The best is
//! taken when it falls significantly (corrected for the number tried) and by more than a trifle, or a pair where no
//! single one does; then what earlier steps took is tried without. At the end each effect is exchanged for every other: what predicts
//! as well cannot be told apart with these logs.

use omniwalk_env::effect::Kind;
use omniwalk_env::robot::Robot;
use rayon::prelude::*;

use super::candidates::{self, Candidate, Ripples};
use super::cross::{Folds, Gain};
use super::fit::{Data, Fit, Loss, total};
use super::model::{Model, Term};
use super::scales::Scales;

/// Probability of a false alarm in a step, over all effects tried.
const FALSE_ALARM: f64 = 0.01;
/// Least fall of the cross-validated loss that makes an effect worth having.
const WORTH: f64 = 0.02;
/// The same as a share of what noise and integrator leave to be explained.
const WORTH_OF_GAP: f64 = 0.05;
/// What is left is more than noise when the loss is so many times the floor's.
const ABOVE_FLOOR: f64 = 1.5;
/// Where all that is left is negligible an effect must take this share of it.
const WORTH_OF_LITTLE: f64 = 0.5;
/// Effects are told apart when the difference is this unlikely by chance ...
const APART: f64 = 0.02;
/// ... and at least this share of the loss.
const APART_SHARE: f64 = 0.01;
/// Share of what the best effect takes of the loss from which on another may stand for it.
const RIVAL: f64 = 0.25;
/// Most effects.
const MOST: usize = 8;
/// Singles of which pairs are made.
const PAIRED: usize = 5;

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
}

/// What the steps led to.
pub struct Selection {
    /// The nominal model re-tuned.
    pub refit: Fit,
    /// Its cross-validated loss.
    pub refit_cross: Vec<Loss>,
    /// The last model.
    pub last: Fit,
    /// Its cross-validated loss.
    pub cross: Vec<Loss>,
    /// Probability by chance of each effect's gain beside the others, in the order of the model's terms, corrected for the
    /// number of effects tried.
    pub p_values: Vec<f64>,
    /// What was not taken.
    pub rejected: Vec<Rejected>,
    /// What cannot be told apart.
    pub alike: Vec<Alike>,
    /// Effects tried in the largest step.
    pub tried: usize,
    /// Largest share of the loss that an effect took in any step.
    pub best: f64,
}

impl Selection {
    /// What may stand for an effect of the model: what it has, and what in some step took a good part of what the best took.
    pub fn rivals(&self) -> Vec<(Kind, usize)> {
        let best = self.rejected.iter().map(|r| r.most).fold(self.best, f64::max);
        let good = self.rejected.iter().filter(|r| r.most >= RIVAL * best);
        let own = self.last.model.terms.iter().map(|term| (term.kind, term.target));
        good.map(|r| (r.kind, r.target)).chain(own).collect()
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
    /// Weighted loss that noise and the integrator leave.
    pub floor: f64,
    /// Weighted loss beyond the floor that is too little for an effect to be missing.
    pub negligible: f64,
    /// Effects that may take another's place; all when `None`.
    pub rivals: Option<&'a [(Kind, usize)]>,
    /// Where ripples may start, by a model's residual.
    pub ripples: &'a (dyn Fn(&Model) -> Ripples + Sync),
    /// Whether a model cannot be judged at this physics step: steps then end.
    pub coarse: &'a (dyn Fn(&Model) -> bool + Sync),
}

/// A fit with its cross-validated loss.
#[derive(Clone)]
struct Judged {
    fit: Fit,
    cross: Vec<Loss>,
}

/// Which effects a step may take.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    Delays,
    All,
}

fn is_delay(kind: Kind) -> bool {
    matches!(kind, Kind::CommandDelay | Kind::SensorDelay)
}

/// Effects of a model, in a fixed order.
type Terms = Vec<(&'static str, usize)>;

fn terms(model: &Model) -> Terms {
    let own = model.terms.iter().map(|term| (term.kind.id(), term.target));
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
    /// What was fitted already, by the effects it has.
    known: Vec<(Terms, Judged)>,
    /// What was tried already, by the effects it was tried beside.
    tried: Vec<(Terms, (Kind, usize, usize), Judged)>,
}

impl Selector<'_> {
    fn judge(&self, fit: Fit) -> Judged {
        let cross = self.folds.cross(self.data, &fit, self.scales);
        Judged { fit, cross }
    }

    /// Fits all of `model`, from its values and from the nominal ones of what is re-tuned: what bent to make up for an effect
    /// that was missing need not find its way back.
    fn fit(&self, model: &Model) -> Judged {
        let mut model = model.clone();
        model.hold_others(self.robot, None);
        let judged = self.judge(self.data.fit(&model, self.scales, &|_| true));
        if model.terms.is_empty() {
            return judged;
        }
        model.straighten(None);
        let again = self.judge(self.data.fit(&model, self.scales, &|_| true));
        if total(&again.fit.losses) < total(&judged.fit.losses) {
            again
        } else {
            judged
        }
    }

    fn worth(&self, before: &[Loss], gain: &Gain) -> bool {
        let loss = total(before);
        let gap = loss - self.floor;
        let least = if gap > self.negligible {
            WORTH_OF_GAP
        } else {
            WORTH_OF_LITTLE
        };
        gain.share >= WORTH && gain.share * loss >= least * gap
    }

    /// Runs all steps from the re-tuned `nominal` with the effects of `first`; `log` hears of progress.
    pub fn run(&self, nominal: &Model, first: &[Term], log: &dyn Fn(&str)) -> Selection {
        let refit = self.fit(nominal);
        let mut steps = Steps {
            now: refit.clone(),
            rejected: Vec::new(),
            most: 0,
            known: vec![(Terms::new(), refit.clone())],
            tried: Vec::new(),
        };
        if !first.is_empty() {
            let mut model = refit.fit.model.clone();
            model.terms.extend_from_slice(first);
            steps.now = self.fit(&model);
            self.drop_needless(&mut steps);
        }
        // Everything else leans on when things happened.
        for stage in [Stage::Delays, Stage::All] {
            while steps.now.fit.model.terms.len() < MOST
                && total(&steps.now.cross) > ABOVE_FLOOR * self.floor
                && !(self.coarse)(&steps.now.fit.model)
            {
                if !self.step(&mut steps, stage) {
                    break;
                }
                let names = steps.now.fit.model.terms.iter().map(|term| term.kind.id());
                log(&format!(
                    "{:.6}: {}",
                    total(&steps.now.cross),
                    names.collect::<Vec<_>>().join(" + ")
                ));
            }
        }
        self.merge(&mut steps);
        let alike = self.exchange(&mut steps);
        let p_values = self.p_values(&mut steps);
        let most_taken = steps.rejected.iter().map(|r| r.most).fold(0.0, f64::max);
        let Steps {
            now,
            mut rejected,
            most,
            ..
        } = steps;
        for rejected in &mut rejected {
            rejected.reason = self.reason(&rejected.gain, most);
        }
        rejected.retain(|r| !now.fit.model.has(r.kind, r.target));
        Selection {
            refit: refit.fit,
            refit_cross: refit.cross,
            last: now.fit,
            cross: now.cross,
            p_values,
            rejected,
            alike,
            tried: most,
            best: most_taken,
        }
    }

    /// Takes the effect or pair that helps most; false when none does.
    fn step(&self, steps: &mut Steps, stage: Stage) -> bool {
        let now = steps.now.clone();
        let mut candidates = self.candidates(&now.fit.model);
        candidates.retain(|candidate| stage == Stage::All || is_delay(candidate.kind));
        steps.most = steps.most.max(candidates.len());
        let tried = self.try_all(steps, &now, &candidates);
        for (candidate, judged) in candidates.iter().zip(&tried) {
            note(
                &mut steps.rejected,
                candidate,
                self.folds.gain(&now.cross, &judged.cross),
            );
        }
        let chosen = match stage {
            Stage::Delays => self.best(&now, &tried, candidates.len()),
            Stage::All => self.choose(&now, &candidates, &tried),
        };
        let Some(next) = chosen else {
            return false;
        };
        steps.now = self.fit(&next.fit.model);
        steps.known.push((terms(&steps.now.fit.model), steps.now.clone()));
        self.drop_needless(steps);
        true
    }

    /// What may be tried beside `model`.
    fn candidates(&self, model: &Model) -> Vec<Candidate> {
        let found = (self.ripples)(model);
        candidates::all(self.robot, self.data, model, self.scales, &found)
    }

    /// What may take the place of `terms` beside `model`.
    fn rivals(&self, model: &Model, terms: &[&Term]) -> Vec<Candidate> {
        let mut candidates = self.candidates(model);
        let own = |c: &Candidate| terms.iter().any(|term| (term.kind, term.target) == (c.kind, c.target));
        let worth = |c: &Candidate| self.rivals.is_none_or(|rivals| rivals.contains(&(c.kind, c.target)));
        candidates.retain(|candidate| !own(candidate) && worth(candidate));
        candidates
    }

    /// Every effect of the catalogue at once, each from its first start: what is compared with, not what is chosen.
    pub fn all_at_once(&self, tuned: &Model) -> Model {
        let mut model = tuned.clone();
        for candidate in candidates::all(self.robot, self.data, tuned, self.scales, &(self.ripples)(tuned)) {
            if !model.has(candidate.kind, candidate.target) {
                model.terms.push(candidate.starts[0].clone());
            }
        }
        self.data.fit(&model, self.scales, &|_| true).model
    }

    /// Every candidate beside `now`; what was tried there before is not tried again.
    fn try_all(&self, steps: &mut Steps, now: &Judged, candidates: &[Candidate]) -> Vec<Judged> {
        let own = terms(&now.fit.model);
        let known = |steps: &Steps, candidate: &Candidate| {
            let same = |(beside, key, _): &&(Terms, _, Judged)| *beside == own && *key == candidate.key();
            steps.tried.iter().find(same).map(|(_, _, judged)| judged.clone())
        };
        let new: Vec<&Candidate> = candidates.iter().filter(|c| known(steps, c).is_none()).collect();
        let one = |candidate: &&Candidate| {
            self.judge(candidates::fit(
                self.robot,
                self.data,
                &now.fit.model,
                candidate,
                self.scales,
            ))
        };
        let judged: Vec<Judged> = new.par_iter().map(one).collect();
        let keys = new.iter().map(|candidate| candidate.key());
        let entries = keys.zip(judged).map(|(key, judged)| (own.clone(), key, judged));
        steps.tried.extend(entries);
        candidates.iter().filter_map(|c| known(steps, c)).collect()
    }

    /// The best single effect that is worth it and significant, else the best pair.
    fn choose(&self, now: &Judged, candidates: &[Candidate], tried: &[Judged]) -> Option<Judged> {
        if let Some(best) = self.best(now, tried, candidates.len()) {
            return Some(best);
        }
        let mut order: Vec<usize> = (0..tried.len()).collect();
        order.sort_by(|&a, &b| total(&tried[a].cross).total_cmp(&total(&tried[b].cross)));
        order.truncate(PAIRED);
        let pairs: Vec<(usize, usize)> = order
            .iter()
            .enumerate()
            .flat_map(|(i, &a)| order[i + 1..].iter().map(move |&b| (a, b)))
            .filter(|&(a, b)| (candidates[a].kind, candidates[a].target) != (candidates[b].kind, candidates[b].target))
            .collect();
        let pair = |&(a, b): &(usize, usize)| {
            let fit = candidates::fit(self.robot, self.data, &tried[a].fit.model, &candidates[b], self.scales);
            self.judge(fit)
        };
        let pairs: Vec<Judged> = pairs.par_iter().map(pair).collect();
        // A pair must be worth two effects.
        let count = candidates.len() * candidates.len() / 2;
        let best = self.best(now, &pairs, count)?;
        let gain = self.folds.gain(&now.cross, &best.cross);
        (gain.share >= 2.0 * WORTH).then_some(best)
    }

    /// The best of `tried`; among those no worse, one with fewer numbers.
    fn best(&self, now: &Judged, tried: &[Judged], count: usize) -> Option<Judged> {
        let good = |judged: &&Judged| {
            let gain = self.folds.gain(&now.cross, &judged.cross);
            self.worth(&now.cross, &gain) && gain.p * count as f64 <= FALSE_ALARM
        };
        let good: Vec<&Judged> = tried.iter().filter(good).collect();
        let best = *good.iter().min_by(|a, b| total(&a.cross).total_cmp(&total(&b.cross)))?;
        let own = |judged: &Judged| size(&judged.fit.model);
        let simpler = good
            .iter()
            .filter(|other| own(other) < own(best) && !self.apart(&other.cross, &best.cross));
        Some(simpler.min_by_key(|other| own(other)).copied().unwrap_or(best).clone())
    }

    /// Whether `better` predicts better than `worse` beyond chance. What is off by no more than noise cannot be ruled out,
    /// whatever predicts better.
    fn apart(&self, worse: &[Loss], better: &[Loss]) -> bool {
        let gain = self.folds.gain(worse, better);
        gain.share >= APART_SHARE && gain.p <= APART && total(worse) > self.floor
    }

    /// The fit with the terms of `model`, which may be known already.
    fn known(&self, steps: &mut Steps, model: &Model) -> Judged {
        let own = terms(model);
        if let Some((_, judged)) = steps.known.iter().find(|(terms, _)| *terms == own) {
            return judged.clone();
        }
        let judged = self.fit(model);
        steps.known.push((own, judged.clone()));
        judged
    }

    /// Takes out what the model predicts as well without.
    fn drop_needless(&self, steps: &mut Steps) {
        let mut i = 0;
        while i < steps.now.fit.model.terms.len() {
            let mut model = steps.now.fit.model.clone();
            model.terms.remove(i);
            let without = self.known(steps, &model);
            let gain = self.folds.gain(&without.cross, &steps.now.cross);
            if self.worth(&without.cross, &gain) && gain.p <= APART {
                i += 1;
            } else {
                steps.now = without;
                i = 0;
            }
        }
    }

    /// Tries a single effect in the place of every two that were taken: steps take the best next one, and two that each
    /// explain a part can stand where one explains both.
    fn merge(&self, steps: &mut Steps) {
        'again: loop {
            let count = steps.now.fit.model.terms.len();
            for i in 0..count {
                for j in i + 1..count {
                    let mut base = steps.now.fit.model.clone();
                    let second = base.terms.remove(j);
                    let first = base.terms.remove(i);
                    let without = self.known(steps, &base);
                    let candidates = self.rivals(&without.fit.model, &[&first, &second]);
                    let tried = self.try_all(steps, &without, &candidates);
                    let best = tried.iter().min_by(|a, b| total(&a.cross).total_cmp(&total(&b.cross)));
                    if let Some(best) = best.filter(|best| !self.apart(&best.cross, &steps.now.cross)) {
                        steps.now = best.clone();
                        continue 'again;
                    }
                }
            }
            return;
        }
    }

    /// Tries every other effect in the place of each that was taken. A better one takes its place; equally good ones are
    /// returned.
    fn exchange(&self, steps: &mut Steps) -> Vec<Alike> {
        let mut alike = Vec::new();
        for i in 0..steps.now.fit.model.terms.len() {
            let mut base = steps.now.fit.model.clone();
            let mut term = base.terms.remove(i);
            let without = self.known(steps, &base);
            let candidates = self.rivals(&without.fit.model, &[&term]);
            let tried = self.try_all(steps, &without, &candidates);
            let better = (0..tried.len())
                .filter(|&k| {
                    size(&tried[k].fit.model) <= size(&steps.now.fit.model)
                        && self.apart(&steps.now.cross, &tried[k].cross)
                })
                .min_by(|&a, &b| total(&tried[a].cross).total_cmp(&total(&tried[b].cross)));
            if let Some(k) = better {
                // The exchanged term stands last; terms are visited by place, so it takes the old one's.
                let mut model = tried[k].fit.model.clone();
                model.terms[i..].rotate_right(1);
                steps.now = self.fit(&model);
                term = model.terms[i].clone();
            }
            let mut others: Vec<(Kind, usize)> = Vec::new();
            for (candidate, judged) in candidates.iter().zip(&tried) {
                let helps = self.worth(&without.cross, &self.folds.gain(&without.cross, &judged.cross));
                // What needs more numbers to do the same is no equal explanation.
                let plain = size(&judged.fit.model) <= size(&steps.now.fit.model);
                let own = (candidate.kind, candidate.target);
                if own == (term.kind, term.target) {
                    continue;
                }
                if helps && plain && !self.apart(&judged.cross, &steps.now.cross) && !others.contains(&own) {
                    others.push(own);
                }
            }
            if !others.is_empty() {
                alike.push(Alike {
                    chosen: (term.kind, term.target),
                    others,
                });
            }
        }
        alike
    }

    /// Probability by chance of what each term gains beside the others, corrected for the number of effects tried.
    fn p_values(&self, steps: &mut Steps) -> Vec<f64> {
        let now = steps.now.clone();
        let one = |i: usize| {
            let mut model = now.fit.model.clone();
            model.terms.remove(i);
            let without = self.known(steps, &model);
            (self.folds.gain(&without.cross, &now.cross).p * steps.most.max(1) as f64).min(1.0)
        };
        (0..now.fit.model.terms.len()).map(one).collect()
    }

    fn reason(&self, gain: &Gain, count: usize) -> String {
        if gain.share < WORTH {
            format!("cross-validated loss falls by {:.1} %", 100.0 * gain.share.max(-9.99))
        } else if gain.p * count as f64 > FALSE_ALARM {
            let p = (gain.p * count as f64).min(1.0);
            format!("not significant: p = {p:.2} over {count} effects tried")
        } else {
            "needless beside what was accepted".to_owned()
        }
    }
}

/// Whether `loss` is more than noise, and more than what is `negligible` beside it.
pub fn is_above(loss: f64, floor: f64, negligible: f64) -> bool {
    loss > ABOVE_FLOOR * floor && loss > floor + negligible
}

/// Numbers of the effects that are fitted.
fn size(model: &Model) -> usize {
    model.terms.iter().map(|term| term.free.len()).sum()
}

fn note(rejected: &mut Vec<Rejected>, candidate: &Candidate, gain: Gain) {
    let own = (candidate.kind, candidate.target);
    match rejected.iter_mut().find(|r| (r.kind, r.target) == own) {
        // The last step counts: it is what the effect does beside all that was taken.
        Some(rejected) => {
            rejected.most = rejected.most.max(gain.share);
            rejected.gain = gain;
        }
        None => rejected.push(Rejected {
            kind: candidate.kind,
            target: candidate.target,
            most: gain.share,
            gain,
            reason: String::new(),
        }),
    }
}
