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
use super::model::Model;
use super::scales::Scales;

/// Probability of a false alarm in a step, over all effects tried.
const FALSE_ALARM: f64 = 0.01;
/// Least fall of the cross-validated loss that makes an effect worth having.
const WORTH: f64 = 0.02;
/// The same as a share of what noise and integrator leave to be explained.
const WORTH_OF_GAP: f64 = 0.05;
/// What is left is more than noise when the loss is so many times the floor's.
pub const ABOVE_FLOOR: f64 = 1.5;
/// Effects are told apart when the difference is this unlikely by chance ...
const APART: f64 = 0.02;
/// ... and at least this share of the loss.
const APART_SHARE: f64 = 0.01;
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
    /// Best gain it had in any step.
    pub gain: Gain,
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
    /// Probability by chance of each effect's gain, in the order of the model's terms, corrected.
    pub p_values: Vec<f64>,
    /// What was not taken.
    pub rejected: Vec<Rejected>,
    /// What cannot be told apart.
    pub alike: Vec<Alike>,
    /// Effects tried in the largest step.
    pub tried: usize,
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

/// Where the steps are.
struct Steps {
    now: Judged,
    p_values: Vec<f64>,
    rejected: Vec<Rejected>,
    /// Effects tried in the largest step.
    most: usize,
}

impl Selector<'_> {
    fn judge(&self, fit: Fit) -> Judged {
        let cross = self.folds.cross(self.data, &fit, self.scales);
        Judged { fit, cross }
    }

    /// Fits all of `model`.
    fn fit(&self, model: &Model) -> Judged {
        let mut model = model.clone();
        model.hold_others(self.robot, None);
        self.judge(self.data.fit(&model, self.scales, &|_| true))
    }

    fn worth(&self, before: &[Loss], gain: &Gain) -> bool {
        let loss = total(before);
        gain.share >= WORTH && gain.share * loss >= WORTH_OF_GAP * (loss - self.floor)
    }

    /// Runs all steps from `nominal`; `ripples` finds where ripples may start from a model's residual; `log` hears of progress.
    pub fn run(&self, nominal: &Model, ripples: &dyn Fn(&Model) -> Ripples, log: &dyn Fn(&str)) -> Selection {
        let refit = self.fit(nominal);
        let mut steps = Steps {
            now: refit.clone(),
            p_values: Vec::new(),
            rejected: Vec::new(),
            most: 0,
        };
        // Everything else leans on when things happened.
        for stage in [Stage::Delays, Stage::All] {
            while steps.now.fit.model.terms.len() < MOST && total(&steps.now.cross) > ABOVE_FLOOR * self.floor {
                if !self.step(&mut steps, stage, ripples) {
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
        let Steps {
            mut now,
            p_values,
            mut rejected,
            most,
        } = steps;
        let alike = self.exchange(&mut now, ripples);
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
        }
    }

    /// Takes the effect or pair that helps most; false when none does.
    fn step(&self, steps: &mut Steps, stage: Stage, ripples: &dyn Fn(&Model) -> Ripples) -> bool {
        let now = &steps.now;
        let found = ripples(&now.fit.model);
        let mut candidates = candidates::all(self.robot, self.data, &now.fit.model, self.scales, &found);
        candidates.retain(|candidate| stage == Stage::All || is_delay(candidate.kind));
        steps.most = steps.most.max(candidates.len());
        let tried = self.try_all(now, &candidates);
        for (candidate, judged) in candidates.iter().zip(&tried) {
            note(
                &mut steps.rejected,
                candidate,
                self.folds.gain(&now.cross, &judged.cross),
            );
        }
        let chosen = match stage {
            Stage::Delays => self.best(now, &tried, candidates.len()),
            Stage::All => self.choose(now, &candidates, &tried),
        };
        let Some((next, p)) = chosen else {
            return false;
        };
        let added = next.fit.model.terms.len() - now.fit.model.terms.len();
        steps.p_values.extend(std::iter::repeat_n(p, added));
        steps.now = if self.robot.dofs.len() > 1 {
            self.fit(&next.fit.model)
        } else {
            next
        };
        self.drop_needless(&mut steps.now, &mut steps.p_values);
        true
    }

    /// Every effect of the catalogue at once, each from its first start: what is compared with, not what is chosen.
    pub fn all_at_once(&self, tuned: &Model, ripples: &dyn Fn(&Model) -> Ripples) -> Model {
        let mut model = tuned.clone();
        for candidate in candidates::all(self.robot, self.data, tuned, self.scales, &ripples(tuned)) {
            if !model.has(candidate.kind, candidate.target) {
                model.terms.push(candidate.starts[0].clone());
            }
        }
        self.data.fit(&model, self.scales, &|_| true).model
    }

    fn try_all(&self, now: &Judged, candidates: &[Candidate]) -> Vec<Judged> {
        let one = |candidate: &Candidate| {
            self.judge(candidates::fit(
                self.robot,
                self.data,
                &now.fit.model,
                candidate,
                self.scales,
            ))
        };
        candidates.par_iter().map(one).collect()
    }

    /// The best single effect that is worth it and significant, else the best pair.
    fn choose(&self, now: &Judged, candidates: &[Candidate], tried: &[Judged]) -> Option<(Judged, f64)> {
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
        let gain = self.folds.gain(&now.cross, &best.0.cross);
        (gain.share >= 2.0 * WORTH).then_some(best)
    }

    /// The best of `tried`; among those no worse, one with fewer numbers.
    fn best(&self, now: &Judged, tried: &[Judged], count: usize) -> Option<(Judged, f64)> {
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
        let best = simpler.min_by_key(|other| own(other)).copied().unwrap_or(best);
        let p = (self.folds.gain(&now.cross, &best.cross).p * count as f64).min(1.0);
        Some((best.clone(), p))
    }

    /// Whether `better` predicts better than `worse` beyond chance. What is off by no more than noise cannot be ruled out,
    /// whatever predicts better.
    fn apart(&self, worse: &[Loss], better: &[Loss]) -> bool {
        let gain = self.folds.gain(worse, better);
        gain.share >= APART_SHARE && gain.p <= APART && total(worse) > self.floor
    }

    /// Takes out what the model predicts as well without.
    fn drop_needless(&self, now: &mut Judged, p_values: &mut Vec<f64>) {
        let mut i = 0;
        while now.fit.model.terms.len() > 1 && i < now.fit.model.terms.len() {
            let mut model = now.fit.model.clone();
            model.terms.remove(i);
            let without = self.fit(&model);
            let gain = self.folds.gain(&without.cross, &now.cross);
            if self.worth(&without.cross, &gain) && gain.p <= APART {
                i += 1;
            } else {
                *now = without;
                p_values.remove(i);
                i = 0;
            }
        }
    }

    /// Tries every other effect in the place of each that was taken. A better one takes its place; equally good ones are
    /// returned.
    fn exchange(&self, now: &mut Judged, ripples: &dyn Fn(&Model) -> Ripples) -> Vec<Alike> {
        let mut alike = Vec::new();
        for i in 0..now.fit.model.terms.len() {
            let mut base = now.fit.model.clone();
            let term = base.terms.remove(i);
            let without = self.fit(&base);
            let found = ripples(&base);
            let mut candidates = candidates::all(self.robot, self.data, &base, self.scales, &found);
            candidates.retain(|other| (other.kind, other.target) != (term.kind, term.target));
            let tried = self.try_all(&without, &candidates);
            let better = (0..tried.len())
                .filter(|&k| {
                    size(&tried[k].fit.model) <= size(&now.fit.model) && self.apart(&now.cross, &tried[k].cross)
                })
                .min_by(|&a, &b| total(&tried[a].cross).total_cmp(&total(&tried[b].cross)));
            let mut term = term;
            if let Some(k) = better {
                *now = self.fit(&tried[k].fit.model);
                // The exchanged term stands last; terms are visited by place, so it takes the old one's.
                let last = now.fit.model.terms.len() - 1;
                now.fit.model.terms[i..=last].rotate_right(1);
                *now = self.fit(&now.fit.model);
                term = now.fit.model.terms[i].clone();
            }
            let mut others: Vec<(Kind, usize)> = Vec::new();
            for (candidate, judged) in candidates.iter().zip(&tried) {
                let helps = self.worth(&without.cross, &self.folds.gain(&without.cross, &judged.cross));
                // What needs more numbers to do the same is no equal explanation.
                let plain = size(&judged.fit.model) <= size(&now.fit.model);
                let own = (candidate.kind, candidate.target);
                if own == (term.kind, term.target) {
                    continue;
                }
                if helps && plain && !self.apart(&judged.cross, &now.cross) && !others.contains(&own) {
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

/// Numbers of the effects that are fitted.
fn size(model: &Model) -> usize {
    model.terms.iter().map(|term| term.free.len()).sum()
}

fn note(rejected: &mut Vec<Rejected>, candidate: &Candidate, gain: Gain) {
    let own = (candidate.kind, candidate.target);
    match rejected.iter_mut().find(|r| (r.kind, r.target) == own) {
        // The last step counts: it is what the effect does beside all that was taken.
        Some(rejected) => rejected.gain = gain,
        None => rejected.push(Rejected {
            kind: candidate.kind,
            target: candidate.target,
            gain,
            reason: String::new(),
        }),
    }
}
