//! What was found, of one limb or of all of them together.

use omniwalk_env::effect::{Kind, Site};
use omniwalk_env::robot::Limb;

use super::floor::Floor;
use super::information::Information;
use super::leftover::Leftover;
use super::model::{Model, Term, Tuned};
use super::select::{Alike, Rejected};
use super::separate::Separation;

/// What was found; degrees of freedom and links are those of the robot it was looked for in.
pub struct Found {
    /// The nominal model re-tuned.
    pub refit: Model,
    /// The last model.
    pub last: Model,
    /// The last model without each of its effects, fitted.
    pub without: Vec<Model>,
    /// Every effect at once, where that was asked for.
    pub all_at_once: Option<Model>,
    /// Half widths of the intervals of the last model's numbers: those that are re-tuned, then those of effects.
    pub intervals: Vec<f64>,
    /// Probability by chance of each effect's gain.
    pub p_values: Vec<f64>,
    /// What was not taken.
    pub rejected: Vec<Rejected>,
    /// What cannot be told apart.
    pub alike: Vec<Alike>,
    /// Sets of re-tuned numbers with what would move them as one.
    pub causes: Vec<Vec<String>>,
    /// What would tell apart what cannot be told apart.
    pub separations: Vec<Separation>,
    /// Effects tried in the largest step.
    pub tried: usize,
    /// What is left.
    pub left: Leftover,
    /// The floor.
    pub floor: Floor,
    /// What the logs can tell of the nominal model.
    pub information: Vec<Information>,
    /// What the folds of the cross-validation are.
    pub folds: String,
    /// Physics steps a millisecond.
    pub finer: usize,
}

impl Found {
    /// What was found of every limb of a robot with `dofs` degrees of freedom, as of the whole robot.
    pub fn together(parts: Vec<(Limb, Self)>, dofs: usize) -> Option<Self> {
        let parts = parts.into_iter().map(|(limb, found)| found.of_whole(&limb, dofs));
        parts.reduce(Self::and)
    }

    /// The same of the whole robot, of which it is `limb`.
    fn of_whole(mut self, limb: &Limb, dofs: usize) -> Self {
        let models = [&mut self.refit, &mut self.last, &mut self.left.model].into_iter();
        let models = models.chain(&mut self.without).chain(&mut self.all_at_once);
        models.for_each(|model| lift(model, limb));
        for rejected in &mut self.rejected {
            rejected.target = of_whole(limb, rejected.kind, rejected.target);
        }
        for alike in &mut self.alike {
            for (kind, target) in [&mut alike.chosen].into_iter().chain(&mut alike.others) {
                *target = of_whole(limb, *kind, *target);
            }
        }
        self.left
            .joints
            .iter_mut()
            .for_each(|left| left.dof = limb.dofs[left.dof]);
        self.left.autocorrelation = spread(&self.left.autocorrelation, limb, dofs);
        self.floor = self.floor.of_whole(limb, dofs);
        self
    }

    /// With what was found of another limb.
    fn and(self, other: Self) -> Self {
        let own = self.last.tuned.len();
        let (mut intervals, effects) = (self.intervals[..own].to_vec(), &self.intervals[own..]);
        let (tuned, more) = other.intervals.split_at(other.last.tuned.len());
        for part in [tuned, effects, more] {
            intervals.extend_from_slice(part);
        }
        let without = self.without.iter().map(|without| without.and(&other.last));
        let without = without.chain(other.without.iter().map(|without| self.last.and(without)));
        Self {
            without: without.collect(),
            refit: self.refit.and(&other.refit),
            last: self.last.and(&other.last),
            all_at_once: self.all_at_once.zip(other.all_at_once).map(|(a, b)| a.and(&b)),
            intervals,
            p_values: [self.p_values, other.p_values].concat(),
            rejected: [self.rejected, other.rejected].concat(),
            alike: [self.alike, other.alike].concat(),
            causes: [self.causes, other.causes].concat(),
            separations: [self.separations, other.separations].concat(),
            tried: self.tried.max(other.tried),
            left: self.left.and(other.left),
            floor: self.floor.and(&other.floor),
            information: [self.information, other.information].concat(),
            folds: self.folds,
            finer: self.finer.max(other.finer),
        }
    }
}

/// Makes a `model` of a limb one of the whole robot.
pub fn lift(model: &mut Model, limb: &Limb) {
    for tuned in &mut model.tuned {
        tuned.dof = limb.dofs[tuned.dof];
    }
    for term in &mut model.terms {
        term.target = of_whole(limb, term.kind, term.target);
    }
}

/// What a `model` of the whole robot has of a limb, as a model of that.
pub fn lowered(model: &Model, limb: &Limb) -> Model {
    let place = |all: &[usize], one: usize| all.iter().position(|&other| other == one);
    let mut out = Model::default();
    for tuned in &model.tuned {
        let dof = place(&limb.dofs, tuned.dof);
        out.tuned.extend(dof.map(|dof| Tuned { dof, ..tuned.clone() }));
    }
    for term in &model.terms {
        let target = match term.kind.info().site {
            Site::Joint => place(&limb.dofs, term.target),
            Site::Link => place(&limb.links, term.target),
        };
        out.terms.extend(target.map(|target| Term { target, ..term.clone() }));
    }
    out
}

fn of_whole(limb: &Limb, kind: Kind, target: usize) -> usize {
    match kind.info().site {
        Site::Joint => limb.dofs[target],
        Site::Link => limb.links[target],
    }
}

/// One value a degree of freedom of `limb` among the `dofs` of the whole robot, the default elsewhere.
pub fn spread<T: Clone + Default>(values: &[T], limb: &Limb, dofs: usize) -> Vec<T> {
    let mut out = vec![T::default(); dofs];
    for (&d, value) in limb.dofs.iter().zip(values) {
        out[d] = value.clone();
    }
    out
}

/// Sums by degree of freedom; what one of them does not have is zero.
pub fn sums(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}
