//! Which motion would tell apart what the logs do not: those of `omniwalk excite`, simulated with both models.
//!
//! Of what the models do otherwise counts what neither can make up for by its own numbers, to first order, with the logs that there are
//! and the motion together.

use std::fmt;

use nalgebra::DMatrix;
use omniwalk_env::effect::{Kind, Site};
use omniwalk_env::robot::{Limb, Robot};
use serde::Serialize;

use super::causes::Cause;
use super::fit::Data;
use super::floor::Floor;
use super::found;
use super::model::{Model, Term, joint_of};
use super::rehearsed::{Condition, rehearsed, weighed};
use super::scales::Scales;
use super::screen;
use super::select::Selection;
use crate::excite::{Plan, commanded, held};

/// Models are told apart where they part by this share of the floor or more: by a fifth of the loss there.
const TOLD: f64 = 0.5;
/// No floor is lower, rad or m.
const LOWEST: f64 = 1e-5;

/// What would tell two models apart.
#[derive(Clone, Debug, Serialize)]
pub struct Separation {
    /// The two effects, or the effect and re-tuned numbers.
    pub between: [String; 2],
    /// The motion of `omniwalk excite` in which they part most, and how it is recorded.
    pub motion: String,
    /// Root mean square of what they do otherwise there, over the noise floor.
    pub apart: f64,
    /// Whether that is enough.
    pub tells: bool,
}

impl fmt::Display for Separation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            between: [a, b],
            motion,
            apart,
            tells,
        } = self;
        if *tells {
            write!(f, "{motion} would tell {a} from {b}: {apart:.1} times the noise floor")
        } else {
            write!(
                f,
                "no motion of omniwalk excite would tell {a} from {b}: {motion} by {apart:.2} of the noise floor"
            )
        }
    }
}

/// Where models of `robot` are compared: with what there is already.
pub struct Logs<'a> {
    /// The robot: a limb, or one that walks.
    pub robot: &'a Robot,
    /// Logs that were fitted.
    pub data: &'a Data,
    /// Typical values.
    pub scales: &'a Scales,
    /// What no model gets below.
    pub floor: &'a Floor,
}

impl Logs<'_> {
    /// What would tell apart the sets of a `selection`, and the numbers that were re-tuned from their `causes`.
    pub fn separations(&self, selection: &Selection, causes: &[Cause]) -> Vec<Separation> {
        let last = &selection.last.model;
        let mut out = Vec::new();
        for alike in &selection.alike {
            let Some(chosen) = last.term(alike.chosen.0, alike.chosen.1) else {
                continue;
            };
            for (&other, model) in alike.others.iter().zip(&alike.models) {
                let between = [alike.chosen, other].map(|own| self.named(own));
                let other = model
                    .term(other.0, other.1)
                    .map(|term| self.exchanged(last, chosen, term, model));
                out.extend(other.and_then(|other| self.separation(between, last, &other)));
            }
        }
        for (effect, model) in causes.iter().flat_map(|cause| &cause.effects) {
            let between = [self.named(*effect), "what was re-tuned".to_owned()];
            out.extend(self.separation(between, last, model));
        }
        out
    }

    fn named(&self, (kind, target): (Kind, usize)) -> String {
        let name = match kind.info().site {
            Site::Joint => &self.robot.dof(target).name,
            Site::Link => &self.robot.links[target].name,
        };
        format!("{} of {name}", kind.id())
    }

    /// `last` with the term `other` in the place of `chosen`, and their joints re-tuned as in `model`.
    fn exchanged(&self, last: &Model, chosen: &Term, other: &Term, model: &Model) -> Model {
        let mut out = last.clone();
        out.terms
            .retain(|term| (term.kind, term.target) != (chosen.kind, chosen.target));
        out.put(other.clone());
        let joints = [chosen, other].map(|term| joint_of(self.robot, term.kind.info().site, term.target));
        for (tuned, there) in out.tuned.iter_mut().zip(&model.tuned) {
            if joints.contains(&Some(tuned.dof)) {
                tuned.value = there.value;
            }
        }
        out
    }

    /// The motion in which `a` and `b` part most; `None` where nothing that they differ by is on a joint of one limb that is commanded.
    fn separation(&self, between: [String; 2], a: &Model, b: &Model) -> Option<Separation> {
        let stand = held(&commanded(self.robot));
        let joints = differing(&stand, a, b);
        let limbs = stand.limbs();
        let limb = limbs
            .iter()
            .find(|limb| joints.iter().all(|dof| limb.dofs.contains(dof)))?;
        let [a, b] = [a, b].map(|model| with_others_held(&stand, model, &joints));
        let ways = [Way::new(self, limb, &a, &b), Way::new(self, limb, &b, &a)];
        let motions = joints.iter().flat_map(|&dof| self.motions(limb, dof));
        let parted = motions.map(|(motion, data)| {
            let apart = ways.iter().map(|way| way.apart(&data)).fold(f64::INFINITY, f64::min);
            Separation {
                between: between.clone(),
                motion,
                apart,
                tells: apart >= TOLD,
            }
        });
        parted.reduce(|best, next| if next.apart > best.apart { next } else { best })
    }

    /// The motions of degree of freedom `dof` as `limb` makes them on a stand, with how they are recorded.
    fn motions(&self, limb: &Limb, dof: usize) -> Vec<(String, Data)> {
        let Some(own) = limb.dofs.iter().position(|&own| own == dof) else {
            return Vec::new();
        };
        let Some(place) = limb.robot.policy.iter().position(|&other| other == own) else {
            return Vec::new();
        };
        let mut weights = vec![0.0; limb.dofs.len()];
        weights[own] = 1.0 / self.floor.of(dof).max(LOWEST);
        let finer = self.data.finer;
        let mut out = Vec::new();
        for motion in Plan::alone(&limb.robot, place).motions {
            for condition in Condition::ALL {
                let data = rehearsed(&limb.robot, &motion, condition, weights.clone());
                let name = format!("{}{}", motion.name, condition.how());
                out.extend(data.map(|data| (name, Data { finer, ..data })).ok());
            }
        }
        out
    }
}

/// A model that tries to do what another does.
struct Way {
    /// The model, with each of its numbers moved, and last the other one, as a limb's.
    models: Vec<Model>,
    /// Products in the logs of what they do otherwise than the model.
    known: DMatrix<f64>,
}

impl Way {
    fn new(logs: &Logs<'_>, limb: &Limb, model: &Model, other: &Model) -> Self {
        let mut models = vec![model.clone()];
        models.extend(screen::steps(model, logs.scales, |_| true));
        models.push(other.clone());
        let weights = (0..logs.data.weights.len()).map(|d| 1.0 / logs.floor.of(d).max(LOWEST));
        let data = Data {
            weights: weights.collect(),
            ..logs.data.clone()
        };
        Self {
            known: data.products(&models),
            models: models.iter().map(|model| found::lowered(model, limb)).collect(),
        }
    }

    /// By how much the model fails more at it where it has to in the motion of `data` too: root mean square over its readings.
    fn apart(&self, data: &Data) -> f64 {
        let tuned = self.models.len() - 2;
        let left = |products: &DMatrix<f64>| screen::without(products, tuned).0[(1, 1)];
        let more = left(&(&self.known + data.products(&self.models))) - left(&self.known);
        let apart = (more / weighed(data).max(1.0)).max(0.0).sqrt();
        if apart.is_finite() { apart } else { 0.0 }
    }
}

/// The degrees of freedom of effects that only one of two models has.
fn differing(robot: &Robot, a: &Model, b: &Model) -> Vec<usize> {
    let own = |model: &Model, other: &Model| {
        let terms = model.terms.iter().filter(|term| !other.has(term.kind, term.target));
        let joints = terms.filter_map(|term| joint_of(robot, term.kind.info().site, term.target));
        joints.collect::<Vec<_>>()
    };
    let mut joints = [own(a, b), own(b, a)].concat();
    joints.sort_unstable();
    joints.dedup();
    joints
}

/// `model` with what is on other joints than `joints` held.
fn with_others_held(robot: &Robot, model: &Model, joints: &[usize]) -> Model {
    let mut model = model.clone();
    for tuned in &mut model.tuned {
        tuned.held |= !joints.contains(&tuned.dof);
    }
    for term in &mut model.terms {
        let own = joint_of(robot, term.kind.info().site, term.target);
        term.held |= !own.is_some_and(|own| joints.contains(&own));
    }
    model
}
