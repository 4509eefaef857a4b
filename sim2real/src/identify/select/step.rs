//! A step: what is tried beside the model, and which of it is taken.

use omniwalk_env::effect::Kind;
use omniwalk_env::robot::Robot;
use rayon::prelude::*;

use super::super::candidates::{self, Attempt, Candidate};
use super::super::fit::{Data, total};
use super::super::gain::Gain;
use super::super::model::Model;
use super::super::scales::Scales;
use super::worth::WORTH;
use super::{Judged, PAIRED, Rejected, Selector, Steps, Terms, size, terms};

/// Candidates that are finished where fits are dear.
const FINISHED: usize = 6;
/// A candidate that leaves so many times the loss of the best one of rough data is not looked at further.
const BEHIND: f64 = 2.0;

/// Candidates that may turn out to be no better, once fitted as a whole, before a step ends: each of these fits is dear.
const REFUSED: usize = 3;

/// How an attempt begins.
type Begin = fn(&Robot, &Data, &Model, &Candidate, &Scales) -> Attempt;

/// What was tried beside a model.
#[derive(Default)]
pub(super) struct Tried {
    pub(super) candidates: Vec<Candidate>,
    /// One a candidate.
    pub(super) judged: Vec<Judged>,
    /// Those that were left on the way, with the share of the loss they take of rough data.
    pub(super) left: Vec<(Candidate, f64)>,
}

impl Tried {
    /// What was tried in another way too.
    pub(super) fn add(&mut self, other: Self) {
        self.candidates.extend(other.candidates);
        self.judged.extend(other.judged);
    }

    /// Leaves out what has the effects of `own`; false where nothing does.
    fn leave(&mut self, own: &Judged) -> bool {
        let own = terms(&own.fit.model);
        let Some(place) = self.judged.iter().position(|judged| terms(&judged.fit.model) == own) else {
            return false;
        };
        self.candidates.remove(place);
        self.judged.remove(place);
        true
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (&Candidate, &Judged)> {
        self.candidates.iter().zip(&self.judged)
    }
}

/// Which effects a step may take.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// Delays and offsets of the encoder, on which everything else leans.
    Readings,
    All,
}

fn is_of_readings(kind: Kind) -> bool {
    matches!(kind, Kind::CommandDelay | Kind::SensorDelay | Kind::SensorOffset)
}

impl Selector<'_> {
    /// Takes the effect or pair that helps most; false when none does.
    pub(super) fn step(&self, steps: &mut Steps, stage: Stage) -> bool {
        let now = steps.now.clone();
        let mut candidates = self.candidates(&now.fit.model);
        candidates.retain(|candidate| stage == Stage::All || is_of_readings(candidate.kind));
        let count = candidates.len();
        steps.most = steps.most.max(count);
        let (candidates, left) = self.promising(&now.fit.model, candidates);
        let mut tried = self.try_all(steps, &now, candidates);
        for (candidate, share) in &left {
            note(&mut steps.rejected, candidate, Gain::NONE, Some(*share));
        }
        for &(ref candidate, share) in &tried.left {
            note(&mut steps.rejected, candidate, Gain { share, p: 1.0 }, Some(share));
        }
        for (candidate, judged) in tried.iter() {
            let gain = self.folds.gain(&now.cross, &judged.cross);
            note(&mut steps.rejected, candidate, gain, None);
        }
        // Those that were not fitted were tried as well: what was fitted is the best of all of them.
        let Some(next) = self.take(&now, &mut tried, stage, count) else {
            return false;
        };
        let new = next.fit.model.terms.iter().map(|term| (term.kind, term.target));
        steps.counts.extend(
            new.filter(|own| !now.fit.model.has(own.0, own.1))
                .map(|own| (own, count)),
        );
        steps.now = next;
        steps.known.push((terms(&steps.now.fit.model), steps.now.clone()));
        self.drop_needless(steps);
        self.refine(steps);
        true
    }

    /// The best of `tried`, fitted as a whole, that is worth it and significant among `count` so too: while they were tried, the numbers of other
    /// joints were held as they fit all logs, and those of the model before were not.
    fn take(&self, now: &Judged, tried: &mut Tried, stage: Stage, count: usize) -> Option<Judged> {
        // A robot that walks freely is fitted as a whole, which is dearer yet.
        let most = if self.data.is_free() { 1 } else { REFUSED };
        for _ in 0..most {
            let chosen = match stage {
                Stage::Readings => self.best(now, &tried.judged, count),
                Stage::All => self.choose(now, tried, count),
            }?;
            let whole = self.fit_near(&chosen.fit.model);
            if !chosen.fit.model.is_held() || self.is_better(now, &whole, count) {
                return Some(whole);
            }
            tried.leave(&chosen).then_some(())?;
        }
        None
    }

    /// Refines the effects that were taken as far as that helps. A refinement names nothing new: it is corrected for the
    /// number of refinements alone.
    pub(super) fn refine(&self, steps: &mut Steps) {
        loop {
            let now = steps.now.clone();
            let candidates = candidates::finer(&now.fit.model, self.scales);
            let count = candidates.len();
            let tried = self.try_all(steps, &now, candidates);
            let Some(best) = self.best(&now, &tried.judged, count) else {
                return;
            };
            steps.now = self.fit_near(&best.fit.model);
            steps.known.push((terms(&steps.now.fit.model), steps.now.clone()));
        }
    }

    /// Every candidate beside `now`; what was tried there before is not tried again.
    pub(super) fn try_all(&self, steps: &mut Steps, now: &Judged, candidates: Vec<Candidate>) -> Tried {
        let beside = terms(&now.fit.model);
        let known = |steps: &Steps, candidate: &Candidate| {
            let same = |(own, key, _): &&(Terms, _, _)| *own == beside && *key == candidate.key();
            steps.tried.iter().find(same).map(|(_, _, result)| result.clone())
        };
        let new: Vec<&Candidate> = candidates.iter().filter(|c| known(steps, c).is_none()).collect();
        let on: Vec<_> = new.iter().map(|candidate| (&now.fit.model, *candidate)).collect();
        if !on.is_empty() {
            let before = total(&self.data.rough().losses(std::slice::from_ref(&now.fit.model))[0]);
            let share = |loss: f64| 1.0 - loss / before;
            let results = self.with_others_left_out(now, &new, self.try_on(&on, Attempt::begin));
            let results = results.into_iter().map(|result| result.map_err(share));
            let results = new
                .iter()
                .zip(results)
                .map(|(c, result)| (beside.clone(), c.key(), result));
            steps.tried.extend(results);
        }
        let mut tried = Tried::default();
        for candidate in candidates {
            match known(steps, &candidate) {
                Some(Ok(judged)) => {
                    tried.candidates.push(candidate);
                    tried.judged.push(judged);
                }
                Some(Err(share)) => tried.left.push((candidate, share)),
                None => {}
            }
        }
        tried
    }

    /// Every candidate in the place of an effect: beside `without` it, re-tuned as in `now` with it. What explains the same does so with much
    /// the same values, and from those without any effect there need not be a way.
    pub(super) fn try_in_place(&self, without: &Judged, now: &Judged, candidates: Vec<Candidate>) -> Tried {
        if self.data.is_free() {
            return Tried::default();
        }
        let mut model = without.fit.model.clone();
        model.tuned.clone_from(&now.fit.model.tuned);
        let on: Vec<_> = candidates.iter().map(|candidate| (&model, candidate)).collect();
        let each: Vec<&Candidate> = candidates.iter().collect();
        let results = self.with_others_left_out(without, &each, self.try_on(&on, Attempt::in_place));
        let good = candidates.into_iter().zip(results);
        let (candidates, judged) = good.filter_map(|(own, result)| Some((own, result.ok()?))).unzip();
        Tried {
            candidates,
            judged,
            left: Vec::new(),
        }
    }

    /// The candidates, each beside its own model of `on`, judged; or the losses of those that are far from the best of rough data, and,
    /// where fits are dear, those of all but the best [`FINISHED`].
    fn try_on(&self, on: &[(&Model, &Candidate)], begin: Begin) -> Vec<Result<Judged, f64>> {
        let rough = self.data.rough();
        let begin =
            |(model, candidate): &(&Model, &Candidate)| begin(self.robot, &rough, model, candidate, self.scales);
        let mut attempts: Vec<Attempt> = on.par_iter().map(begin).collect();
        let best = attempts.iter().map(Attempt::loss).fold(f64::INFINITY, f64::min);
        attempts
            .par_iter_mut()
            .for_each(|attempt| attempt.go_on(&rough, self.scales, best));
        let taken = self.taken_for_the_step(on, &rough);
        let losses: Vec<f64> = attempts
            .iter()
            .zip(taken)
            .map(|(own, taken)| own.loss() + taken)
            .collect();
        let mut order = losses.clone();
        order.sort_by(f64::total_cmp);
        let dear = self.data.is_dear();
        let most = if dear { FINISHED } else { on.len() };
        let last = order.get(most.wrapping_sub(1)).copied().unwrap_or(f64::INFINITY);
        let last = last.min(BEHIND * order.first().copied().unwrap_or(f64::INFINITY));
        let judge = |(attempt, loss): (Attempt, f64)| {
            if loss > last {
                return Err(loss);
            }
            let near = attempt.fit();
            let fit = if dear {
                self.data.fit(&near.model, self.scales, &|_| true)
            } else {
                near
            };
            Ok(self.judge(fit))
        };
        attempts.into_par_iter().zip(losses).map(judge).collect()
    }

    /// What re-tuning alone takes of the loss of `rough` data beside each of `on`, where their physics step is a coarser one: it bends to the
    /// step, of a whole limb more than of one joint, and what it takes for that is no effect's.
    fn taken_for_the_step(&self, on: &[(&Model, &Candidate)], rough: &Data) -> Vec<f64> {
        if self.data.finer == rough.finer || self.robot.dofs.len() == 1 {
            return vec![0.0; on.len()];
        }
        let joint = |candidate: &Candidate| candidate.joint(self.robot, self.data);
        let taken = |&(model, candidate): &(&Model, &Candidate)| {
            let mut plain = Attempt::plain(self.robot, rough, model, joint(candidate), self.scales);
            plain.go_on(rough, self.scales, plain.loss());
            total(&rough.losses(std::slice::from_ref(model))[0]) - plain.loss()
        };
        let is_same =
            |a: &(&Model, &Candidate), b: &(&Model, &Candidate)| std::ptr::eq(a.0, b.0) && joint(a.1) == joint(b.1);
        let first = |own| on.iter().position(|other| is_same(own, other)).unwrap_or(0);
        let firsts: Vec<usize> = on.iter().map(first).collect();
        let once = |i: usize| if firsts[i] == i { taken(&on[i]) } else { 0.0 };
        let taken: Vec<f64> = (0..on.len()).into_par_iter().map(once).collect();
        firsts.iter().map(|&first| taken[first]).collect()
    }

    /// The best single effect that is worth it and significant among `count`, else the best pair.
    fn choose(&self, now: &Judged, tried: &Tried, count: usize) -> Option<Judged> {
        if let Some(best) = self.best(now, &tried.judged, count) {
            return Some(best);
        }
        let mut order: Vec<(&Candidate, &Judged)> = tried.iter().collect();
        order.sort_by(|(_, a), (_, b)| total(&a.cross).total_cmp(&total(&b.cross)));
        order.truncate(PAIRED);
        let firsts = order.iter().enumerate();
        let pairs = firsts.flat_map(|(i, first)| order[i + 1..].iter().map(move |second| (first, second)));
        let pairs: Vec<_> = pairs
            .filter(|((a, _), (b, _))| (a.kind, a.target) != (b.kind, b.target))
            .collect();
        let on: Vec<_> = pairs
            .iter()
            .map(|((_, first), (second, _))| (&first.fit.model, *second))
            .collect();
        let seconds: Vec<&Candidate> = on.iter().map(|(_, second)| *second).collect();
        let pairs = self.with_others_left_out(now, &seconds, self.try_on(&on, Attempt::begin));
        let pairs: Vec<Judged> = pairs.into_iter().filter_map(Result::ok).collect();
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
            .filter(|other| own(other) < own(best) && !self.is_worse(other, best));
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

#[cfg(test)]
mod tests {
    use super::super::super::cross::Folds;
    use super::super::super::cut::Lengths;
    use super::super::super::floor::Floor;
    use super::super::super::hinge::{chain, read, swings};
    use super::super::super::model::Term;
    use super::*;

    /// A link that is light for its rotor's brake follows no step of a millisecond.
    const BRAKED: &str = "kp = 30.0\nkd = 8.0\narmature = 0.002\n";

    fn dead_band(width: f64) -> Term {
        Term {
            kind: Kind::CommandDeadBand,
            target: 1,
            values: vec![width],
            free: vec![0],
            table: None,
            held: false,
        }
    }

    #[test]
    fn what_re_tuning_takes_for_a_coarser_step_is_no_effects() {
        let robot = chain(&["upper", "lower"], BRAKED);
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let mut data = swings(&robot, 2, lengths);
        data.finer = 4;
        let nominal = Model::nominal(&robot, &data.trials);
        let truth = Model {
            terms: vec![dead_band(0.01)],
            ..nominal.clone()
        };
        read(&mut data, &truth);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        let candidates = selector.candidates(&nominal);
        let on: Vec<(&Model, &Candidate)> = candidates.iter().map(|own| (&nominal, own)).collect();
        let taken = selector.taken_for_the_step(&on, &data.rough());
        let of = |kind: Kind, target: usize| {
            let place = candidates
                .iter()
                .position(|own| (own.kind, own.target) == (kind, target));
            taken[place.expect("a candidate")]
        };
        assert!(of(Kind::CommandDelay, 0) > 0.0 && of(Kind::CommandDelay, 1) > 0.0);
        assert!(of(Kind::Mass, 1) > of(Kind::CommandDelay, 0).max(of(Kind::CommandDelay, 1)));
        assert_eq!(selector.taken_for_the_step(&on, &data), vec![0.0; on.len()]);
    }
}
