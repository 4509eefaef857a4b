//! Fits of models and what they predict of data they were not fitted to.

use std::collections::BTreeSet;

use omniwalk_env::effect::Kind;
use rayon::prelude::*;

use super::super::candidates::{self, Candidate};
use super::super::descent::Descent;
use super::super::fit::{Fit, total};
use super::super::model::{Model, Term};
use super::super::own::Own;
use super::worth::WORTH_OF_GAP;
use super::{Attempted, Judged, LESSER, Selector, Steps, terms};

impl Selector<'_> {
    /// Whether re-tuning `own` of degree of freedom `dof` from their nominal values is needed, as more than noise is left of it otherwise, and
    /// predicts so much better that it is no accident, for one of `count` such tests; the joint's other numbers are fitted with and without.
    pub fn retuning_helps(&self, fit: &Fit, dof: usize, own: &[Own], count: usize) -> bool {
        let judge = |nominal: &[Own]| {
            self.judge(
                self.data
                    .fit(&self.of_joint(&fit.model, dof, nominal), self.scales, &|_| true),
            )
        };
        let (with, without) = (judge(&[]), judge(own));
        self.above_floor(&without.fit)[dof]
            && self.is_better(&without, &with, count)
            && self.beyond_contact(&without, &with)
    }

    /// The model with the effect `kind` on `target` in the place of `own` of degree of freedom `dof`, where that does what re-tuning those
    /// does: beside their nominal values it predicts no worse, or takes all but a trifle of what they take, as more numbers also bend to
    /// what else a model is wrong about. The joint's other numbers are fitted with all.
    pub fn standing_for(&self, fit: &Fit, dof: usize, own: &[Own], (kind, target): (Kind, usize)) -> Option<Model> {
        let nominal = self.of_joint(&fit.model, dof, own);
        let with = |term: Term| {
            let mut model = nominal.clone();
            model.put(term);
            model
        };
        let judge = |model: &Model| self.judge(self.data.fit(model, self.scales, &|_| true));
        let (tuned, plain) = (judge(&self.of_joint(&fit.model, dof, &[])), judge(&nominal));
        let beyond = |judged: &Judged| total(&judged.cross) - total(&tuned.cross);
        let stands = |effect: &Judged| !self.is_worse(effect, &tuned) || beyond(effect) < WORTH_OF_GAP * beyond(&plain);
        let ways = candidates::each(kind, target, self.robot, self.scales, &[]).into_iter();
        let mut effects = ways.map(|way| {
            let starts = way.starts.into_iter().map(with).collect();
            judge(&candidates::promising(self.data, starts, self.scales))
        });
        Some(effects.find(stands)?.fit.model)
    }

    /// `model` with all held but what it has on degree of freedom `dof`, of which `nominal` are held at their nominal values.
    fn of_joint(&self, model: &Model, dof: usize, nominal: &[Own]) -> Model {
        let mut model = model.clone();
        model.hold_others(self.robot, Some(dof));
        let straight = model
            .tuned
            .iter_mut()
            .filter(|tuned| tuned.dof == dof && nominal.contains(&tuned.own));
        straight.for_each(|tuned| (tuned.value, tuned.held) = (tuned.nominal, true));
        model
    }

    pub(super) fn judge(&self, fit: Fit) -> Judged {
        let cross = self.folds.cross(self.data, &fit, self.scales);
        Judged { fit, cross }
    }

    /// `results` of `candidates` beside `before`, of which the numbers of other joints were held, as they would be judged had those been left to
    /// each fold too: what `before` predicts worse for that, its joints have alike with the candidate. Not of robots that walk, whose joints
    /// without an effect are held until the end.
    pub(super) fn with_others_left_out(
        &self,
        before: &Judged,
        candidates: &[&Candidate],
        mut results: Vec<Attempted>,
    ) -> Vec<Attempted> {
        if self.data.is_free() {
            return results;
        }
        let held = |result: &Attempted| result.as_ref().is_ok_and(|judged| judged.fit.model.is_held());
        let joints = results.iter().zip(candidates).filter(|(result, _)| held(result));
        let joints: BTreeSet<usize> = joints.filter_map(|(_, own)| own.joint(self.robot, self.data)).collect();
        let joints: Vec<usize> = joints.into_iter().collect();
        let costs: Vec<Vec<f64>> = joints
            .par_iter()
            .map(|&joint| self.cost_of_others(before, joint))
            .collect();
        for (result, candidate) in results.iter_mut().zip(candidates) {
            let (Ok(judged), Some(joint)) = (result, candidate.joint(self.robot, self.data)) else {
                continue;
            };
            let Ok(place) = joints.binary_search(&joint) else {
                continue;
            };
            for (loss, cost) in judged.cross.iter_mut().zip(&costs[place]) {
                loss.squares = (loss.squares + cost).max(0.0);
            }
        }
        results
    }

    /// By how much `before` predicts worse, by block and degree of freedom, where numbers of joints other than `joint` are left to the folds too.
    fn cost_of_others(&self, before: &Judged, joint: usize) -> Vec<f64> {
        let mut model = before.fit.model.clone();
        model.hold_others(self.robot, Some(joint));
        let alone = self.judge(Descent::new(self.data, &model, self.scales).fit);
        let both = before.cross.iter().zip(&alone.cross);
        both.map(|(all, own)| all.squares - own.squares).collect()
    }

    /// Fits all of `model`, from its values and from the nominal ones of what is re-tuned: what bent to make up for an effect
    /// that was missing need not find its way back.
    pub(super) fn fit(&self, model: &Model) -> Judged {
        let mut model = model.clone();
        model.hold_others(self.robot, None);
        self.fit_free(model)
    }

    /// The same on the way. A robot that walks freely is fitted as a whole, which is dear: until the end what it has on joints without an
    /// effect stays as it was re-tuned.
    pub(super) fn fit_near(&self, model: &Model) -> Judged {
        let mut model = model.clone();
        model.hold_others(self.robot, None);
        if self.data.is_free() && !model.terms.is_empty() {
            model.hold_plain(self.robot);
        }
        self.fit_free(model)
    }

    fn fit_free(&self, model: Model) -> Judged {
        let mut starts = vec![model];
        if !starts[0].terms.is_empty() {
            let mut straight = starts[0].clone();
            straight.straighten();
            starts.push(straight);
        }
        self.judge(self.data.fit_shaken(&starts, self.scales))
    }

    /// The fit with the terms of `model`, which may be known already: from where it was fitted first, which may be a lesser
    /// minimum than the values of `model` lead to.
    pub(super) fn known(&self, steps: &mut Steps, model: &Model) -> Judged {
        let own = terms(model);
        let Some(place) = steps.known.iter().position(|(terms, _)| *terms == own) else {
            let judged = self.fit_near(model);
            steps.known.push((own, judged.clone()));
            return judged;
        };
        let known = &mut steps.known[place].1;
        let here = total(&self.data.losses(std::slice::from_ref(model))[0]);
        if here < (1.0 - LESSER) * total(&known.fit.losses) {
            *known = self.fit_near(model);
        }
        known.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::cross::Folds;
    use super::super::super::cut::Lengths;
    use super::super::super::floor::Floor;
    use super::super::super::hinge::{chain, read, swings};
    use super::super::super::leftover;
    use super::super::super::model::Tuned;
    use super::super::super::scales::Scales;
    use super::*;

    #[test]
    fn what_holds_other_joints_numbers_predicts_no_better_for_that() {
        let robot = chain(&["upper", "lower"], "kp = 30.0\nkd = 1.0\ndamping = 0.1\n");
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let mut data = swings(&robot, 2, lengths);
        let nominal = Model::nominal(&robot, &data.trials);
        read(&mut data, &nominal);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        let before = selector.fit(&nominal);
        let candidates = selector.candidates(&before.fit.model);
        let delay = candidates
            .iter()
            .find(|own| (own.kind, own.target) == (Kind::CommandDelay, 1));
        // A candidate that does nothing.
        let mut model = before.fit.model.clone();
        model.hold_others(&robot, Some(1));
        let nothing = selector.judge(Descent::new(&data, &model, &scales).fit);
        assert!(
            total(&nothing.cross) < total(&before.cross),
            "fewer numbers are left to the folds"
        );
        let judged = selector.with_others_left_out(&before, &[delay.expect("a candidate")], vec![Ok(nothing)]);
        let judged = judged[0].as_ref().expect("judged");
        let off = total(&judged.cross) / total(&before.cross) - 1.0;
        assert!(off.abs() < 1e-9, "it gains {off}");
    }

    #[test]
    fn re_tuning_is_needed_where_more_than_noise_is_left_without_it() {
        let robot = chain(&["upper", "lower"], "kp = 30.0\nkd = 1.0\ndamping = 0.1\n");
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let mut data = swings(&robot, 2, lengths);
        let nominal = Model::nominal(&robot, &data.trials);
        let soft = |tuned: &Tuned| (tuned.dof, tuned.own) == (1, Own::KpScale);
        let mut truth = nominal.clone();
        let stiffness = truth.tuned.iter_mut().find(|tuned| soft(tuned));
        stiffness.expect("its stiffness").value *= 0.9;
        read(&mut data, &truth);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let mut selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        selector.negligible = vec![0.0; 2];
        let fit = selector.fit(&nominal).fit;
        let mut without = nominal.clone();
        without.tuned.retain(|tuned| !soft(tuned));
        let left = leftover::squares(&data, &selector.fit(&without).fit.model)[1];
        // The nominal stiffness leaves so many times the floor.
        for (times, is_needed) in [(2.0, true), (1.3, false)] {
            selector.floors[1] = left / times;
            assert_eq!(
                selector.retuning_helps(&fit, 1, &[Own::KpScale], 2),
                is_needed,
                "{times}"
            );
        }
    }
}
