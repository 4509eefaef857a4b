//! A supply below or above the nominal one: stiffness and limits of a joint that re-tune by the same factor.
//!
//! Re-tuning explains all that a supply does (`Kind::SupplyVoltage` scales stiffness, torque limit and speed limit), so that no effect
//! is missing beside it. Three numbers that move as one have one cause, which is named with them.

use omniwalk_env::effect::Kind;

use super::fit::Fit;
use super::model::Tuned;
use super::own::Own;
use super::select::Selector;

/// What the supply scales.
const SCALED: [Own; 3] = [Own::KpScale, Own::TorqueLimit, Own::SpeedLimit];
/// Least distance of the common factor from one.
const OFF: f64 = 0.03;
/// Factors agree within this many of their intervals' half widths, and as much as fits are off anyway.
const AGREE: f64 = 1.5;
const ANYWAY: f64 = 0.01;

/// Sets of what cannot be told apart: for each joint whose stiffness and limits have a factor in common, without which they predict worse,
/// the supply and what it scales. `intervals` are half widths of the numbers of `fit` in their order.
pub fn sets(selector: &Selector<'_>, fit: &Fit, intervals: &[f64]) -> Vec<Vec<String>> {
    let robot = selector.robot;
    let mut out = Vec::new();
    for dof in 0..robot.dofs.len() {
        let told = told(fit, intervals, dof);
        let factors: Vec<[f64; 2]> = told
            .iter()
            .map(|(tuned, half)| [tuned.value, *half].map(|x| x / tuned.nominal))
            .collect();
        let stiffness = told.iter().any(|(tuned, _)| tuned.own == Own::KpScale);
        if !stiffness || factors.len() < 2 || common(&factors).is_none() {
            continue;
        }
        let own: Vec<Own> = told.iter().map(|(tuned, _)| tuned.own).collect();
        if !selector.retuning_helps(fit, dof, &own, robot.dofs.len()) {
            continue;
        }
        let name = &robot.dof(dof).name;
        let scaled = own.iter().map(|own| format!("{} of {name}", own.key()));
        out.push(
            [Kind::SupplyVoltage.id().to_owned()]
                .into_iter()
                .chain(scaled)
                .collect(),
        );
    }
    out
}

/// What a supply scales on a joint and the logs tell, with half widths of intervals.
fn told<'a>(fit: &'a Fit, intervals: &[f64], dof: usize) -> Vec<(&'a Tuned, f64)> {
    let tuned = fit.model.tuned.iter().zip(intervals.iter().copied());
    tuned
        .filter(|(tuned, half)| tuned.dof == dof && SCALED.contains(&tuned.own) && half.is_finite())
        .collect()
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
