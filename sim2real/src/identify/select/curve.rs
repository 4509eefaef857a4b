//! Several effects of position at once: a curve, drawn with what the library has.

use omniwalk_env::effect::Kind;

use super::super::fit::total;
use super::super::leftover;
use super::super::model::joint_of;
use super::super::torque::{self, Dependence, Form};
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
            let before = total(&without.cross);
            let takes = before - total(&steps.now.cross);
            if self.table_takes(&without.fit.model, dof, before) >= SAME * takes {
                steps.now = without;
                undone.extend(curve);
            }
        }
        undone
    }

    /// What a table over position on degree of freedom `dof` takes of the cross-validated loss `before` of `model`.
    fn table_takes(&self, model: &super::Model, dof: usize, before: f64) -> f64 {
        let position = Dependence {
            variable: 0,
            form: Form::Plain,
            gain: 0.0,
        };
        let Ok(moments) = torque::lacking(self.data, model, self.scales) else {
            return 0.0;
        };
        let tables = leftover::tables(self.data, self.folds, model, (dof, &moments[dof]), &[position]);
        let takes = tables.iter().map(|(_, cross)| before - total(cross));
        takes.reduce(f64::max).unwrap_or(0.0)
    }
}
