//! What is fitted: the nominal robot's own parameters, and effects beside them, as one list of scaled numbers.

use omniwalk_env::effect::{self, Effect, Kind, Scale, Site, Table};
use omniwalk_env::robot::Robot;

use super::own::Own;
use super::scales::Scales;
use super::trial::Trial;

/// Fewest cycles of a ripple over the range of motion.
pub const FEWEST_CYCLES: f64 = 1.5;

/// A parameter of the nominal model with its value.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// Degree of freedom.
    pub dof: usize,
    /// Which.
    pub own: Own,
    /// The nominal value; of a joint's own number it is also its scale.
    pub nominal: f64,
    /// Its value.
    pub value: f64,
    /// Whether it is held while others are fitted.
    pub held: bool,
}

/// An effect with the values that are fitted.
#[derive(Clone, Debug)]
pub struct Term {
    /// The model.
    pub kind: Kind,
    /// Degree of freedom or link.
    pub target: usize,
    /// All values, in the catalogue's order; of a table those at its points.
    pub values: Vec<f64>,
    /// Which of them are fitted.
    pub free: Vec<usize>,
    /// The table of a residual torque, over one variable.
    pub table: Option<Table>,
    /// Whether it is held while others are fitted.
    pub held: bool,
}

impl Term {
    /// The effect with its present values.
    pub fn effect(&self) -> Effect {
        let (values, table) = match &self.table {
            None => (self.values.clone(), None),
            Some(table) => {
                let values = self.values.clone();
                (
                    Vec::new(),
                    Some(Table {
                        values,
                        ..table.clone()
                    }),
                )
            }
        };
        Effect {
            kind: self.kind,
            target: self.target,
            values,
            table,
        }
    }
}

/// A model of a robot: nominal parameters and effects.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// The nominal model's own parameters.
    pub tuned: Vec<Tuned>,
    /// Effects.
    pub terms: Vec<Term>,
}

/// A fitted number: value = x times scale.
#[derive(Clone, Copy, Debug)]
pub struct Free {
    /// Scale.
    pub scale: f64,
    /// Smallest x.
    pub lower: f64,
    /// Largest x.
    pub upper: f64,
    /// Step of finite differences in x.
    pub step: f64,
}

impl Free {
    /// A number that a joint has, in units of its nominal value.
    fn of_joint(tuned: &Tuned) -> Self {
        Self {
            scale: tuned.nominal,
            lower: if tuned.own == Own::Friction || tuned.own == Own::Damping {
                0.0
            } else {
                0.02
            },
            upper: 50.0,
            step: 2e-3 * (tuned.value / tuned.nominal).max(0.05),
        }
    }

    /// Number `i` of the effect `kind` on `target`, which is `value`; beyond the catalogue's it is one of a table.
    fn of_effect(kind: Kind, i: usize, target: usize, value: f64, scales: &Scales) -> Self {
        let info = kind.info();
        let Some(parameter) = info.parameters.get(i) else {
            return Self::of_table(value, scales.of(Scale::Torque, info.site, target));
        };
        let scale = scales.of(parameter.scale, info.site, target);
        let typical = match parameter.scale {
            Scale::Time => 0.01,
            _ => parameter.starts.iter().fold(0.02, |a: f64, s| a.max(s.abs())),
        };
        let near = (value / scale).abs();
        let mut lower = parameter.bounds.lower / scale;
        // Speeds, limits and frequencies of zero are no machine's.
        if parameter.neutral.is_none() {
            lower = lower.max(1e-3);
        }
        // What does not repeat within the range is no ripple.
        if parameter.scale == Scale::Frequency {
            lower = lower.max(FEWEST_CYCLES);
        }
        Self {
            scale,
            lower,
            upper: (parameter.bounds.upper / scale).max(lower),
            step: 5e-3 * near.max(0.1 * typical),
        }
    }

    /// A torque `value` of a table on a joint with so much torque.
    fn of_table(value: f64, scale: f64) -> Self {
        Self {
            scale,
            lower: -50.0,
            upper: 50.0,
            step: 5e-3 * (value / scale).abs().max(0.02),
        }
    }
}

impl Model {
    /// The nominal model with every parameter it has.
    pub fn nominal(robot: &Robot, trials: &[Trial]) -> Self {
        let mut robot = robot.clone();
        let mut tuned = Vec::new();
        for d in 0..robot.dofs.len() {
            let efforts = trials.iter().all(|trial| trial.told[d].effort);
            for own in Own::all(&robot, d) {
                // Gains mean nothing where torques are commanded.
                if efforts && matches!(own, Own::KpScale | Own::Kd) {
                    continue;
                }
                let is_set = |value: &f64| own.parameter().is_some() || *value > 0.0 && *value < 1e6;
                let value = own.of(&mut robot, d).map(|value| *value).filter(is_set);
                tuned.extend(value.map(|value| Tuned {
                    dof: d,
                    own,
                    nominal: value,
                    value,
                    held: false,
                }));
            }
        }
        Self {
            tuned,
            terms: Vec::new(),
        }
    }

    /// The fitted numbers in their order.
    pub fn free(&self, scales: &Scales) -> Vec<Free> {
        let own = self.tuned.iter().filter(|tuned| !tuned.held);
        let own = own.map(|tuned| match tuned.own {
            Own::OfEffect { kind, number } => Free::of_effect(kind, number, tuned.dof, tuned.value, scales),
            _ => Free::of_joint(tuned),
        });
        let effects = self.terms.iter().filter(|term| !term.held).flat_map(|term| {
            let of = |&i: &usize| Free::of_effect(term.kind, i, term.target, term.values[i], scales);
            term.free.iter().map(of)
        });
        own.chain(effects).collect()
    }

    /// All values, held ones too.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        let own = self.tuned.iter().map(|tuned| tuned.value);
        own.chain(self.terms.iter().flat_map(|term| term.values.iter().copied()))
    }

    /// Puts `values`, in the order of [`Self::values`], in their place.
    pub fn put_values(&mut self, values: &[f64]) {
        let own = self.tuned.iter_mut().map(|tuned| &mut tuned.value);
        let own = own.chain(self.terms.iter_mut().flat_map(|term| &mut term.values));
        own.zip(values).for_each(|(own, value)| *own = *value);
    }

    /// The fitted numbers, scaled.
    pub fn get(&self, scales: &Scales) -> Vec<f64> {
        let own = self.tuned.iter().filter(|tuned| !tuned.held).map(|tuned| tuned.value);
        let terms = self.terms.iter().filter(|term| !term.held);
        let effects = terms.flat_map(|term| term.free.iter().map(|&i| term.values[i]));
        let values = own.chain(effects);
        values
            .zip(self.free(scales))
            .map(|(value, free)| value / free.scale)
            .collect()
    }

    /// Sets the fitted numbers.
    pub fn set(&mut self, x: &[f64], scales: &Scales) {
        let free = self.free(scales);
        let mut values = x.iter().zip(&free).map(|(x, free)| x * free.scale);
        for tuned in self.tuned.iter_mut().filter(|tuned| !tuned.held) {
            tuned.value = values.next().unwrap_or(tuned.value);
        }
        for term in self.terms.iter_mut().filter(|term| !term.held) {
            for &i in &term.free {
                term.values[i] = values.next().unwrap_or(term.values[i]);
            }
        }
    }

    /// Of `numbers`, one for each that is fitted while nothing is held, those of term `index`.
    pub fn of_term<'a>(&self, index: usize, numbers: &'a [f64]) -> &'a [f64] {
        let before: usize = self.terms[..index].iter().map(|term| term.free.len()).sum();
        &numbers[self.tuned.len() + before..][..self.terms[index].free.len()]
    }

    /// With the numbers `x`.
    pub fn at(&self, x: &[f64], scales: &Scales) -> Self {
        let mut model = self.clone();
        model.set(x, scales);
        model
    }

    /// `robot` with this model's parameters and effects.
    pub fn robot(&self, robot: &Robot) -> Robot {
        let mut robot = robot.clone();
        for tuned in &self.tuned {
            if let Some(value) = tuned.own.of(&mut robot, tuned.dof) {
                *value = tuned.value;
            }
        }
        for term in &self.terms {
            effect::apply(&mut robot, &term.effect());
        }
        robot
    }

    /// Holds everything that is not on degree of freedom `dof` or the link it moves; nothing when `None`.
    pub fn hold_others(&mut self, robot: &Robot, dof: Option<usize>) {
        for tuned in &mut self.tuned {
            tuned.held = dof.is_some_and(|dof| dof != tuned.dof);
        }
        for term in &mut self.terms {
            let own = joint_of(robot, term.kind.info().site, term.target);
            term.held = dof.is_some_and(|dof| own != Some(dof));
        }
    }

    /// Whether anything is held.
    pub fn is_held(&self) -> bool {
        self.tuned.iter().any(|tuned| tuned.held) || self.terms.iter().any(|term| term.held)
    }

    /// Holds what is re-tuned on joints without an effect.
    pub fn hold_plain(&mut self, robot: &Robot) {
        let with: Vec<Option<usize>> = self
            .terms
            .iter()
            .map(|term| joint_of(robot, term.kind.info().site, term.target))
            .collect();
        for tuned in &mut self.tuned {
            tuned.held = !with.contains(&Some(tuned.dof));
        }
    }

    /// Sets what is re-tuned and not held back to its nominal value.
    pub fn straighten(&mut self) {
        let own = self.tuned.iter_mut().filter(|tuned| !tuned.held);
        own.for_each(|tuned| tuned.value = tuned.nominal);
    }

    /// The effect `kind` on `target`, if it is among the terms.
    pub fn term(&self, kind: Kind, target: usize) -> Option<&Term> {
        self.terms
            .iter()
            .find(|term| (term.kind, term.target) == (kind, target))
    }

    /// Both models together: of other joints.
    pub fn and(&self, other: &Self) -> Self {
        Self {
            tuned: [self.tuned.as_slice(), &other.tuned].concat(),
            terms: [self.terms.as_slice(), &other.terms].concat(),
        }
    }

    /// Takes over from `other` the re-tuned values of degree of freedom `dof` and the effects on it that this model lacks.
    pub fn take_joint(&mut self, dof: usize, other: &Self) {
        for (own, tuned) in self.tuned.iter_mut().zip(&other.tuned) {
            if own.dof == dof {
                own.value = tuned.value;
            }
        }
        let new = other.terms.iter().filter(|term| !self.has(term.kind, term.target));
        let new: Vec<Term> = new.filter(|term| term.target == dof).cloned().collect();
        self.terms.extend(new);
    }

    /// Whether the effect `kind` on `target` is among the terms.
    pub fn has(&self, kind: Kind, target: usize) -> bool {
        self.term(kind, target).is_some()
    }

    /// Adds `term`, in the place of one of the same effect on the same target.
    pub fn put(&mut self, term: Term) {
        let same = |own: &&mut Term| (own.kind, own.target) == (term.kind, term.target);
        match self.terms.iter_mut().find(same) {
            Some(own) => *own = term,
            None => self.terms.push(term),
        }
    }
}

/// The degree of freedom of an effect's target: the joint, or the joint that carries the link.
pub fn joint_of(robot: &Robot, site: Site, target: usize) -> Option<usize> {
    match site {
        Site::Joint => Some(target),
        Site::Link => target.checked_sub(1).map(|joint| robot.drivers()[joint].0),
    }
}
