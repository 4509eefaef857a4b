//! Fits of models and what they predict of data they were not fitted to.

use omniwalk_env::effect::Kind;

use super::super::candidates;
use super::super::fit::{Fit, total};
use super::super::model::{Model, Term};
use super::super::own::Own;
use super::worth::WORTH_OF_GAP;
use super::{Judged, LESSER, Selector, Steps, terms};

impl Selector<'_> {
    /// Whether re-tuning `own` of degree of freedom `dof` from their nominal values predicts so much better that it is no accident, for
    /// one of `count` such tests; the joint's other numbers are fitted with and without.
    pub fn retuning_helps(&self, fit: &Fit, dof: usize, own: &[Own], count: usize) -> bool {
        let judge = |nominal: &[Own]| {
            self.judge(
                self.data
                    .fit(&self.of_joint(&fit.model, dof, nominal), self.scales, &|_| true),
            )
        };
        let (with, without) = (judge(&[]), judge(own));
        self.is_better(&without, &with, count) && self.beyond_contact(&without, &with)
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
        let effects = candidates::each(kind, target, self.robot, self.scales, &[]);
        let starts: Vec<Model> = effects.into_iter().flat_map(|effect| effect.starts).map(with).collect();
        let effect = candidates::promising(self.data, starts, self.scales);
        let [effect, tuned, nominal] = [effect, self.of_joint(&fit.model, dof, &[]), nominal]
            .map(|model| self.judge(self.data.fit(&model, self.scales, &|_| true)));
        let beyond = |judged: &Judged| total(&judged.cross) - total(&tuned.cross);
        let stands = !self.apart(&effect.cross, &tuned.cross) || beyond(&effect) < WORTH_OF_GAP * beyond(&nominal);
        stands.then_some(effect.fit.model)
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
