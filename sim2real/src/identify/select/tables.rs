//! A measured table of what a joint lacks, fitted in rollouts: what stands in for an effect that no library has. It is judged by whole logs, where
//! there are several: it is to hold in other motions, and what goes with the time since the start of a log is in all of them at the same time.

use omniwalk_env::effect::{Kind, Table, Variable};
use rayon::prelude::*;

use super::super::descent::Descent;
use super::super::fit::{Fit, Loss, total};
use super::super::grid;
use super::super::model::{Model, Term, joint_of};
use super::super::torque::{self, Form, Moment};
use super::{Selection, Selector};

/// Points of a table: with the numbers of a joint that are re-tuned they fill the lanes.
const POINTS: usize = 9;
/// Points of a finer one of what repeats within the range: so many times more.
const FINER: usize = 4;
/// Tables over different variables are compared when they were begun with rough data; so many are finished.
const FINISHED: usize = 3;
/// Least fall of the cross-validated loss by a table.
const WORTH: f64 = 0.05;
/// Probability by chance of the best table's gain.
const CHANCE: f64 = 0.05;

/// A table that was fitted beside a model, with what is re-tuned of its joint.
pub struct Tabled {
    /// What it is over.
    pub over: Over,
    /// The model with it.
    pub model: Model,
    cross: Vec<Loss>,
    /// The cross-validated loss of the model that it was fitted beside.
    before: Vec<Loss>,
}

impl Tabled {
    /// The cross-validated loss.
    pub(super) fn cross(&self) -> &[Loss] {
        &self.cross
    }

    /// Share of the cross-validated loss that it takes.
    pub fn share(&self) -> f64 {
        self.share_of(&self.cross)
    }

    /// The same of another model, which predicts with `losses`.
    pub(super) fn share_of(&self, losses: &[Loss]) -> f64 {
        1.0 - total(losses) / total(&self.before)
    }
}

/// What a table is over: a variable's index among [`torque::names`], and how the torque goes with it.
pub type Over = (usize, Form);

impl Selector<'_> {
    /// The best table beside the model of `fit` of what degree of freedom `dof` lacks over one of the variables that simulations know, if it
    /// predicts better than none beyond chance.
    pub fn table(&self, fit: &Fit, dof: usize, moments: &[Moment]) -> Option<Tabled> {
        let all: Vec<Over> = torque::simulated().collect();
        let best = self.best_table(fit, dof, moments, &all)?;
        let gain = self.logs.gain(&best.before, &best.cross);
        (gain.share >= WORTH && gain.p * all.len() as f64 <= CHANCE).then_some(best)
    }

    /// The best of the tables over `variables` beside the model of `fit`.
    pub(super) fn best_table(&self, fit: &Fit, dof: usize, moments: &[Moment], variables: &[Over]) -> Option<Tabled> {
        let rough = self.data.rough();
        let begin = |over: &Over| {
            let table = grid::empty_table(moments, *over, POINTS)?;
            let model = self.with_table(&fit.model, dof, table);
            Some((*over, Descent::begun(&rough, &model, self.scales)))
        };
        let mut ways: Vec<(Over, Descent)> = variables.par_iter().filter_map(begin).collect();
        ways.sort_by(|(_, a), (_, b)| a.loss().total_cmp(&b.loss()));
        ways.truncate(FINISHED);
        let before = self.logs.cross(self.data, fit, self.scales);
        let finish = |(over, way): (Over, Descent)| self.finished(&way.fit.model, over, &before);
        let finished: Vec<Tabled> = ways.into_par_iter().map(finish).collect();
        let best = finished.into_iter().max_by(|a, b| a.share().total_cmp(&b.share()))?;
        let fine = self.finer_table(&best, moments);
        let better = fine.filter(|fine| total(&fine.cross) < (1.0 - WORTH) * total(&best.cross));
        let mut table = better.unwrap_or(best);
        table.model.hold_others(self.robot, None);
        Some(table)
    }

    /// `model`, which has a table, fitted; without it the loss is `before`.
    fn finished(&self, model: &Model, over: Over, before: &[Loss]) -> Tabled {
        let own = self.data.fit(model, self.scales, &|_| true);
        Tabled {
            over,
            cross: self.logs.cross(self.data, &own, self.scales),
            model: own.model,
            before: before.to_vec(),
        }
    }

    /// The same table with more points.
    fn finer_table(&self, coarse: &Tabled, moments: &[Moment]) -> Option<Tabled> {
        let mut model = coarse.model.clone();
        let term = model.terms.last_mut()?;
        let (before, mut table) = (
            term.effect().table?,
            grid::empty_table(moments, coarse.over, FINER * POINTS)?,
        );
        let (_, grid) = &table.axes[0];
        term.values = grid.iter().map(|&x| before.torque(|_| x)).collect();
        term.free = (0..term.values.len()).collect();
        table.values.clone_from(&term.values);
        term.table = Some(table);
        Some(self.finished(&model, coarse.over, &coarse.before))
    }

    /// `model` with `table` on degree of freedom `dof`, its other joints and all effects held.
    fn with_table(&self, model: &Model, dof: usize, table: Table) -> Model {
        let mut model = model.clone();
        model.hold_others(self.robot, Some(dof));
        model.terms.iter_mut().for_each(|term| term.held = true);
        model.terms.push(Term {
            kind: Kind::ResidualTorque,
            target: dof,
            free: (0..table.values.len()).collect(),
            values: table.values.clone(),
            table: Some(table),
            held: false,
        });
        model
    }

    /// Takes out the effects of each joint of which much is left (`open`) where a table predicts better without them: what no library has
    /// looks like this and that of it, and a wrong name is worse than none. A table that is a freer form of one of them has to predict
    /// better beyond chance. One that predicts no worse is no reason: effects carry over to motions that a table has not seen.
    pub fn prefer_tables(&self, selection: &mut Selection, open: &dyn Fn(&Selection) -> Vec<usize>) {
        for dof in open(selection) {
            let on_joint = |term: &Term| joint_of(self.robot, term.kind.info().site, term.target) == Some(dof);
            let mut base = selection.last.model.clone();
            base.terms.retain(|term| !on_joint(term));
            if base.terms.len() == selection.last.model.terms.len() {
                continue;
            }
            let without = self.fit(&base).fit;
            let Ok(moments) = torque::lacking(self.data, &without.model, self.scales) else {
                continue;
            };
            let all: Vec<Over> = torque::simulated().collect();
            let table = self.best_table(&without, dof, &moments[dof], &all);
            let predicted = self.logs.cross(self.data, &selection.last, self.scales);
            let terms = &selection.last.model.terms;
            let is_better = |table: &Tabled| {
                if terms.iter().any(|term| on_joint(term) && is_curve_of(term, table.over)) {
                    return self.apart(&predicted, &table.cross);
                }
                total(&table.cross) <= total(&predicted)
            };
            if let Some(table) = table.filter(is_better) {
                let over = torque::names(&self.data.trials[0], dof).swap_remove(table.over.0);
                let reason = format!("a measured table over {over} predicts better");
                selection.take_out(&on_joint, without, &reason);
            }
        }
    }
}

/// Whether a table over `variable` is the effect of `term` in any shape.
fn is_curve_of(term: &Term, (variable, _): Over) -> bool {
    term.kind == Kind::StribeckFriction && Variable::ALL[variable] == Variable::Velocity
}
