//! Effects that are no finding and may still be the best there is to simulate with.

use super::super::fit::Fit;
use super::super::model::Model;
use super::Selector;
use super::tables::{CHANCE, WORTH};

/// Effects in the place of what is missing.
pub struct StandIn {
    /// The model with them, and with what is re-tuned of their joint.
    pub model: Model,
    /// Share of the cross-validated loss that they take.
    pub share: f64,
}

impl Selector<'_> {
    /// Beside the model of `fit`, the effects of degree of freedom `dof` that were `doubted`, if they predict better than none beyond chance,
    /// judged as tables are: by whole logs, where there are several.
    pub fn stand_in(&self, fit: &Fit, dof: usize, doubted: &Model) -> Option<StandIn> {
        let mut model = fit.model.clone();
        model.hold_others(self.robot, Some(dof));
        model.terms.iter_mut().for_each(|term| term.held = true);
        model.take_joint(self.robot, dof, doubted);
        if model.terms.len() == fit.model.terms.len() {
            return None;
        }
        let with = self.data.fit(&model, self.scales, &|_| true);
        let [before, after] = [fit, &with].map(|fit| self.logs.cross(self.data, fit, self.scales));
        let gain = self.logs.gain(&before, &after);
        let Fit { mut model, .. } = with;
        model.hold_others(self.robot, None);
        let share = gain.share;
        (share >= WORTH && gain.p <= CHANCE).then_some(StandIn { model, share })
    }
}

#[cfg(test)]
mod tests {
    use omniwalk_env::effect::Kind;

    use super::super::super::cross::Folds;
    use super::super::super::cut::Lengths;
    use super::super::super::fit::Data;
    use super::super::super::floor::Floor;
    use super::super::super::hinge::{read, robot, swings};
    use super::super::super::model::Term;
    use super::super::super::scales::Scales;
    use super::*;

    /// `model` with a constant `torque`.
    fn pushed(model: &Model, torque: f64) -> Model {
        let mut model = model.clone();
        model.terms.push(Term {
            kind: Kind::ExternalForce,
            target: 0,
            values: vec![torque],
            free: vec![0],
            table: None,
            held: false,
        });
        model
    }

    #[test]
    fn what_was_doubted_stands_in_where_it_predicts_better_than_nothing() {
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let mut data = swings(&robot, 3, lengths);
        let nominal = Model::nominal(&robot, &data.trials);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let stand_in = |data: &Data, doubted: &Model| {
            let floor = Floor::new(data, &nominal, &scales).expect("a floor");
            let selector = Selector::new(&robot, data, &scales, &folds, &floor);
            let fit = selector.fit(&nominal).fit;
            selector.stand_in(&fit, 0, doubted)
        };
        read(&mut data, &pushed(&nominal, 0.5));
        let found = stand_in(&data, &pushed(&nominal, 0.4)).expect("it predicts better");
        let torque = found.model.term(Kind::ExternalForce, 0).expect("the torque").values[0];
        assert!(
            found.share > 0.5 && (torque - 0.5).abs() < 0.01,
            "{} {torque}",
            found.share
        );
        assert!(!found.model.is_held());
        assert!(stand_in(&data, &nominal).is_none(), "nothing was doubted");
        read(&mut data, &nominal);
        assert!(stand_in(&data, &pushed(&nominal, 0.1)).is_none(), "nothing is missing");
    }
}
