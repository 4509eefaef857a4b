//! A step: what is tried beside the model, and which of it is taken.

use omniwalk_env::effect::Kind;
use rayon::prelude::*;

use super::super::candidates::{self, Candidate};
use super::super::cross::Gain;
use super::super::fit::total;
use super::worth::WORTH;
use super::{Judged, PAIRED, Rejected, Selector, Steps, Terms, size, terms};

/// Which effects a step may take.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    Delays,
    All,
}

fn is_delay(kind: Kind) -> bool {
    matches!(kind, Kind::CommandDelay | Kind::SensorDelay)
}

impl Selector<'_> {
    /// Takes the effect or pair that helps most; false when none does.
    pub(super) fn step(&self, steps: &mut Steps, stage: Stage) -> bool {
        let now = steps.now.clone();
        let mut candidates = self.candidates(&now.fit.model);
        candidates.retain(|candidate| stage == Stage::All || is_delay(candidate.kind));
        let count = candidates.len();
        steps.most = steps.most.max(count);
        let (candidates, left) = self.promising(&now.fit.model, candidates);
        for (candidate, share) in &left {
            note(&mut steps.rejected, candidate, Gain::NONE, Some(*share));
        }
        let tried = self.try_all(steps, &now, &candidates);
        for (candidate, judged) in candidates.iter().zip(&tried) {
            let gain = self.folds.gain(&now.cross, &judged.cross);
            note(&mut steps.rejected, candidate, gain, None);
        }
        // Those that were not fitted were tried as well: what was fitted is the best of all of them.
        let chosen = match stage {
            Stage::Delays => self.best(&now, &tried, count),
            Stage::All => self.choose(&now, &candidates, &tried, count),
        };
        let Some(next) = chosen else {
            return false;
        };
        let new = next.fit.model.terms.iter().map(|term| (term.kind, term.target));
        steps.counts.extend(
            new.filter(|own| !now.fit.model.has(own.0, own.1))
                .map(|own| (own, count)),
        );
        steps.now = self.fit(&next.fit.model);
        steps.known.push((terms(&steps.now.fit.model), steps.now.clone()));
        self.drop_needless(steps);
        self.refine(steps);
        true
    }

    /// Refines the effects that were taken as far as that helps. A refinement names nothing new: it is corrected for the
    /// number of refinements alone.
    pub(super) fn refine(&self, steps: &mut Steps) {
        loop {
            let now = steps.now.clone();
            let candidates = candidates::finer(&now.fit.model, self.scales);
            let tried = self.try_all(steps, &now, &candidates);
            let Some(best) = self.best(&now, &tried, candidates.len()) else {
                return;
            };
            steps.now = self.fit(&best.fit.model);
            steps.known.push((terms(&steps.now.fit.model), steps.now.clone()));
        }
    }

    /// Every candidate beside `now`; what was tried there before is not tried again.
    pub(super) fn try_all(&self, steps: &mut Steps, now: &Judged, candidates: &[Candidate]) -> Vec<Judged> {
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

    /// The best single effect that is worth it and significant among `count`, else the best pair.
    fn choose(&self, now: &Judged, candidates: &[Candidate], tried: &[Judged], count: usize) -> Option<Judged> {
        if let Some(best) = self.best(now, tried, count) {
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
        let best = self.best(now, &pairs, count * count / 2)?;
        let gain = self.folds.gain(&now.cross, &best.cross);
        (gain.share >= 2.0 * WORTH).then_some(best)
    }

    /// The best of `tried`; among those no worse, one with fewer numbers.
    fn best(&self, now: &Judged, tried: &[Judged], count: usize) -> Option<Judged> {
        let good: Vec<&Judged> = tried
            .iter()
            .filter(|judged| self.is_better(now, judged, count))
            .collect();
        let best = *good.iter().min_by(|a, b| total(&a.cross).total_cmp(&total(&b.cross)))?;
        let own = |judged: &Judged| size(&judged.fit.model);
        let simpler = good
            .iter()
            .filter(|other| own(other) < own(best) && !self.apart(&other.cross, &best.cross));
        let best = simpler.min_by_key(|other| own(other)).copied().unwrap_or(best);
        self.beyond_contact(now, best).then(|| best.clone())
    }
}

fn note(rejected: &mut Vec<Rejected>, candidate: &Candidate, gain: Gain, at_best: Option<f64>) {
    let own = (candidate.kind, candidate.target);
    match rejected.iter_mut().find(|r| (r.kind, r.target) == own) {
        // The last step counts: it is what the effect does beside all that was taken.
        Some(rejected) => {
            rejected.most = rejected.most.max(gain.share);
            (rejected.gain, rejected.at_best) = (gain, at_best);
        }
        None => rejected.push(Rejected {
            kind: candidate.kind,
            target: candidate.target,
            most: gain.share,
            gain,
            at_best,
            reason: String::new(),
        }),
    }
}
