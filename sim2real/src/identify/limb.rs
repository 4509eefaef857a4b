//! What is found of a limb: re-tuning, then effects, at the physics step that suffices.

use std::sync::Arc;

use omniwalk_env::effect::Kind;
use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::Robot;

use super::cross::Folds;
use super::fit::{Data, total};
use super::floor::Floor;
use super::found::Found;
use super::journal::Journal;
use super::leftover::{self, COARSE, TOO_COARSE};
use super::model::{Model, Term};
use super::own::Own;
use super::scales::Scales;
use super::select::{Count, LESSER, Selection, Selector};
use super::separate::Logs;
use super::trial::Trial;
use super::{IdentifyError, causes, information, interval};

/// A torque limit that is looked for below the nominal one begins at this share of it.
const LOWER_LIMIT: f64 = 0.7;
/// Physics steps a millisecond where one is too coarse, and where those are.
const FINER: [usize; 2] = [4, 16];

/// How to look.
#[derive(Clone, Debug)]
pub struct Search {
    /// Limbs that are looked at alike: an effect is the best of those of all of them.
    pub limbs: usize,
    /// Whether every effect at once is fitted too, to compare with.
    pub compare: bool,
    /// What an interrupted search came to.
    pub journal: Arc<Journal>,
}

/// Finds what the model of `robot`, a limb or a whole robot, lacks in `trials`, which come back with the starts that were fitted; `log`
/// hears of progress.
///
/// # Errors
/// When a trial is none of this robot's, or an engine does not take the robot.
pub fn find(
    robot: &Robot,
    trials: Vec<Trial>,
    search: &Search,
    log: &dyn Fn(&str),
) -> Result<(Found, Vec<Trial>), IdentifyError> {
    let scales = Scales::new(robot, &trials);
    let mut data = Data::new(robot, trials)?;
    data.journal = Some(Arc::clone(&search.journal));
    let folds = Folds::new(&data);
    let nominal = Model::nominal(robot, &data.trials);
    let untold = information::untold(&information::information(robot, &mut data, &nominal, &scales));
    if !untold.is_empty() {
        log(&format!("these logs cannot tell {untold}"));
    }
    let (mut selection, floor) = Way {
        robot,
        scales: &scales,
        folds: &folds,
        limbs: search.limbs,
        log,
    }
    .choose(&mut data, &nominal)?;
    // Far from the logs the nominal model may be at limits that the machine never met.
    let information = information::information(robot, &mut data, &selection.refit.model, &scales);
    let selector = Selector {
        limbs: search.limbs,
        ..Selector::new(robot, &data, &scales, &folds, &floor)
    };
    selector.drop_doubtful(&mut selection);
    selector.prefer_tables(&mut selection, &|selection| leftover::open(&data, selection, &floor));
    selector.keep_untold(&mut selection);
    // Beside numbers that are back where the robot has them an effect can be another size, and hold none.
    while selector.drop_doubtful(&mut selection) {
        selector.keep_untold(&mut selection);
    }
    let all_at_once = search.compare.then(|| selector.all_at_once(&selection.refit.model));
    let left = leftover::leftover(&selector, &selection, &floor)?;
    let intervals = interval::intervals(&selector, &selection.last);
    let right: Vec<f64> = intervals.iter().map(|half| half.right).collect();
    let common = causes::sets(&selector, &selection.last, &right, &left);
    let logs = Logs {
        robot,
        data: &data,
        scales: &scales,
        floor: &floor,
    };
    let separations = logs.separations(&selection, &common);
    let last = &selection.last.model;
    let without = |i: usize| {
        let mut without = last.clone();
        without.terms.remove(i);
        data.fit(&without, &scales, &|_| true).model
    };
    let found = Found {
        without: (0..last.terms.len()).map(without).collect(),
        refit: selection.refit.model,
        last: selection.last.model,
        all_at_once,
        intervals: intervals.iter().map(|half| half.whole).collect(),
        p_values: selection.p_values,
        rejected: selection.rejected,
        alike: selection.alike,
        causes: common.into_iter().map(|cause| cause.names).collect(),
        separations,
        tried: selection.tried,
        left,
        floor,
        information,
        folds: folds.by,
        finer: data.finer,
    };
    Ok((found, Arc::unwrap_or_clone(data.trials)))
}

/// Every effect at once beside the re-tuned model of `robot`, a limb or a whole robot, fitted to `trials`, and the physics steps a millisecond
/// that suffice for the re-tuned model: what the choice is compared with.
///
/// # Errors
/// As [`find`].
pub fn all_at_once(robot: &Robot, trials: Vec<Trial>) -> Result<(Model, usize), IdentifyError> {
    let scales = Scales::new(robot, &trials);
    let mut data = Data::new(robot, trials)?;
    let nominal = Model::nominal(robot, &data.trials);
    let folds = Folds::new(&data);
    let way = Way {
        robot,
        scales: &scales,
        folds: &folds,
        limbs: 1,
        log: &|_| {},
    };
    data.weights = leftover::weights(&data, &nominal);
    let mut tuned = way.retuned(&data, &nominal);
    data.fit_starts(&tuned)?;
    let mut finer = if data.is_free() { [].iter() } else { FINER.iter() };
    while way.is_coarse(&data, &tuned, TOO_COARSE)?
        && let Some(&finer) = finer.next()
    {
        data.finer = finer;
        tuned = data.fit(&tuned, &scales, &|_| true).model;
    }
    data.weights = leftover::weights(&data, &tuned);
    let floor = Floor::new(&data, &tuned, &scales)?;
    let selector = Selector::new(robot, &data, &scales, &folds, &floor);
    Ok((selector.all_at_once(&tuned), data.finer))
}

/// What was chosen at a physics step, and the floor there.
type Choice = (Selection, Floor);

/// Where steps begin.
#[derive(Clone, Copy)]
struct Start<'a> {
    /// The re-tuned model.
    tuned: &'a Model,
    /// The effects it has already.
    terms: &'a [Term],
    /// Among how many those were chosen.
    counts: &'a [Count],
    /// What may take their place; all when `None`.
    rivals: Option<&'a [(Kind, usize)]>,
}

impl<'a> Start<'a> {
    /// From `tuned` without effects.
    fn bare(tuned: &'a Model) -> Self {
        Self {
            tuned,
            terms: &[],
            counts: &[],
            rivals: None,
        }
    }
}

/// What all stages work with.
struct Way<'a> {
    robot: &'a Robot,
    scales: &'a Scales,
    folds: &'a Folds,
    limbs: usize,
    log: &'a dyn Fn(&str),
}

impl Way<'_> {
    /// Re-tunes the nominal model, then takes the effects that help; where the physics step is too coarse for a model on the
    /// way, it is made finer, and the steps go on from there.
    fn choose(&self, data: &mut Data, nominal: &Model) -> Result<Choice, EngineError> {
        // Joints that are measured well count as much as those that are not: each in units of what the re-tuned model leaves.
        data.weights = leftover::weights(data, nominal);
        let mut tuned = self.retuned(data, nominal);
        data.fit_starts(&tuned)?;
        if data.is_free() {
            // A finer step is another model of contact too: what the step changes counts as the floor's.
            return self.steps(data, Start::bare(&tuned));
        }
        let mut finer = FINER.iter();
        while self.is_coarse(data, &tuned, TOO_COARSE)?
            && let Some(&finer) = finer.next()
        {
            tuned = self.retuned_finer(data, &tuned, finer);
        }
        let (mut selection, mut floor) = self.steps(data, Start::bare(&tuned))?;
        while self.is_coarse(data, &selection.last.model, COARSE)?
            && let Some(&finer) = finer.next()
        {
            (self.log)("the physics step is too coarse for what was found: on with a finer one");
            tuned = self.retuned_finer(data, &selection.refit.model, finer);
            let rivals = selection.rivals();
            let start = Start {
                tuned: &tuned,
                terms: &selection.last.model.terms,
                counts: &selection.counts,
                rivals: Some(&rivals),
            };
            let (next, below) = self.steps(data, start)?;
            (selection, floor) = (next.after(selection), below);
        }
        Ok((selection, floor))
    }

    /// Whether the step is too coarse for `model`. Of what a millisecond leaves open values could be off by as much as noise lets them be known;
    /// from there on a finer step, which is dear, has to be what the floor asks for.
    fn is_coarse(&self, data: &Data, model: &Model, share: f64) -> Result<bool, EngineError> {
        let share = if data.finer == 1 { share } else { TOO_COARSE };
        Ok(leftover::is_coarse(data, model, share)?
            && (data.finer == 1 || Floor::new(data, model, self.scales)?.is_of_step()))
    }

    /// The `tuned` model re-tuned at so many physics steps a millisecond.
    fn retuned_finer(&self, data: &mut Data, tuned: &Model, finer: usize) -> Model {
        data.finer = finer;
        data.fit_shaken(std::slice::from_ref(tuned), self.scales).model
    }

    /// The nominal model re-tuned, from its values and with lower torque limits: a limit that the nominal robot does not reach has no
    /// slope that would lead to one that the real robot does.
    fn retuned(&self, data: &Data, nominal: &Model) -> Model {
        let from = |share: f64| {
            let mut model = nominal.clone();
            let limits = model.tuned.iter_mut().filter(|tuned| tuned.own == Own::TorqueLimit);
            limits.for_each(|tuned| tuned.value *= share);
            data.fit(&model, self.scales, &|_| true)
        };
        let [as_told, lower] = [from(1.0), from(LOWER_LIMIT)];
        let better = total(&lower.losses) < (1.0 - LESSER) * total(&as_told.losses);
        let start = if better { lower.model } else { as_told.model };
        data.fit_shaken(&[start], self.scales).model
    }

    /// Steps at the data's physics step.
    fn steps(&self, data: &mut Data, start: Start<'_>) -> Result<Choice, EngineError> {
        let tuned = start.tuned;
        data.weights = leftover::weights(data, tuned);
        let mut floor = Floor::new(data, tuned, self.scales)?;
        if data.is_free() {
            data.weights = floor.inverse();
            floor = floor.weighted(&data.weights);
        }
        data.typical = data.typical_under(tuned);
        (self.log)(&format!(
            "re-tuned; the floor is {:.2} of what that leaves; physics steps a ms: {}",
            floor.root() / leftover::root(data, tuned),
            data.finer
        ));
        let selector = Selector {
            rivals: start.rivals,
            limbs: self.limbs,
            counts: start.counts,
            ..Selector::new(self.robot, data, self.scales, self.folds, &floor)
        };
        let selection = selector.run(tuned, start.terms, self.log);
        let Some(better) = self.better_tuned(data, &selection) else {
            return Ok((selection, floor));
        };
        (self.log)("from there re-tuning alone does better than before: again");
        let again = Start {
            tuned: &better,
            terms: &selection.last.model.terms,
            counts: &selection.counts,
            ..start
        };
        self.steps(data, again)
    }

    /// The re-tuned model without effects where the way over them has led it out of a lesser minimum: what was found beside that may
    /// be none.
    fn better_tuned(&self, data: &Data, selection: &Selection) -> Option<Model> {
        let mut model = selection.last.model.clone();
        if model.terms.is_empty() {
            return None;
        }
        model.terms.clear();
        let plain = data.fit(&model, self.scales, &|_| true);
        (total(&plain.losses) < (1.0 - LESSER) * total(&selection.refit.losses)).then_some(plain.model)
    }
}
