//! What re-tunes several numbers of a joint by the same factor: a supply that is not the nominal one, a mass that is not.
//!
//! Re-tuning explains all that these do, so that no effect is missing beside it: a supply (`Kind::SupplyVoltage`) scales stiffness, torque
//! limit and speed limit; where one link moves, a larger mass of it does what lower gains and a lower torque limit do. Numbers that move
//! as one have one cause, which is named with them.

use omniwalk_env::effect::Kind;

use super::fit::Fit;
use super::model::Tuned;
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
/// Least distance of the common factor from one.
const OFF: f64 = 0.03;
/// Factors agree within this many of their intervals' half widths, and as much as fits are off anyway.
const AGREE: f64 = 1.5;
const ANYWAY: f64 = 0.01;

/// Sets of what cannot be told apart: for each joint some of whose numbers have a factor in common, without which they predict worse, the
/// causes and what they scale. `intervals` are half widths of the numbers of `fit` in their order.
pub fn sets(selector: &Selector<'_>, fit: &Fit, intervals: &[f64]) -> Vec<Vec<String>> {
    let robot = selector.robot;
    let one = |dof: usize| {
        let (mut kinds, mut scaled) = (Vec::new(), Vec::new());
        for cause in CAUSES.iter().filter(|cause| !cause.alone || robot.dofs.len() == 1) {
            if let Some(own) = cause.scaled(fit, intervals, dof)
                && selector.retuning_helps(fit, dof, &own, robot.dofs.len())
            {
                kinds.extend_from_slice(cause.kinds);
                scaled.extend(own);
            }
        }
        let name = &robot.dof(dof).name;
        let numbers = Own::ALL.into_iter().filter(|own| scaled.contains(own));
        let numbers = numbers.map(|own| format!("{} of {name}", own.key()));
        let kinds = kinds.into_iter().map(|kind: Kind| kind.id().to_owned());
        kinds.chain(numbers).collect::<Vec<String>>()
    };
    (0..robot.dofs.len()).map(one).filter(|set| !set.is_empty()).collect()
}

impl Cause {
    /// The numbers of degree of freedom `dof` that it scales, if they have a factor in common and what it keeps has not.
    fn scaled(&self, fit: &Fit, intervals: &[f64], dof: usize) -> Option<Vec<Own>> {
        let (own, moved) = factors(fit, intervals, dof, self.scaled);
        let (_, kept) = factors(fit, intervals, dof, self.kept);
        // Where stiffness does not tell there is no more than limits, of which each may be off.
        if !own.contains(&Own::KpScale) || moved.len() < 2 {
            return None;
        }
        let mean = common(&moved)?;
        let is_kept = |[factor, _]: &[f64; 2]| (factor - 1.0).abs() < (factor - mean).abs();
        kept.iter().all(is_kept).then_some(own)
    }
}

/// Those of `numbers` of a degree of freedom that the logs tell, and each over its nominal value with the half width of its interval.
fn factors(fit: &Fit, intervals: &[f64], dof: usize, numbers: &[Own]) -> (Vec<Own>, Vec<[f64; 2]>) {
    let tuned = fit.model.tuned.iter().zip(intervals.iter().copied());
    let told = tuned.filter(|(tuned, half)| tuned.dof == dof && numbers.contains(&tuned.own) && half.is_finite());
    let factor = |(tuned, half): (&Tuned, f64)| (tuned.own, [tuned.value, half].map(|x| x / tuned.nominal));
    told.map(factor).unzip()
}

/// What `factors`, each with the half width of its interval, have in common, if that is not one.
fn common(factors: &[[f64; 2]]) -> Option<f64> {
    let weight = |half: f64| 1.0 / (half + ANYWAY).powi(2);
    let sum: f64 = factors.iter().map(|[_, half]| weight(*half)).sum();
    let mean = factors.iter().map(|[factor, half]| factor * weight(*half)).sum::<f64>() / sum;
    let agrees = |[factor, half]: &[f64; 2]| (factor - mean).abs() <= AGREE * half + ANYWAY;
    let off = |[factor, half]: &[f64; 2]| (factor - 1.0).abs() > *half && (factor - 1.0) * (mean - 1.0) > 0.0;
    ((mean - 1.0).abs() > OFF && factors.iter().all(|factor| agrees(factor) && off(factor))).then_some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_that_agree_and_are_not_one_have_a_common_cause() {
        assert!(common(&[[0.80, 0.01], [0.79, 0.02], [0.81, 0.01]]).is_some_and(|factor| (factor - 0.8).abs() < 0.01));
        assert!(common(&[[0.80, 0.01], [0.95, 0.02]]).is_none(), "they differ");
        assert!(common(&[[0.99, 0.001], [0.985, 0.002]]).is_none(), "as good as one");
        assert!(
            common(&[[0.80, 0.3], [0.85, 0.25]]).is_none(),
            "one is within the intervals"
        );
    }
}
