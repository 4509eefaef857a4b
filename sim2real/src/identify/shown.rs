//! What motions of a joint show of the library's effects before anything is recorded, and which of them they do not show apart.

use std::collections::BTreeMap;

use nalgebra::DMatrix;
use omniwalk_env::robot::Robot;
use serde::Serialize;

use super::candidates;
use super::fit::Data;
use super::model::{Model, Term, joint_of};
use super::rehearsed::{Condition, rehearsed, weighed};
use super::scales::Scales;
use super::screen;
use super::trial::TrialError;
use crate::excite::Motion;

/// Cycles over the range of motion of the ripple that is looked at.
const CYCLES: f64 = 4.0;
/// An effect is not shown apart from others, or from re-tuning, where they do all but this share of the square of what it does.
const OWN: f64 = 1e-3;

/// Size of an effect that is fitted from nothing, in units of what is typical.
const LEAST: f64 = 0.1;

/// Two effects that the motions do not show apart.
#[derive(Clone, Debug, Serialize)]
pub struct Confused {
    /// The joint whose motions they are.
    pub joint: String,
    /// Their names; one alone is not told from what the nominal model has.
    pub effects: Vec<String>,
    /// What to do with the same motions that shows them apart, if anything does.
    pub told: Option<&'static str>,
}

/// What motions of a joint show.
pub struct Shown {
    /// Of every motion, by effect at a typical size: root mean square of what it changes of the readings beside re-tuning, rad or m.
    pub motions: Vec<BTreeMap<String, f64>>,
    /// What all of them together do not show apart.
    pub confused: Vec<Confused>,
}

/// What `motions` of degree of freedom `dof` of `robot`, whose base is held, show of the effects on that joint and the link it moves.
///
/// # Errors
/// [`TrialError`] when the robot has nothing to command.
pub fn shown(robot: &Robot, dof: usize, motions: &[Motion]) -> Result<Shown, TrialError> {
    let joint = Joint::new(robot, dof, motions)?;
    let plain = joint.products(motions, Condition::Plain)?;
    let of_motion = |(products, readings): &(DMatrix<f64>, f64)| {
        let (left, _) = joint.beside_retuning(products);
        let size = |k: usize| (left[(k + 1, k + 1)].max(0.0) / readings.max(1.0)).sqrt();
        joint
            .names
            .iter()
            .enumerate()
            .map(|(k, name)| (name.clone(), size(k)))
            .collect()
    };
    let together = |parts: &[(DMatrix<f64>, f64)]| parts.iter().map(|(products, _)| products).sum::<DMatrix<f64>>();
    let sum = together(&plain);
    let mut confused: Vec<(Vec<usize>, Option<&'static str>)> = Vec::new();
    confused.extend(joint.confused(&sum).into_iter().map(|set| (set, None)));
    for condition in Condition::ALL.into_iter().skip(1) {
        if confused.iter().all(|(_, told)| told.is_some()) {
            break;
        }
        let more = joint.products(motions, condition)?;
        let still = joint.confused(&(&sum + together(&more)));
        for (set, told) in confused.iter_mut().filter(|(_, told)| told.is_none()) {
            *told = (!still.contains(set)).then(|| condition.how().trim());
        }
    }
    Ok(Shown {
        motions: plain.iter().map(of_motion).collect(),
        confused: confused
            .into_iter()
            .map(|(set, told)| Confused {
                joint: robot.dof(dof).name.clone(),
                effects: set.into_iter().map(|k| joint.names[k].clone()).collect(),
                told,
            })
            .collect(),
    })
}

/// A joint with the effects that it may have.
struct Joint<'a> {
    robot: &'a Robot,
    dof: usize,
    /// Names of the effects.
    names: Vec<String>,
    /// The nominal model, with each of the joint's numbers moved, and with each effect.
    models: Vec<Model>,
}

impl<'a> Joint<'a> {
    fn new(robot: &'a Robot, dof: usize, motions: &[Motion]) -> Result<Self, TrialError> {
        let mut trials = Vec::new();
        for motion in motions {
            let data = rehearsed(robot, motion, Condition::Plain, vec![1.0; robot.dofs.len()])?;
            trials.extend(data.trials.iter().cloned());
        }
        let scales = Scales::new(robot, &trials);
        let mut nominal = Model::nominal(robot, &trials);
        nominal.hold_others(robot, Some(dof));
        let data = Data::new(robot, trials)?;
        let ripples = scales
            .joints
            .iter()
            .map(|joint| vec![CYCLES / joint.position])
            .collect();
        let mut models = vec![nominal.clone()];
        models.extend(screen::steps(&nominal, &scales, |_| true));
        let mut names: Vec<String> = Vec::new();
        for candidate in candidates::all(robot, &data, &nominal, &scales, &ripples) {
            let name = candidate.kind.id().to_owned();
            // Variants of an effect show in the same motions, and so do links that move together.
            if joint_of(robot, candidate.kind.info().site, candidate.target) != Some(dof) || names.contains(&name) {
                continue;
            }
            let mut model = nominal.clone();
            model.put(typical(&candidate.starts[candidate.starts.len() / 2], &scales));
            models.push(model);
            names.push(name);
        }
        Ok(Self {
            robot,
            dof,
            names,
            models,
        })
    }

    /// Of every one of `motions` under `condition`: products of what the models do otherwise than the nominal one, and readings.
    fn products(&self, motions: &[Motion], condition: Condition) -> Result<Vec<(DMatrix<f64>, f64)>, TrialError> {
        let mut weights = vec![0.0; self.robot.dofs.len()];
        weights[self.dof] = 1.0;
        let of = |motion: &Motion| {
            let data = rehearsed(self.robot, motion, condition, weights.clone())?;
            Ok((data.products(&self.models), weighed(&data)))
        };
        motions.iter().map(of).collect()
    }

    /// What effects do less what re-tuning takes of it, and all of it; row and column 0 mean nothing.
    fn beside_retuning(&self, products: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
        screen::without(products, self.models.len() - 1 - self.names.len())
    }

    /// Effects, or pairs of them, that are not shown apart by motions with the `products`.
    fn confused(&self, products: &DMatrix<f64>) -> Vec<Vec<usize>> {
        let (left, all) = self.beside_retuning(products);
        let square = |i: usize| left[(i + 1, i + 1)];
        let shown = |i: &usize| square(*i) > OWN * all[(i + 1, i + 1)];
        let alone = (0..self.names.len()).filter(|i| !shown(i)).map(|i| vec![i]);
        let apart = |i: usize, j: usize| 1.0 - left[(i + 1, j + 1)].powi(2) / (square(i) * square(j)) > OWN;
        let seen: Vec<usize> = (0..self.names.len()).filter(shown).collect();
        let pairs = seen.iter().flat_map(|&i| seen.iter().map(move |&j| (i, j)));
        let pairs = pairs.filter(|&(i, j)| i < j && !apart(i, j)).map(|(i, j)| vec![i, j]);
        alone.chain(pairs).collect()
    }
}

/// `term` with a typical size where it does nothing.
fn typical(term: &Term, scales: &Scales) -> Term {
    let info = term.kind.info();
    let mut term = term.clone();
    for &i in &term.free {
        let parameter = &info.parameters[i];
        if parameter.neutral == Some(term.values[i]) {
            let largest = parameter.starts.iter().fold(LEAST, |a, s| a.max(s.abs()));
            term.values[i] += largest * scales.of(parameter.scale, info.site, term.target);
        }
    }
    term
}
