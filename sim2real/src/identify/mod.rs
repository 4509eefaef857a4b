//! From logs and a nominal robot to the effects the model lacks: `omniwalk identify`.
//!
//! ```text
//! Recording --trial--> commands and readings --rollout--> predictions --fit--> parameters
//!     nominal --refit--> re-tuned --select, cross--> + effects --torque--> what is left, and what it depends on
//! ```
//!
//! A robot whose base is held is followed through whole logs. One that walks freely is started anew from the measured state after every
//! landing of a foot, at least every 0.3 s (multiple shooting), on level ground, with the base as its inertial measurement unit or odometry says and the lowest corners
//! of its soles at rest on the ground. What nobody measured of these starts is fitted to each stretch and taken out of its residual
//! (`starts`), and so is what another model of ground contact would change (`contact`).
//!
//! The logs that are held out are asked for after the last choice was made: [`run`] takes a function that opens them.

mod base;
mod candidates;
mod contact;
mod cross;
mod fit;
mod information;
mod interval;
mod landings;
mod leftover;
mod measure;
mod model;
mod noise;
mod outcome;
mod own;
mod report;
mod rollout;
mod scales;
mod screen;
mod select;
mod split;
mod starts;
mod state;
mod supply;
mod torque;
mod trial;
mod write;

pub use information::Information;
pub use measure::{Errors, Measure, measure};
pub use report::{Accepted, Outcome, Parameter, Rejected, Sets, Verdict};
pub use scales::{JointScale, Scales};
pub use torque::{Moment, lacking, names};
pub use trial::{DT, Trial, TrialError};

use std::collections::BTreeMap;

use omniwalk_env::effect::Kind;
use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::{Base, Robot, RobotError};

use crate::check::Check;
use crate::recording::{Recording, RecordingError};
use cross::Folds;
use fit::{Data, total};
use leftover::{COARSE, Floor, TOO_COARSE};
use model::{Model, Term};
use own::Own;
use select::{LESSER, Selection, Selector};
use split::Split;

/// Why nothing could be identified.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum IdentifyError {
    /// Logs and robot do not fit together.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Trial(#[from] TrialError),
    /// An engine does not take the robot.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The robot with the effects could not be read again.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Robot(#[from] RobotError),
    /// The logs that are held out could not be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Recording(#[from] RecordingError),
    /// A file could not be written.
    #[error("{path}: {source}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
}

/// A torque limit that is looked for below the nominal one begins at this share of it.
const LOWER_LIMIT: f64 = 0.7;
/// Physics steps a millisecond where one is too coarse.
const FINER: usize = 4;

/// Opens the logs that are held out.
pub type Open<'a> = &'a dyn Fn() -> Result<Vec<Recording>, RecordingError>;

/// What to identify, and where it goes.
pub struct Task<'a> {
    /// The nominal robot.
    pub robot: &'a Robot,
    /// Its files: the URDF, and the TOML if there is one.
    pub files: (std::path::PathBuf, Option<std::path::PathBuf>),
    /// Logs to fit.
    pub logs: Vec<Recording>,
    /// Logs that are held out, opened after the last choice; `None` to set some of `logs` aside.
    pub heldout: Option<Open<'a>>,
    /// Whether every effect at once is fitted too, to compare with.
    pub compare: bool,
    /// Folder for the robot with its effects.
    pub out: &'a std::path::Path,
}

/// How far a simulation is from logs.
pub struct Replay {
    /// In measured quantities.
    pub measure: Measure,
    /// Root mean square of the torque that the simulation lacks to follow the logs, by joint, N m or N.
    pub torque: BTreeMap<String, f64>,
}

/// Runs the logged commands through `robot`'s simulation and compares with the readings: whole logs where the base is held, stretches
/// of 0.3 s from the measured state where it is not.
///
/// # Errors
/// [`IdentifyError`] when logs and robot do not fit together.
pub fn replay(robot: &Robot, logs: &[Recording]) -> Result<Replay, IdentifyError> {
    let trials = split::all(robot, logs)?;
    let scales = Scales::new(robot, &trials);
    let mut data = Data::new(robot, trials)?;
    data.fit_starts(&Model::default())?;
    let measure = measure(robot, &data.trials, 1)?;
    let root = |moments: &Vec<Moment>| {
        let squares: f64 = moments.iter().map(|m| m.torque * m.torque).sum();
        (squares / moments.len().max(1) as f64).sqrt()
    };
    let lacking = lacking(&data, &Model::default(), &scales)?;
    let torque = lacking
        .iter()
        .enumerate()
        .map(|(d, own)| (robot.dof(d).name.clone(), root(own)));
    Ok(Replay {
        torque: torque.collect(),
        measure,
    })
}

/// Identifies the effects that the robot's model lacks; `log` hears of progress.
///
/// # Errors
/// [`IdentifyError`]. Logs that cannot carry an answer are no error: the verdict says so.
pub fn run(task: &Task<'_>, log: &dyn Fn(&str)) -> Result<Outcome, IdentifyError> {
    let robot = task.robot;
    let mut split = split::split(robot, &task.logs, task.heldout.is_some())?;
    let check = Check::new(&task.logs, robot);
    log(check.to_string().trim_end());
    let mut reasons: Vec<String> = check.refusals.iter().map(ToString::to_string).collect();
    reasons.extend(split::insufficient(robot, &split.fit));
    if reasons.is_empty() {
        reasons.extend(leave_disagreed(robot, &mut split, log)?);
    }
    if !reasons.is_empty() {
        return Ok(Outcome::insufficient(robot, reasons, check));
    }
    let scales = Scales::new(robot, &split.fit);
    let mut data = Data::new(robot, split.fit.clone())?;
    let folds = Folds::new(&data);
    let nominal = Model::nominal(robot, &data.trials);
    let information = information::information(robot, &mut data, &nominal, &scales);
    let untold = information::untold(&information);
    if !untold.is_empty() {
        log(&format!("these logs cannot tell {untold}"));
    }
    let Choice { selection, floor } = choose(robot, &mut data, &nominal, &scales, &folds, log)?;
    let selector = Selector::new(robot, &data, &scales, &folds, &floor);
    let all_at_once = task.compare.then(|| selector.all_at_once(&selection.refit.model));
    let left = leftover::leftover(&data, &selection, &scales, &folds, &floor)?;
    let intervals = interval::intervals(&data, &selection.last, &folds, &scales);
    let supplies = supply::sets(&selector, &selection.last, &intervals);
    // The last choice is made: what was held out may be opened.
    let heldout = match task.heldout {
        Some(open) => split::all(robot, &open()?)?,
        None => split.heldout.clone(),
    };
    let heldout = split::agreed(robot, heldout)?;
    let with = write::extended(task, &selection, &left, &intervals)?;
    let mut corrected = omniwalk_env::robot::load(&with)?;
    // What walks freely may have been identified on a stand.
    (corrected.base, corrected.base_pose) = (robot.base, robot.base_pose);
    outcome::outcome(
        outcome::Parts {
            robot,
            corrected: &corrected,
            data: &data,
            scales: &scales,
            folds: &folds,
            floor: &floor,
            selection: &selection,
            left: &left,
            intervals: &intervals,
            supplies: &supplies,
            all_at_once: all_at_once.as_ref(),
            split: &split,
            check: &check,
            information: &information,
        },
        heldout,
    )
}

/// Leaves out what models of contact do not agree about and what is far off; why what is left cannot carry an answer, if so.
fn leave_disagreed(robot: &Robot, split: &mut Split, log: &dyn Fn(&str)) -> Result<Vec<String>, IdentifyError> {
    if robot.base != Base::Floating {
        return Ok(Vec::new());
    }
    let all = split.fit.len();
    split.fit = split::agreed(robot, std::mem::take(&mut split.fit))?;
    let kept = format!(
        "models of ground contact agree about {} of {all} stretches",
        split.fit.len()
    );
    log(&kept);
    let reasons = split::insufficient(robot, &split.fit);
    Ok(reasons
        .into_iter()
        .map(|reason| format!("{kept}; of those, {reason}"))
        .collect())
}

/// What was chosen at a physics step.
struct Choice {
    selection: Selection,
    floor: Floor,
}

/// Re-tunes the nominal model, then takes the effects that help; where the physics step is too coarse for a model on the
/// way, it is made finer, and the steps go on from there.
fn choose(
    robot: &Robot,
    data: &mut Data,
    nominal: &Model,
    scales: &Scales,
    folds: &Folds,
    log: &dyn Fn(&str),
) -> Result<Choice, EngineError> {
    // Joints that are measured well count as much as those that are not: each in units of what the re-tuned model leaves.
    data.weights = leftover::weights(data, nominal);
    let mut tuned = retuned(data, nominal, scales);
    data.fit_starts(&tuned)?;
    if data.is_free() {
        // A finer step is another model of contact too: what the step changes counts as the floor's.
        return steps(robot, data, scales, folds, log, (&tuned, &[], None));
    }
    if leftover::is_coarse(data, &tuned, TOO_COARSE)? {
        return fine(robot, data, scales, folds, log, (&tuned, &[], None));
    }
    let choice = steps(robot, data, scales, folds, log, (&tuned, &[], None))?;
    if !leftover::is_coarse(data, &choice.selection.last.model, COARSE)? {
        return Ok(choice);
    }
    log("the physics step is too coarse for what was found: on with a finer one");
    let found = &choice.selection.last.model;
    let rivals = choice.selection.rivals();
    tuned.tuned.clone_from(&choice.selection.refit.model.tuned);
    fine(robot, data, scales, folds, log, (&tuned, &found.terms, Some(&rivals)))
}

/// The nominal model re-tuned, from its values and with lower torque limits: a limit that the nominal robot does not reach has no
/// slope that would lead to one that the real robot does.
fn retuned(data: &Data, nominal: &Model, scales: &Scales) -> Model {
    let from = |share: f64| {
        let mut model = nominal.clone();
        let limits = model.tuned.iter_mut().filter(|tuned| tuned.own == Own::TorqueLimit);
        limits.for_each(|tuned| tuned.value *= share);
        data.fit(&model, scales, &|_| true)
    };
    let [as_told, lower] = [from(1.0), from(LOWER_LIMIT)];
    let better = total(&lower.losses) < (1.0 - LESSER) * total(&as_told.losses);
    if better { lower.model } else { as_told.model }
}

/// Where steps begin: the re-tuned model, the effects it has already, and what may take their place.
type From<'a> = (&'a Model, &'a [Term], Option<&'a [(Kind, usize)]>);

/// The same at a finer physics step.
fn fine(
    robot: &Robot,
    data: &mut Data,
    scales: &Scales,
    folds: &Folds,
    log: &dyn Fn(&str),
    (tuned, terms, rivals): From<'_>,
) -> Result<Choice, EngineError> {
    data.finer = FINER;
    let tuned = data.fit(tuned, scales, &|_| true).model;
    steps(robot, data, scales, folds, log, (&tuned, terms, rivals))
}

/// Steps at the data's physics step.
fn steps(
    robot: &Robot,
    data: &mut Data,
    scales: &Scales,
    folds: &Folds,
    log: &dyn Fn(&str),
    (tuned, terms, rivals): From<'_>,
) -> Result<Choice, EngineError> {
    data.weights = leftover::weights(data, tuned);
    let mut floor = Floor::new(data, tuned, scales)?;
    if data.is_free() {
        data.weights = floor.inverse();
        floor = floor.weighted(&data.weights);
    }
    let data = &*data;
    log(&format!(
        "re-tuned: {:.5} of the readings' scale; floor {:.5}; {} physics steps a ms",
        leftover::root(data, tuned),
        floor.root(),
        data.finer
    ));
    let selector = Selector {
        rivals,
        ..Selector::new(robot, data, scales, folds, &floor)
    };
    let selection = selector.run(tuned, terms, log);
    Ok(Choice { selection, floor })
}
