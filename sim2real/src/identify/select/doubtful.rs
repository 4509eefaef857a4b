//! Effects whose size the logs leave open down to none: they predict better, and still are no finding.

use omniwalk_env::effect::Kind;

use super::super::candidates;
use super::super::descent::Descent;
use super::super::fit::total;
use super::super::interval;
use super::super::model::{Model, Term};
use super::{Selection, Selector};

/// Greatest doubt of an effect whose size is certain.
const CERTAIN: f64 = 1.0;

impl Selector<'_> {
    /// Takes out, one by one, the effects of which every size has an interval that holds none, the least certain first: what is wrong with a
    /// model beyond noise can be all there is to them. One of a set gives way to another of it whose size is certain (how much friction
    /// differs between the directions is open where one of them has none left; a constant torque that does the same is not); else the set
    /// goes with it. Whether any was taken out.
    pub fn drop_doubtful(&self, selection: &mut Selection) -> bool {
        let before = selection.last.model.terms.len();
        let mut doubted = Vec::new();
        while let Some(i) = least_certain(&self.doubts(&selection.last.model)) {
            let Term { kind, target, .. } = selection.last.model.terms[i];
            doubted.push((kind, target));
            if self.give_way(selection, i, &doubted) {
                continue;
            }
            let mut model = selection.last.model.clone();
            model.terms.remove(i);
            let mut without = self.fit(&model).fit;
            // What was re-tuned beside an effect may be in a lesser minimum than what was re-tuned alone.
            if model.terms.is_empty() && total(&selection.refit.losses) < total(&without.losses) {
                without = selection.refit.clone();
            }
            let is_doubted = |term: &Term| (term.kind, term.target) == (kind, target);
            selection.take_out(&is_doubted, without, "its 95 % interval holds no effect at all");
        }
        selection.last.model.terms.len() < before
    }

    /// Puts another of the set that term `i` of the last model stands for in its place: the first that is none of `doubted` and whose size is
    /// certain there. False where there is none.
    fn give_way(&self, selection: &mut Selection, i: usize, doubted: &[(Kind, usize)]) -> bool {
        let term = &selection.last.model.terms[i];
        let Some(set) = selection
            .alike
            .iter_mut()
            .find(|set| set.chosen == (term.kind, term.target))
        else {
            return false;
        };
        for (k, other) in set
            .others
            .clone()
            .into_iter()
            .enumerate()
            .filter(|(_, own)| !doubted.contains(own))
        {
            let mut model = selection.last.model.clone();
            let there = &set.models[k];
            model.tuned.clone_from(&there.tuned);
            model.terms[i].clone_from(there.term(other.0, other.1).unwrap_or(term));
            let fit = self.fit(&model).fit;
            if self.doubts(&fit.model)[i].is_some_and(|doubt| doubt <= CERTAIN) {
                let gone = std::mem::replace(&mut selection.last, fit);
                set.values[k].clone_from(&gone.model.terms[i].values);
                let taken = set.others[k];
                (set.models[k], set.others[k], set.chosen) = (gone.model, set.chosen, taken);
                let gone = set.others[k];
                selection.rejected.retain(|own| (own.kind, own.target) != taken);
                selection.note_gone(gone, "");
                return true;
            }
        }
        false
    }

    /// How doubtful each effect of `model` is ([`doubt`]).
    fn doubts(&self, model: &Model) -> Vec<Option<f64>> {
        // How an effect departs from its simplest form names nothing: towards none of it that says ever less, so that its size, with that left
        // open, would reach down to none whatever the logs tell (friction that grows with the load's square as well as with the load).
        let mut model = model.clone();
        for term in &mut model.terms {
            let finer = candidates::refinements(term.kind).concat();
            term.free.retain(|number| !finer.contains(number));
        }
        let fit = Descent::new(self.data, &model, self.scales).fit;
        let halves = interval::intervals(self, &fit);
        let halves: Vec<f64> = halves.iter().map(|half| half.most).collect();
        let terms = model.terms.iter().enumerate();
        terms.map(|(i, term)| doubt(term, model.of_term(i, &halves))).collect()
    }
}

/// The place of the greatest of `doubts` that leaves an effect uncertain.
fn least_certain(doubts: &[Option<f64>]) -> Option<usize> {
    let doubts = doubts.iter().enumerate().filter_map(|(i, doubt)| Some((i, (*doubt)?)));
    let uncertain = doubts.filter(|(_, doubt)| *doubt > CERTAIN);
    uncertain.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

/// The half width of a size over its distance from that of no effect, the smallest of the term's sizes: infinite where none has an interval.
/// A limit does nothing from somewhere on, which one over it tells: it is as doubtful as its half width is to its value. None of an
/// effect without a size.
fn doubt(term: &Term, halves: &[f64]) -> Option<f64> {
    let info = term.kind.info();
    let is_limit = info.parameters.iter().all(|parameter| parameter.neutral.is_none());
    let sizes = term.free.iter().zip(halves).filter_map(|(&number, &half)| {
        let nothing = info.parameters[number].neutral.or(is_limit.then_some(0.0))?;
        Some(half / (term.values[number] - nothing).abs().max(f64::MIN_POSITIVE))
    });
    sizes.reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::super::super::cross::Folds;
    use super::super::super::cut::Lengths;
    use super::super::super::floor::Floor;
    use super::super::super::hinge::{read, robot, swings};
    use super::super::super::scales::Scales;
    use super::*;

    /// The doubt of an effect with `value` as every number, of which those called `sizes` have half widths.
    fn doubt_of(kind: Kind, value: f64, sizes: &[(&str, f64)]) -> Option<f64> {
        let parameters = kind.info().parameters;
        let place = |name: &str| parameters.iter().position(|p| p.name == name).expect("a parameter");
        let term = Term {
            kind,
            target: 0,
            values: vec![value; parameters.len()],
            free: sizes.iter().map(|(name, _)| place(name)).collect(),
            table: None,
            held: false,
        };
        let halves: Vec<f64> = sizes.iter().map(|(_, half)| *half).collect();
        doubt(&term, &halves)
    }

    #[test]
    fn a_size_is_doubted_by_how_far_its_interval_reaches_towards_no_effect() {
        assert_eq!(doubt_of(Kind::Backlash, 0.002, &[("gap", 0.008)]), Some(4.0));
        let scale = doubt_of(Kind::SensorScale, 1.25, &[("scale", 0.125)]);
        assert_eq!(scale, Some(0.5), "a scale of one is none");
        let ripple = |cosine, sine| {
            doubt_of(
                Kind::PositionRipple,
                0.5,
                &[("cosine", cosine), ("sine", sine), ("frequency", 1e3)],
            )
        };
        assert_eq!(
            ripple(2.0, 0.25),
            Some(0.5),
            "one size that is certain is enough, and a frequency is no size"
        );
        assert_eq!(ripple(f64::INFINITY, 2.0), Some(4.0));
        assert_eq!(
            doubt_of(Kind::Backlash, 0.002, &[("gap", f64::INFINITY)]),
            Some(f64::INFINITY),
            "what has no interval"
        );
        let limit = doubt_of(Kind::CommandRateLimit, 12.0, &[("speed", 15.0)]);
        assert_eq!(limit, Some(1.25), "no limit is an infinite one");
    }

    #[test]
    fn without_its_only_effect_a_model_is_no_worse_than_re_tuning_alone() {
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let mut data = swings(&robot, 2, lengths);
        let nominal = Model::nominal(&robot, &data.trials);
        read(&mut data, &nominal);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        let mut selection = selector.run(&nominal, &[], &|_| ());
        assert!(selection.last.model.terms.is_empty());
        let mut with = nominal;
        with.terms = vec![Term {
            kind: Kind::CommandDelay,
            target: 0,
            values: vec![1e-5],
            free: vec![0],
            table: None,
            held: false,
        }];
        selection.last = selector.fit(&with).fit;
        selection.p_values = vec![0.0];
        // A minimum that what is re-tuned beside the effect has no way to.
        selection.refit.losses.iter_mut().for_each(|loss| loss.squares *= 0.5);
        assert!(selector.drop_doubtful(&mut selection));
        assert_eq!(
            selection.rejected.last().map(|rejected| rejected.kind),
            Some(Kind::CommandDelay)
        );
        assert_eq!(total(&selection.last.losses), total(&selection.refit.losses));
    }

    #[test]
    fn friction_that_one_direction_has_none_of_is_named_with_the_torque_that_does_the_same() {
        let robot = robot("kp = 30.0\nkd = 1.0\nfriction = 0.3\n");
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let mut data = swings(&robot, 2, lengths);
        let nominal = Model::nominal(&robot, &data.trials);
        let mut truth = nominal.clone();
        truth.terms = vec![Term {
            kind: Kind::DirectionalFriction,
            target: 0,
            values: vec![0.4, 0.0],
            free: vec![0],
            table: None,
            held: false,
        }];
        read(&mut data, &truth);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        let mut selection = selector.run(&nominal, &[], &|_| ());
        selector.drop_doubtful(&mut selection);
        let named: Vec<Kind> = selection
            .alike
            .iter()
            .flat_map(|set| set.others.iter().chain([&set.chosen]))
            .map(|own| own.0)
            .collect();
        assert_eq!(selection.last.model.terms.len(), 1);
        for kind in [Kind::DirectionalFriction, Kind::ExternalForce] {
            assert!(named.contains(&kind), "{named:?}");
        }
        assert_eq!(selection.last.model.terms[0].kind, selection.alike[0].chosen.0);
    }
}
