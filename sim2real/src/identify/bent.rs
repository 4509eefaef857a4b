//! What re-tuning has bent to. Where nothing says what the re-tuned model lacks, its numbers may have made up for what does: of a mass that is
//! loose, a softer servo takes what hangs on position, and its knocks, which go with nothing, are left. What the nominal robot lacks, with the
//! numbers its maker knows, still goes with it.

use omniwalk_env::engine::EngineError;

use super::model::Model;
use super::select::Selector;
use super::torque::{self, Dependence};

/// What a variable must predict of what the re-tuned model leaves above the floor for that to say what it depends on.
const TOLD: f64 = 0.3;

/// The variable that predicts most of what joint `dof` of `model` lacks with the numbers that the robot's files have; none where those that
/// what is left `depends_on` predict enough of it (all but the share `structure` of it is noise), or one of them predicts as much.
///
/// # Errors
/// When an engine does not take the robot.
pub fn leading(
    selector: &Selector<'_>,
    model: &Model,
    dof: usize,
    depends_on: &[Dependence],
    structure: f64,
) -> Result<Option<Dependence>, EngineError> {
    let most = depends_on.iter().map(|own| own.gain).fold(0.0, f64::max);
    if most >= TOLD * structure {
        return Ok(None);
    }
    let mut nominal = model.clone();
    nominal.tuned.iter_mut().for_each(|tuned| tuned.value = tuned.nominal);
    let moments = torque::lacking(selector.data, &nominal, selector.scales)?;
    let fold = |block: usize| selector.folds.of_block[block];
    let leading = torque::leading(&moments[dof], &fold, selector.folds.count);
    Ok(leading.filter(|leading| leading.gain > most))
}

#[cfg(test)]
mod tests {
    use super::super::cross::Folds;
    use super::super::cut::Lengths;
    use super::super::floor::Floor;
    use super::super::hinge::{robot, swings};
    use super::super::scales::Scales;
    use super::super::torque::Form;
    use super::*;

    #[test]
    fn where_nothing_says_what_re_tuning_leaves_what_the_nominal_robot_lacks_does() {
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        // What follows its commands at once lacks the torque that its mass takes.
        let data = swings(
            &robot,
            2,
            Lengths {
                block: 0.5,
                piece: 60.0,
            },
        );
        let nominal = Model::nominal(&robot, &data.trials);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        let told = |gain: f64| Dependence {
            variable: 1,
            form: Form::Plain,
            gain,
        };
        let of = |model: &Model, told: &[Dependence], structure| {
            let leading = leading(&selector, model, 0, told, structure).expect("an engine");
            leading.map(|leading| (leading.variable, leading.gain))
        };
        let found = of(&nominal, &[], 0.9).expect("a variable");
        assert!(found.1 > 0.9, "{found:?}");
        let mut bent = nominal.clone();
        bent.tuned.iter_mut().for_each(|tuned| tuned.value *= 3.0);
        assert_eq!(
            of(&bent, &[told(0.2)], 0.9),
            Some(found),
            "with the robot's own numbers"
        );
        assert_eq!(of(&bent, &[told(0.2)], 0.5), None, "the rest is noise");
        assert_eq!(of(&bent, &[told(0.4)], 0.9), None);
    }
}
