//! Every effect of the catalogue at once: what the choice is compared with, and no part of it.

use super::super::fit::{Fit, total};
use super::super::model::{Model, Term};
use super::Selector;

/// Fits of a single joint that follow each other, until one takes no more than [`LITTLE`]; of several joints, which have a hundred effects and
/// more, there is one.
const ROUNDS: usize = 4;
/// Share of the loss.
const LITTLE: f64 = 0.01;
/// Effects begin at their start or this far from what does nothing, in shares of the way there.
const NEAR: [f64; 2] = [1.0, 0.05];
/// All of them together at these shares of where each begins by itself.
const TOGETHER: [f64; 4] = [1.0, 0.3, 0.1, 0.0];

impl Selector<'_> {
    /// `tuned` with every effect that the robot can have, each from the start that alone predicts best or from its first, fitted together;
    /// never worse than `tuned`, as effects can do nothing.
    pub fn all_at_once(&self, tuned: &Model) -> Model {
        let mut free = tuned.clone();
        free.hold_others(self.robot, None);
        let (mut terms, mut first): (Vec<Term>, Vec<Term>) = (Vec::new(), Vec::new());
        for candidate in self.candidates(tuned) {
            if terms
                .iter()
                .any(|term| (term.kind, term.target) == (candidate.kind, candidate.target))
            {
                continue;
            }
            let starts: Vec<Term> = candidate
                .starts
                .iter()
                .flat_map(|start| NEAR.map(|share| towards(start, share)))
                .collect();
            let best = self.likeliest(
                starts
                    .iter()
                    .map(|start| with(&free, std::slice::from_ref(start)))
                    .collect(),
            );
            terms.push(starts[best].clone());
            first.push(candidate.starts[0].clone());
        }
        let shrunk = |share: f64| terms.iter().map(|term| towards(term, share)).collect::<Vec<_>>();
        let mut starts: Vec<Model> = TOGETHER.iter().map(|&share| with(&free, &shrunk(share))).collect();
        let likeliest = starts.swap_remove(self.likeliest(starts.clone()));
        let mut fit = self.settled(&likeliest);
        if self.is_single() {
            // The best start is not always the one from which the way leads farthest.
            let far = self.settled(&with(&free, &first));
            fit = if total(&fit.losses) < total(&far.losses) {
                fit
            } else {
                far
            };
        }
        let plain = total(&self.data.losses(std::slice::from_ref(&free))[0]);
        if total(&fit.losses) < plain { fit.model } else { free }
    }

    fn is_single(&self) -> bool {
        self.robot.dofs.len() == 1
    }

    /// `start` fitted until that takes no more.
    fn settled(&self, start: &Model) -> Fit {
        let mut fit = self.data.fit(start, self.scales, &|_| true);
        let rounds = if self.is_single() { ROUNDS } else { 1 };
        for _ in 1..rounds {
            let again = self.data.fit(&fit.model, self.scales, &|_| true);
            let fell = 1.0 - total(&again.losses) / total(&fit.losses);
            fit = again;
            if fell < LITTLE {
                break;
            }
        }
        fit
    }

    /// Which of `models` predicts best as it is.
    fn likeliest(&self, models: Vec<Model>) -> usize {
        let losses = self.data.losses(&models);
        let order = (0..models.len()).min_by(|&a, &b| total(&losses[a]).total_cmp(&total(&losses[b])));
        order.unwrap_or(0)
    }
}

fn with(model: &Model, terms: &[Term]) -> Model {
    let mut model = model.clone();
    terms.iter().for_each(|term| model.put(term.clone()));
    model
}

/// `term` with what can do nothing at this share of its way from there.
fn towards(term: &Term, share: f64) -> Term {
    let parameters = &term.kind.info().parameters;
    let mut term = term.clone();
    for &i in &term.free {
        if let Some(nothing) = parameters.get(i).and_then(|parameter| parameter.neutral) {
            term.values[i] = nothing + share * (term.values[i] - nothing);
        }
    }
    term
}
