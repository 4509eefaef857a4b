//! After the steps: what is needless goes, one effect takes the place of two, and what predicts as well is named with it.

use omniwalk_env::effect::{Kind, Site};
use rayon::prelude::*;

use super::super::candidates::refinements;
use super::super::fit::{Loss, total};
use super::super::model::{Model, Term};
use super::step::Tried;
use super::worth::APART;
use super::{Alike, Judged, Selector, Steps, size};

/// What leaves less than so many times the loss of an effect, at its joint, nearly does what that does.
const CLOSE: f64 = 2.0;

impl Selector<'_> {
    /// Takes out what the model predicts as well without: effects, and what refines them.
    pub(super) fn drop_needless(&self, steps: &mut Steps) {
        'again: loop {
            for model in reduced(&steps.now.fit.model) {
                let without = self.known(steps, &model);
                let gain = self.folds.gain(&without.cross, &steps.now.cross);
                if !self.worth(&without, &steps.now, &gain) || gain.p > APART {
                    steps.now = without;
                    continue 'again;
                }
            }
            return;
        }
    }

    /// Tries a single effect in the place of every two that were taken: steps take the best next one, and two that each
    /// explain a part can stand where one explains both.
    pub(super) fn merge(&self, steps: &mut Steps) {
        'again: loop {
            let count = steps.now.fit.model.terms.len();
            for i in 0..count {
                for j in i + 1..count {
                    let mut base = steps.now.fit.model.clone();
                    let second = base.terms.remove(j);
                    let first = base.terms.remove(i);
                    let without = self.known(steps, &base);
                    let candidates = self.rivals(&without.fit.model, &[&first, &second]);
                    let tried = self.try_all(steps, &without, candidates).judged;
                    let best = tried.iter().min_by(|a, b| total(&a.cross).total_cmp(&total(&b.cross)));
                    let as_good = |one: &Judged| !self.is_worse(one, &steps.now);
                    let one = best.filter(|best| as_good(best)).map(|best| self.whole(best));
                    if let Some(one) = one.filter(as_good) {
                        steps.now = one;
                        continue 'again;
                    }
                }
            }
            return;
        }
    }

    /// Tries every other effect in the place of each that was taken. A better one takes its place; equally good ones are
    /// returned.
    pub(super) fn exchange(&self, steps: &mut Steps) -> Vec<Alike> {
        let mut alike = Vec::new();
        for i in 0..steps.now.fit.model.terms.len() {
            let mut base = steps.now.fit.model.clone();
            let mut term = base.terms.remove(i);
            let without = self.known(steps, &base);
            let candidates = self.rivals(&without.fit.model, &[&term]);
            let mut tried = self.try_all(steps, &without, candidates.clone());
            tried.add(self.try_in_place(&without, &steps.now, candidates));
            self.shake_close(&mut tried, &steps.now, &term);
            let plain = |judged: &&Judged| size(&judged.fit.model) <= size(&steps.now.fit.model);
            let better = tried.judged.iter().filter(plain);
            let better = better
                .filter(|judged| self.is_worse(&steps.now, judged))
                .min_by(|a, b| total(&a.cross).total_cmp(&total(&b.cross)));
            if let Some(better) = better {
                // The exchanged term stands last; terms are visited by place, so it takes the old one's.
                let mut model = better.fit.model.clone();
                model.terms[i..].rotate_right(1);
                let whole = self.fit_near(&model);
                if !model.is_held() || self.is_worse(&steps.now, &whole) {
                    steps.now = whole;
                    term = model.terms[i].clone();
                }
            }
            let mut others: Vec<(Kind, usize)> = Vec::new();
            let (mut models, mut values) = (Vec::new(), Vec::new());
            for (candidate, judged) in tried.iter() {
                let helps = self.worth(&without, judged, &self.folds.gain(&without.cross, &judged.cross));
                // What needs more numbers to do the same is no equal explanation.
                let plain = size(&judged.fit.model) <= size(&steps.now.fit.model);
                let own = (candidate.kind, candidate.target);
                if own == (term.kind, term.target) {
                    continue;
                }
                if helps && plain && !self.is_worse(judged, &steps.now) && !others.contains(&own) {
                    others.push(own);
                    let model = &judged.fit.model;
                    let there = model.term(own.0, own.1).map(|term| term.values.clone());
                    values.push(there.unwrap_or_default());
                    models.push(model.clone());
                }
            }
            if !others.is_empty() {
                alike.push(Alike {
                    chosen: (term.kind, term.target),
                    others,
                    models,
                    values,
                });
            }
        }
        alike
    }

    /// `judged`, fitted with what is on other joints, if that was held.
    fn whole(&self, judged: &Judged) -> Judged {
        match judged.fit.model.is_held() {
            true => self.fit_near(&judged.fit.model),
            false => judged.clone(),
        }
    }

    /// Fits what was `tried` in the place of `term`, and does nearly what that does at its joint, again: from about its end, and without the hold
    /// in which it is farthest behind. Little decides where a joint sticks after a step, and one hold in another place looks like a worse effect.
    fn shake_close(&self, tried: &mut Tried, now: &Judged, term: &Term) {
        let at = (term.kind.info().site == Site::Joint).then_some(term.target);
        let own = |cells: &Vec<Loss>| self.sum_of(cells, |dof| at.is_none_or(|at| dof == at));
        let models = tried.judged.iter().chain([now]).map(|judged| judged.fit.model.clone());
        let mut losses: Vec<f64> = self.data.cells(&models.collect::<Vec<_>>()).iter().map(own).collect();
        let bound = losses.pop().map_or(0.0, |now| CLOSE * now);
        let is_worse = |own: &Judged| self.is_worse(own, now);
        let is_close = |(own, loss): &(&mut Judged, f64)| *loss < bound && is_worse(own);
        let close = tried.judged.par_iter_mut().zip(losses).filter(is_close);
        close.for_each(|(own, _)| {
            let again = self.fit_near(&own.fit.model);
            if total(&again.fit.losses) < total(&own.fit.losses) {
                *own = again;
            }
            let Some(hold) = self.hold(&own.cross, &now.cross).filter(|_| is_worse(own)) else {
                return;
            };
            let used = |block: usize| !hold.contains(&block);
            let without = self.judge(self.data.fit(&own.fit.model, self.scales, &used));
            if !is_worse(&without) {
                *own = without;
            }
        });
    }

    /// Probability by chance of what each term gains beside the others, corrected for the number of effects it was chosen from.
    pub(super) fn p_values(&self, steps: &mut Steps) -> Vec<f64> {
        let now = steps.now.clone();
        let one = |i: usize| {
            let mut model = now.fit.model.clone();
            let term = model.terms.remove(i);
            let without = self.known(steps, &model);
            let own = steps.counts.iter().rfind(|(own, _)| *own == (term.kind, term.target));
            let count = own.map_or(steps.most.max(1), |(_, count)| *count);
            (self.folds.gain(&without.cross, &now.cross).p * (count * self.limbs) as f64).min(1.0)
        };
        (0..now.fit.model.terms.len()).map(one).collect()
    }
}

/// `model` without each of its effects, and without what refines them.
fn reduced(model: &Model) -> Vec<Model> {
    let mut out = Vec::new();
    for (i, term) in model.terms.iter().enumerate() {
        let mut without = model.clone();
        without.terms.remove(i);
        out.push(without);
        let info = term.kind.info();
        for group in refinements(term.kind)
            .iter()
            .filter(|group| term.free.contains(&group[0]))
        {
            let mut plain = model.clone();
            let own = &mut plain.terms[i];
            own.free.retain(|number| !group.contains(number));
            for &number in *group {
                own.values[number] = info.parameters[number].default.unwrap_or(0.0);
            }
            out.push(plain);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::super::cross::Folds;
    use super::super::super::cut::Lengths;
    use super::super::super::floor::Floor;
    use super::super::super::hinge::{chain, read, swings};
    use super::super::super::scales::Scales;
    use super::super::terms;
    use super::*;

    #[test]
    fn what_takes_the_place_of_two_effects_is_fitted_with_what_other_joints_have() {
        let robot = chain(&["upper", "lower"], "kp = 30.0\nkd = 1.0\n");
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let mut data = swings(&robot, 2, lengths);
        let term = |kind: Kind, values: &[f64]| Term {
            kind,
            target: 0,
            values: values.to_vec(),
            free: vec![0],
            table: None,
            held: false,
        };
        let nominal = Model::nominal(&robot, &data.trials);
        let with = |terms: Vec<Term>| Model {
            terms,
            ..nominal.clone()
        };
        read(&mut data, &with(vec![term(Kind::CommandRateLimit, &[1.5])]));
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        let two = with(vec![term(Kind::CommandDelay, &[0.1]), term(Kind::CommandGain, &[0.7])]);
        let mut steps = Steps {
            now: selector.fit_near(&two),
            rejected: Vec::new(),
            most: 0,
            counts: Vec::new(),
            known: vec![(terms(&nominal), selector.fit(&nominal))],
            tried: Vec::new(),
        };
        selector.merge(&mut steps);
        let Judged { fit, .. } = &steps.now;
        assert_eq!(terms(&fit.model)[0].0, "command_rate_limit");
        assert_eq!(fit.model.terms.len(), 1);
        assert!(!fit.model.is_held());
        assert!(
            (fit.model.terms[0].values[0] - 1.5).abs() < 0.02,
            "{:?}",
            fit.model.terms
        );
    }
}
