//! Which of many effects are worth a fit: what each would take of the loss to first order.
//!
//! A robot of many joints can have hundreds of effects, and a fit of one takes dozens of rollouts. Here an effect costs one rollout for
//! each of its starts: by how much it changes the predictions there is a direction, and the loss that the best length along it takes
//! beside the re-tuned parameters of its joint is the numerator of a score test (Rao 1948). Effects that are fitted from where they do
//! nothing have a direction for each of their numbers.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use omniwalk_env::robot::Robot;
use rayon::prelude::*;

use super::candidates::Candidate;
use super::fit::Data;
use super::model::{Model, Term, joint_of};
use super::scales::Scales;

/// A direction of which re-tuning leaves less than this share is none of its own.
const OWN: f64 = 1e-6;

/// Share of the loss of `model` that each of `candidates` would take to first order.
pub fn shares(robot: &Robot, data: &Data, model: &Model, candidates: &[Candidate], scales: &Scales) -> Vec<f64> {
    let mut by_joint: BTreeMap<Option<usize>, Vec<usize>> = BTreeMap::new();
    for (i, candidate) in candidates.iter().enumerate() {
        let joint = joint_of(robot, candidate.kind.info().site, candidate.target);
        by_joint.entry(joint).or_default().push(i);
    }
    let of_joint = |(&joint, own): (&Option<usize>, &Vec<usize>)| {
        let mut model = model.clone();
        model.hold_others(robot, joint);
        let beside = Beside::new(data, &model, own.iter().map(|&i| &candidates[i]), scales);
        own.iter().copied().zip(beside.shares()).collect::<Vec<_>>()
    };
    let found: Vec<(usize, f64)> = by_joint.par_iter().flat_map_iter(of_joint).collect();
    let mut shares = vec![0.0; candidates.len()];
    found.into_iter().for_each(|(i, share)| shares[i] = share);
    shares
}

/// A way in which a candidate may change the predictions.
struct Way {
    /// Columns of its directions.
    columns: std::ops::Range<usize>,
    /// Whether only lengths above zero are the effect's: its one direction leads from nothing to its start.
    forward: bool,
}

/// What changes the predictions beside the re-tuned parameters of a joint.
struct Beside {
    /// Products of the residual (first) and of all directions, less what the re-tuned parameters take of them.
    left: DMatrix<f64>,
    /// The same before they took anything.
    all: DMatrix<f64>,
    /// Ways of each candidate.
    ways: Vec<Vec<Way>>,
}

impl Beside {
    fn new<'a>(data: &Data, model: &Model, candidates: impl Iterator<Item = &'a Candidate>, scales: &Scales) -> Self {
        let mut models = vec![model.clone()];
        models.extend(steps(model, scales, |_| true));
        let tuned = models.len() - 1;
        let mut ways = Vec::new();
        for candidate in candidates {
            let way = |term: &Term| {
                let mut there = model.clone();
                there.put(term.clone());
                let first = models.len() - tuned;
                let still = is_still(term);
                if still {
                    let free = there.free(scales).len();
                    // The numbers of a term that is added last are the last ones.
                    models.extend(steps(&there, scales, |i| i + term.free.len() >= free));
                } else {
                    models.push(there);
                }
                Way {
                    columns: first..models.len() - tuned,
                    forward: !still,
                }
            };
            ways.push(candidate.starts.iter().map(way).collect());
        }
        let products = data.products(&models);
        let (left, all) = without(&products, tuned);
        Self { left, all, ways }
    }

    fn shares(&self) -> Vec<f64> {
        let best = |ways: &Vec<Way>| ways.iter().map(|way| self.share(way)).fold(0.0, f64::max);
        self.ways.iter().map(best).collect()
    }

    /// Share of the loss that the best lengths along a way take.
    fn share(&self, way: &Way) -> f64 {
        let own: Vec<usize> = way
            .columns
            .clone()
            .filter(|&c| self.left[(c, c)] > OWN * self.all[(c, c)])
            .collect();
        let pull = DVector::from_fn(own.len(), |i, _| -self.left[(0, own[i])]);
        if own.is_empty() || (way.forward && pull[0] <= 0.0) {
            return 0.0;
        }
        let curvature = DMatrix::from_fn(own.len(), own.len(), |i, j| {
            self.left[(own[i], own[j])] * if i == j { 1.0 + OWN } else { 1.0 }
        });
        let taken = curvature
            .cholesky()
            .map_or(0.0, |factor| pull.dot(&factor.solve(&pull)));
        let share = taken / self.left[(0, 0)];
        if share.is_finite() { share } else { 0.0 }
    }
}

/// `model` with each of its fitted numbers that `which` names moved by a step.
pub fn steps(model: &Model, scales: &Scales, which: impl Fn(usize) -> bool) -> Vec<Model> {
    let (x, free) = (model.get(scales), model.free(scales));
    let moved = |i: usize| {
        let mut moved = x.clone();
        moved[i] += free[i].step;
        model.at(&moved, scales)
    };
    (0..x.len()).filter(|&i| which(i)).map(moved).collect()
}

/// Whether `term` does nothing at its start.
fn is_still(term: &Term) -> bool {
    let parameters = &term.kind.info().parameters;
    term.free.iter().any(|&i| parameters[i].neutral == Some(term.values[i]))
}

/// `products` of a residual, of `tuned` directions and of others: what is left of the residual and the others when the tuned ones have
/// taken what they can, and what there was.
pub fn without(products: &DMatrix<f64>, tuned: usize) -> (DMatrix<f64>, DMatrix<f64>) {
    let rest: Vec<usize> = (0..products.nrows()).filter(|&i| i == 0 || i > tuned).collect();
    let all = DMatrix::from_fn(rest.len(), rest.len(), |i, j| products[(rest[i], rest[j])]);
    let mut own = products.view((1, 1), (tuned, tuned)).into_owned();
    for i in 0..tuned {
        own[(i, i)] *= 1.0 + OWN;
    }
    let cross = DMatrix::from_fn(tuned, rest.len(), |i, j| products[(i + 1, rest[j])]);
    let left = own
        .cholesky()
        .map_or_else(|| all.clone(), |factor| &all - cross.tr_mul(&factor.solve(&cross)));
    (left, all)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use omniwalk_env::effect::{Effect, Kind, apply};
    use omniwalk_env::robot::load;

    use super::super::candidates;
    use super::super::cut::{self, Lengths};
    use super::super::rollout;
    use super::*;
    use crate::recording::{JointRecord, Recording, Series};

    const URDF: &str = r#"<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.15"/><mass value="0.5"/><inertia ixx="0.005" iyy="0.005" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="8"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="8"/></joint></robot>"#;
    const TOML: &str = "base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\nkp = 30.0\nkd = 1.0\ntorque_limit = 20.0\nspeed_limit = 8.0\narmature = 0.02\ndamping = 0.1\nfriction = 0.2\n";
    const ELBOW: usize = 1;

    /// A log of 6 s in which `name` is told to swing.
    fn swing(name: &str, rate: f64) -> JointRecord {
        let time: Vec<f64> = (0..1200).map(|k| f64::from(k) * 5e-3).collect();
        let value: Vec<f64> = time
            .iter()
            .map(|t| 0.5 * (rate * t).sin() + 0.2 * (2.7 * rate * t).sin())
            .collect();
        let series = Series { time, value };
        JointRecord {
            name: name.to_owned(),
            command: series.clone(),
            position: series,
            ..JointRecord::default()
        }
    }

    #[test]
    fn what_is_missing_takes_the_whole_loss_to_first_order_and_comes_first() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("arm.urdf"), URDF).expect("written");
        std::fs::write(folder.path().join("robot.toml"), TOML).expect("written");
        let robot = load(folder.path()).expect("a robot");
        let recording = Recording {
            name: "log".into(),
            joints: vec![swing("shoulder", 2.0), swing("elbow", 2.6)],
            ..Recording::default()
        };
        let lengths = Lengths {
            block: 0.5,
            piece: f64::INFINITY,
        };
        for (kind, values) in [(Kind::ExternalForce, vec![0.3]), (Kind::CommandDelay, vec![0.015])] {
            let mut truth = robot.clone();
            apply(&mut truth, &Effect::new(kind, ELBOW, &values));
            let trials = cut::cut(&robot, &recording, 0, (0.0, f64::INFINITY), lengths).expect("trials");
            let mut data = Data::new(&robot, trials).expect("data");
            let scales = Scales::new(&robot, &data.trials);
            for trial in Arc::make_mut(&mut data.trials) {
                let told = rollout::predict(trial, std::slice::from_ref(&truth), 1).expect("a rollout");
                trial
                    .readings
                    .iter_mut()
                    .zip(told)
                    .for_each(|(reading, q)| reading.position = q);
            }
            let model = Model::nominal(&robot, &data.trials);
            let candidates = candidates::all(&robot, &data, &model, &scales, &vec![Vec::new(); 2]);
            let shares = shares(&robot, &data, &model, &candidates, &scales);
            let own = candidates
                .iter()
                .position(|c| (c.kind, c.target) == (kind, ELBOW))
                .expect("a candidate");
            assert!(shares[own] > 0.9, "{kind:?} takes {}", shares[own]);
            let before = shares.iter().filter(|share| **share > shares[own] + 1e-3).count();
            // A delay of the readings is told from one of the commands by no more than what the start was.
            assert!(before <= 1, "{before} come before {kind:?}");
            assert!(shares.iter().all(|share| (0.0..1.0 + 1e-6).contains(share)));
        }
    }
}
