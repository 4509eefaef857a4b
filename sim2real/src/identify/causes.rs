//! What re-tunes several numbers of a joint as one: a supply that is not the nominal one, a mass that is not.
//!
//! Re-tuning explains all that these do, so that no effect is missing beside it: a supply (`Kind::SupplyVoltage`) scales stiffness, torque
//! limit and speed limit; where one link moves, a larger mass of it does what lower gains and a lower torque limit do. Where such an effect
//! beside nominal values predicts no worse than the numbers that were re-tuned one by one, it is named with them.

use omniwalk_env::effect::{Kind, Site};
use omniwalk_env::robot::Robot;

use super::fit::Fit;
use super::leftover::Leftover;
use super::model::{Tuned, joint_of};
use super::own::Own;
use super::select::Selector;

/// Something that moves several numbers as one.
struct Cause {
    /// Its names.
    kinds: &'static [Kind],
    /// What it scales.
    scaled: &'static [Own],
    /// What it leaves as it is.
    kept: &'static [Own],
    /// Whether it has the same effect as the factor only where one joint moves.
    alone: bool,
}

const CAUSES: [Cause; 2] = [
    Cause {
        kinds: &[Kind::SupplyVoltage],
        scaled: &[Own::KpScale, Own::TorqueLimit, Own::SpeedLimit],
        kept: &[],
        alone: false,
    },
    Cause {
        kinds: &[Kind::Payload, Kind::Mass],
        scaled: &[Own::KpScale, Own::Kd, Own::TorqueLimit],
        kept: &[Own::SpeedLimit],
        alone: true,
    },
];
/// Least distance of a number's factor from one.
const OFF: f64 = 0.03;

/// Sets of what cannot be told apart: for each joint some of whose numbers are off in the same direction, without which they predict worse,
/// the causes that would do as well and what they scale. `intervals` are half widths of the numbers of `fit` in their order. Where structure
/// is `left` of a joint, its numbers have bent to that.
pub fn sets(selector: &Selector<'_>, fit: &Fit, intervals: &[f64], left: &Leftover) -> Vec<Vec<String>> {
    let robot = selector.robot;
    let one = |dof: usize| {
        let (mut kinds, mut scaled) = (Vec::new(), Vec::new());
        for cause in CAUSES.iter().filter(|cause| !cause.alone || robot.dofs.len() == 1) {
            let Some(own) = cause.scaled(fit, intervals, dof) else {
                continue;
            };
            let named = cause
                .kinds
                .iter()
                .filter(|&&kind| cause.explains(kind, selector, fit, dof));
            let named: Vec<Kind> = named.copied().collect();
            if !named.is_empty() && selector.retuning_helps(fit, dof, &own, robot.dofs.len()) {
                kinds.extend(named);
                scaled.extend(own);
            }
        }
        let name = &robot.dof(dof).name;
        let numbers = Own::ALL.into_iter().filter(|own| scaled.contains(own));
        let numbers = numbers.map(|own| format!("{} of {name}", own.key()));
        let kinds = kinds.into_iter().map(|kind: Kind| kind.id().to_owned());
        kinds.chain(numbers).collect::<Vec<String>>()
    };
    let explained = |dof: &usize| left.structured().all(|left| left.dof != *dof);
    let sets = (0..robot.dofs.len()).filter(explained).map(one);
    sets.filter(|set| !set.is_empty()).collect()
}

impl Cause {
    /// The numbers of degree of freedom `dof` that it scales and the logs tell, if they are off in the same direction.
    fn scaled(&self, fit: &Fit, intervals: &[f64], dof: usize) -> Option<Vec<Own>> {
        let (own, factors) = factors(fit, intervals, dof, self.scaled);
        // Where stiffness does not tell there is no more than limits, of which each may be off.
        let told = own.contains(&Own::KpScale) && own.len() > 1;
        (told && off_alike(&factors)).then_some(own)
    }

    /// Whether `kind` beside the nominal values of what it scales and keeps does what re-tuning them does.
    fn explains(&self, kind: Kind, selector: &Selector<'_>, fit: &Fit, dof: usize) -> bool {
        let own = [self.scaled, self.kept].concat();
        let target = target(kind, dof, selector.robot);
        target.is_some_and(|target| selector.stands_for(fit, dof, &own, (kind, target)))
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
