//! What re-tuning has bent to. Where nothing says what the re-tuned model lacks, its numbers may have made up for what does: of a mass that is
//! loose, a softer servo takes what hangs on position, and its knocks, which go with nothing, are left. What the nominal robot lacks, with the
//! numbers its maker knows, still goes with it.

use omniwalk_env::engine::EngineError;

use super::cross::Folds;
use super::model::Model;
use super::select::Selector;
use super::torque::{self, Dependence, Moment};

/// What a variable must predict of what the re-tuned model leaves above the floor for that to say what it depends on.
const TOLD: f64 = 0.3;

/// Whether what a joint's residual `depends_on` leaves open what it is: all but the share `structure` of it is noise.
pub fn is_untold(depends_on: &[Dependence], structure: f64) -> bool {
    most(depends_on) < TOLD * structure
}

/// What each joint lacks under `model` with the numbers that the robot's files have.
///
/// # Errors
/// When an engine does not take the robot.
pub fn lacking(selector: &Selector<'_>, model: &Model) -> Result<Vec<Vec<Moment>>, EngineError> {
    let mut nominal = model.clone();
    nominal.tuned.iter_mut().for_each(|tuned| tuned.value = tuned.nominal);
    torque::lacking(selector.data, &nominal, selector.scales)
}

/// The variable that predicts most of what the nominal robot `lacks` at a joint; none where one of those that what is left `depends_on`
/// predicts as much.
pub fn leading(folds: &Folds, lacks: &[Moment], depends_on: &[Dependence]) -> Option<Dependence> {
    let leading = torque::leading(lacks, &|block| folds.of_block[block], folds.count);
    leading.filter(|leading| leading.gain > most(depends_on))
}

/// The largest share that a variable predicts.
fn most(depends_on: &[Dependence]) -> f64 {
    depends_on.iter().map(|own| own.gain).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
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
        let of = |model: &Model, told: &[Dependence]| {
            let lacks = lacking(&selector, model).expect("an engine");
            leading(&folds, &lacks[0], told).map(|leading| (leading.variable, leading.gain))
        };
        let found = of(&nominal, &[]).expect("a variable");
        assert!(found.1 > 0.9, "{found:?}");
        let mut bent = nominal.clone();
        bent.tuned.iter_mut().for_each(|tuned| tuned.value *= 3.0);
        assert_eq!(of(&bent, &[told(0.2)]), Some(found), "with the robot's own numbers");
        assert_eq!(of(&bent, &[told(1.0)]), None, "one of those says as much");
        assert!(is_untold(&[told(0.2)], 0.9));
        assert!(!is_untold(&[told(0.2)], 0.5), "the rest is noise");
        assert!(!is_untold(&[told(0.4)], 0.9));
    }
}
