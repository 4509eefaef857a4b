//! Several effects of position at once: a curve, drawn with what the library has.

use omniwalk_env::effect::Kind;

use super::super::fit::Fit;
use super::super::model::joint_of;
use super::super::torque::{self, Form};
use super::{Selector, Steps, Tabled};

/// Effects whose torque on a joint at rest depends on position alone.
const OF_POSITION: [Kind; 7] = [
    Kind::PositionRipple,
    Kind::ExternalForce,
    Kind::Mass,
    Kind::CentreOfMass,
    Kind::Payload,
    Kind::SensorOffset,
    Kind::SensorScale,
];
/// So many of them at once on a joint can draw any curve, and say nothing of what made it: they are one where a table over position takes the
/// share [`SAME`] of the loss that they take.
const CURVE: usize = 3;
const SAME: f64 = 0.8;
/// So many are one where the table predicts better than they do.
const PART_OF_CURVE: usize = 2;

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
            if curve.len() < PART_OF_CURVE {
                continue;
            }
            let without = self.known(steps, &base);
            let Some(table) = self.over_position(&without.fit, dof) else {
                continue;
            };
            let effects = self.logs.cross(self.data, &steps.now.fit, self.scales);
            let is_curve = if curve.len() < CURVE {
                self.apart(&effects, table.cross())
            } else {
                table.share() >= SAME * table.share_of(&effects)
            };
            if is_curve {
                steps.now = without;
                undone.extend(curve);
            }
        }
        undone
    }

    /// A table over position on degree of freedom `dof` beside the model of `fit`.
    fn over_position(&self, fit: &Fit, dof: usize) -> Option<Tabled> {
        let moments = torque::lacking(self.data, &fit.model, self.scales).ok()?;
        self.best_table(fit, dof, &moments[dof], &[(0, Form::Plain)])
    }
}
