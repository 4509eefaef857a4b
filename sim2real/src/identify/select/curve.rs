//! Several effects of position at once: a curve, drawn with what the library has.

use omniwalk_env::effect::Kind;

use super::super::fit::{Fit, total};
use super::super::model::joint_of;
use super::super::torque::{self, Form};
use super::{Selector, Steps};

/// Effects whose torque on a joint at rest depends on position alone.
const OF_POSITION: [Kind; 6] = [
    Kind::PositionRipple,
    Kind::ExternalForce,
    Kind::Mass,
    Kind::CentreOfMass,
    Kind::Payload,
    Kind::SensorOffset,
];
/// So many of them at once on a joint can draw any curve, and say nothing of what made it.
const CURVE: usize = 3;
/// They are one where a table over position takes this share of the loss that they take.
const SAME: f64 = 0.8;

impl Selector<'_> {
    /// Takes out the effects of position of each joint that has so many of them that they stand for a curve, where a table over position
    /// does what they do: what that curve is of is not known, and what is left tells.
    pub(super) fn undo_curves(&self, steps: &mut Steps) -> Vec<(Kind, usize)> {
        let mut undone = Vec::new();
        for dof in 0..self.robot.dofs.len() {
            let mut base = steps.now.fit.model.clone();
            let on_joint = |kind: Kind, target| joint_of(self.robot, kind.info().site, target) == Some(dof);
            let curve: Vec<(Kind, usize)> = base
                .terms
                .extract_if(.., |term| {
                    OF_POSITION.contains(&term.kind) && on_joint(term.kind, term.target)
                })
                .map(|term| (term.kind, term.target))
                .collect();
            if curve.len() < CURVE {
                continue;
            }
            let without = self.known(steps, &base);
            let takes = 1.0 - total(&steps.now.cross) / total(&without.cross);
            if self.position_takes(&without.fit, dof) >= SAME * takes {
                steps.now = without;
                undone.extend(curve);
            }
        }
        undone
    }

    /// The share that a table over position on degree of freedom `dof` takes of the cross-validated loss of `fit`.
    fn position_takes(&self, fit: &Fit, dof: usize) -> f64 {
        let Ok(moments) = torque::lacking(self.data, &fit.model, self.scales) else {
            return 0.0;
        };
        let table = self.best_table(fit, dof, &moments[dof], &[(0, Form::Plain)]);
        table.map_or(0.0, |table| table.share())
    }
}
