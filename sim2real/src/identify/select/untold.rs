//! Numbers of the nominal model that the logs do not tell keep their nominal values.

use super::super::descent::Descent;
use super::super::fit::{Fit, total};
use super::super::interval;
use super::super::model::Model;
use super::{Selection, Selector};

/// What a number adds to the loss at its nominal value, as a share, when logs do not tell it: no more than where a fit ends.
const NO_WORSE: f64 = 1e-3;

impl Selector<'_> {
    /// Puts the re-tuned numbers of the last model that have no interval, then those that are less than half their interval too, back to
    /// where the robot has them, and fits the others, where that is no worse: where a descent over what makes no difference ended is no
    /// finding.
    pub fn keep_untold(&self, selection: &mut Selection) {
        for wide in [
            |half: f64, _: f64| half.is_infinite(),
            |half, value: f64| half >= value.abs(),
        ] {
            let halves = interval::intervals(self, &selection.last);
            let tuned = selection.last.model.tuned.iter().zip(&halves);
            let untold: Vec<bool> = tuned.map(|(tuned, half)| wide(half.most, tuned.value)).collect();
            if let Some(kept) = self.at_nominal(&selection.last, &untold) {
                selection.last = kept;
            }
        }
    }

    /// `fit` with the numbers of `untold` at their nominal values, the others fitted, if that is no worse.
    fn at_nominal(&self, fit: &Fit, untold: &[bool]) -> Option<Fit> {
        let moved = |model: &Model| {
            let own = model.tuned.iter().zip(untold);
            own.into_iter()
                .any(|(tuned, untold)| *untold && tuned.value != tuned.nominal)
        };
        if !moved(&fit.model) {
            return None;
        }
        let mut model = fit.model.clone();
        for (tuned, _) in model.tuned.iter_mut().zip(untold).filter(|(_, untold)| **untold) {
            tuned.value = tuned.nominal;
            tuned.held = true;
        }
        let mut model = self.data.fit(&model, self.scales, &|_| true).model;
        model.tuned.iter_mut().for_each(|tuned| tuned.held = false);
        let kept = Descent::new(self.data, &model, self.scales).fit;
        (total(&kept.losses) <= (1.0 + NO_WORSE) * total(&fit.losses)).then_some(kept)
    }
}
