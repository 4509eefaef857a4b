//! What re-tunes several numbers of a joint as one: a supply that is not the nominal one, a mass that is not.
//!
//! Re-tuning explains all that these do, so that no effect is missing beside it: a supply (`Kind::SupplyVoltage`) scales stiffness, torque
//! limit and speed limit; where one link moves, a larger mass of it does what lower gains and a lower torque limit do. Where such an effect
//! beside nominal values predicts no worse than the numbers that were re-tuned one by one, it is named with them.

use omniwalk_env::effect::{Kind, Site};
use omniwalk_env::robot::Robot;

use super::fit::Fit;
use super::leftover::Leftover;
use super::model::{Model, Tuned, joint_of};
use super::own::Own;
use super::select::Selector;

/// Something that moves several numbers as one.
struct Scaling {
    /// Its names.
    kinds: &'static [Kind],
    /// What it scales.
    scaled: &'static [Own],
    /// What it leaves as it is.
    kept: &'static [Own],
    /// Whether it has the same effect as the factor only where one joint moves.
    alone: bool,
}

const SCALINGS: [Scaling; 2] = [
    Scaling {
        kinds: &[Kind::SupplyVoltage],
        scaled: &[Own::KpScale, Own::TorqueLimit, Own::SpeedLimit],
        kept: &[],
        alone: false,
    },
    Scaling {
        kinds: &[Kind::Payload, Kind::Mass],
        scaled: &[Own::KpScale, Own::Kd, Own::TorqueLimit],
        kept: &[Own::SpeedLimit],
        alone: true,
    },
];
/// Least distance of a number's factor from one.
const OFF: f64 = 0.03;

/// Re-tuned numbers of a joint, and what would do as well.
pub struct Cause {
    /// Names of all of them.
    pub names: Vec<String>,
    /// Each effect that would, with the model that has it in their place.
    pub effects: Vec<((Kind, usize), Model)>,
}

/// Sets of what cannot be told apart: for each joint some of whose numbers are off in the same direction, without which they predict worse,
/// the causes that would do as well and what they scale. `intervals` are half widths of the numbers of `fit` in their order. Where structure
/// is `left` of a joint, its numbers have bent to that.
pub fn sets(selector: &Selector<'_>, fit: &Fit, intervals: &[f64], left: &Leftover) -> Vec<Cause> {
    let robot = selector.robot;
    let one = |dof: usize| {
        let (mut effects, mut scaled) = (Vec::new(), Vec::new());
        for scaling in SCALINGS
            .iter()
            .filter(|scaling| !scaling.alone || robot.dofs.len() == 1)
        {
            let Some(own) = scaling.scaled(fit, intervals, dof) else {
                continue;
            };
            let named = scaling.kinds.iter();
            let named = named.filter_map(|&kind| scaling.in_place(kind, selector, fit, dof));
            let named: Vec<_> = named.collect();
            if !named.is_empty() && selector.retuning_helps(fit, dof, &own, robot.dofs.len()) {
                effects.extend(named);
                scaled.extend(own);
            }
        }
        let name = &robot.dof(dof).name;
        let numbers = Own::OF_JOINT.into_iter().filter(|own| scaled.contains(own));
        let numbers = numbers.map(|own| format!("{} of {name}", own.key()));
        let kinds = effects
            .iter()
            .map(|((kind, _), _): &((Kind, usize), Model)| kind.id().to_owned());
        Cause {
            names: kinds.chain(numbers).collect(),
            effects,
        }
    };
    let explained = |dof: &usize| left.structured().all(|left| left.dof != *dof);
    let sets = (0..robot.dofs.len()).filter(explained).map(one);
    sets.filter(|set| !set.names.is_empty()).collect()
}

impl Scaling {
    /// The numbers of degree of freedom `dof` that it scales and the logs tell, if they are off in the same direction.
    fn scaled(&self, fit: &Fit, intervals: &[f64], dof: usize) -> Option<Vec<Own>> {
        let (own, factors) = factors(fit, intervals, dof, self.scaled);
        // Where stiffness does not tell there is no more than limits, of which each may be off.
        let told = own.contains(&Own::KpScale) && own.len() > 1;
        (told && off_alike(&factors)).then_some(own)
    }

    /// `kind` and its target, with the model where it stands beside the nominal values of what it scales and keeps, if it does what
    /// re-tuning them does.
    fn in_place(&self, kind: Kind, selector: &Selector<'_>, fit: &Fit, dof: usize) -> Option<((Kind, usize), Model)> {
        let own = [self.scaled, self.kept].concat();
        let effect = (kind, target(kind, dof, selector.robot)?);
        Some((effect, selector.standing_for(fit, dof, &own, effect)?))
    }
}

/// What `kind` acts on to move degree of freedom `dof`.
fn target(kind: Kind, dof: usize, robot: &Robot) -> Option<usize> {
    match kind.info().site {
        Site::Joint => Some(dof),
        Site::Link => (1..robot.links.len()).find(|&link| joint_of(robot, Site::Link, link) == Some(dof)),
    }
}

/// Those of `numbers` of a degree of freedom that the logs tell, and each over its nominal value with the half width of its interval.
fn factors(fit: &Fit, intervals: &[f64], dof: usize, numbers: &[Own]) -> (Vec<Own>, Vec<[f64; 2]>) {
    let tuned = fit.model.tuned.iter().zip(intervals.iter().copied());
    let told = tuned.filter(|(tuned, half)| tuned.dof == dof && numbers.contains(&tuned.own) && half.is_finite());
    let factor = |(tuned, half): (&Tuned, f64)| (tuned.own, [tuned.value, half].map(|x| x / tuned.nominal));
    told.map(factor).unzip()
}

/// Whether `factors`, each with the half width of its interval, are all off one, to the same side.
fn off_alike(factors: &[[f64; 2]]) -> bool {
    let off = |sign: f64| move |[factor, half]: &[f64; 2]| sign * (factor - 1.0) > half.max(OFF);
    factors.iter().all(off(1.0)) || factors.iter().all(off(-1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_off_alike_where_all_are_surely_above_or_surely_below_one() {
        assert!(off_alike(&[[0.80, 0.01], [0.71, 0.02]]));
        assert!(off_alike(&[[1.2, 0.01], [1.3, 0.1]]));
        assert!(!off_alike(&[[0.80, 0.01], [1.2, 0.01]]), "to both sides");
        assert!(!off_alike(&[[0.99, 0.001], [0.8, 0.01]]), "one is as good as nominal");
        assert!(!off_alike(&[[0.80, 0.3], [0.85, 0.1]]), "one is within its interval");
    }
}
