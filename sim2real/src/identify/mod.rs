//! From logs and a nominal robot to the effects the model lacks: `omniwalk identify`.
//!
//! ```text
//! Recording --trial--> commands and readings --rollout--> predictions --fit--> parameters
//!     nominal --refit--> re-tuned --select, cross--> + effects --torque--> what is left, and what it depends on
//! ```
//!
//! A robot whose base is held is followed through whole logs, each limb by itself (`limb`), and through windows of very long ones
//! (`windows`). One that walks freely is started anew from the measured state after every
//! landing of a foot, at least every 0.3 s (multiple shooting), on level ground, with the base as its inertial measurement unit or odometry says and the lowest corners
//! of its soles at rest on the ground. What nobody measured of these starts is fitted to each stretch and taken out of its residual
//! (`starts`), and so is what another model of ground contact would change (`contact`).
//!
//! The logs that are held out are asked for after the last choice was made: [`run`] takes a function that opens them.

mod base;
mod bent;
mod candidates;
mod causes;
mod contact;
mod cross;
mod cut;
mod descent;
mod exchanged;
mod fit;
mod floor;
mod found;
mod gain;
mod grid;
mod heldout;
#[cfg(test)]
mod hinge;
mod information;
mod interval;
mod journal;
mod lacking;
mod landings;
mod leftover;
mod limb;
mod measure;
mod model;
mod motion;
mod noise;
mod outcome;
mod own;
mod past;
mod rehearsed;
mod report;
mod ripples;
mod rollout;
mod rough;
mod scales;
mod screen;
mod select;
mod separate;
mod shown;
mod split;
mod starts;
mod state;
mod torque;
mod trial;
mod windows;
mod write;

pub use information::Information;
pub use lacking::{Lacking, Predicted};
pub use measure::{Errors, Measure};
pub use report::{Accepted, Alternative, MeasuredTable, Outcome, Parameter, Rejected, Sets, Verdict};
pub use scales::{JointScale, Scales};
pub use separate::Separation;
pub use shown::{Confused, shown};
pub use torque::{Moment, lacking, names};
pub use trial::{DT, Trial, TrialError};

use std::path::Path;
use std::sync::Arc;

use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::{Base, Robot, RobotError};

use crate::check::Check;
use crate::recording::{Recording, RecordingError};
use fit::Data;
use found::Found;
use heldout::Heldout;
use journal::Journal;
use limb::Search;
use model::Model;
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
    #[error("cannot write {path}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
}

/// What is kept in the folder of what comes out until all of it is there.
const JOURNAL: &str = "unfinished";

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
    /// What the logs can carry.
    pub check: Check,
    /// In measured quantities.
    pub measure: Measure,
    /// Pieces of the logs that were followed.
    pub trials: Vec<Trial>,
    /// Of every joint: what its simulation lacks to follow the logs.
    pub lacking: Vec<Lacking>,
}

/// Runs the logged commands through `robot`'s simulation and compares with the readings: whole logs where the base is held, stretches
/// of 0.3 s from the measured state where it is not.
///
/// # Errors
/// [`IdentifyError`] when logs and robot do not fit together.
pub fn replay(robot: &Robot, logs: &[Recording]) -> Result<Replay, IdentifyError> {
    let mut check = Check::new(logs, robot);
    let trials = split::all(robot, logs)?;
    let scales = Scales::new(robot, &trials);
    let mut data = Data::new(robot, trials)?;
    data.fit_starts(&Model::default())?;
    check.refusals.extend(exchanged::exchanged(robot, logs, &check)?);
    Ok(Replay {
        check,
        measure: outcome::measured(robot, &Model::default(), &data.trials, 1)?,
        lacking: lacking::of_joints(robot, &data, &scales)?,
        trials: Arc::unwrap_or_clone(data.trials),
    })
}

/// Identifies the effects that the robot's model lacks; `log` hears of progress. What an interrupted run goes on from stays in the task's
/// folder until [`close`], for when the outcome is written too.
///
/// # Errors
/// [`IdentifyError`]. Logs that cannot carry an answer are no error: the verdict says so. Nor are held-out logs that cannot be compared:
/// the outcome says so.
pub fn run(task: &Task<'_>, log: &dyn Fn(&str)) -> Result<Outcome, IdentifyError> {
    let robot = task.robot;
    let mut check = Check::new(&task.logs, robot);
    if check.usable() {
        check.refusals = exchanged::exchanged(robot, &task.logs, &check)?;
    }
    log(check.to_string().trim_end());
    let refusals: Vec<String> = check.refusals.iter().map(ToString::to_string).collect();
    if !refusals.is_empty() {
        return Ok(Outcome::insufficient(robot, refusals, check));
    }
    // What another identification came to is refused before anything takes long.
    let journal = opened(task, log)?;
    let mut split = split::split(robot, &task.logs, task.heldout.is_some())?;
    let mut reasons = split::insufficient(robot, &split.fit);
    if reasons.is_empty() {
        reasons.extend(leave_disagreed(robot, &mut split, log)?);
    }
    if !reasons.is_empty() {
        return Ok(Outcome::insufficient(robot, reasons, check));
    }
    for trial in &split.fit {
        trial.robot(robot)?;
    }
    let Some((found, fitted)) = search(task, &split, &journal, log)? else {
        return Ok(Outcome::insufficient(
            robot,
            vec!["the robot has no joint".into()],
            check,
        ));
    };
    let with = write::extended(task, &found)?;
    let mut corrected = omniwalk_env::robot::load(&with)?;
    // What walks freely may have been identified on a stand.
    (corrected.base, corrected.base_pose) = (robot.base, robot.base_pose);
    // The last choice is made: what was held out may be opened.
    let heldout = match task.heldout {
        Some(open) => heldout::opened(robot, &task.logs, open, log),
        None => Heldout::of(split::agreed(robot, split.heldout.clone())?),
    };
    let parts = outcome::Parts {
        robot,
        corrected: &corrected,
        found: &found,
        fitted: &fitted,
        split: &split,
        check: &check,
    };
    let mut outcome = outcome::outcome(parts, heldout)?;
    let far = outcome.check.far_off(&outcome.nominal.fit.rmse.0);
    far.into_iter().for_each(|finding| log(&format!("note: {finding}")));
    Ok(outcome)
}

/// Whether `out` holds what an interrupted [`run`] goes on from.
pub fn is_unfinished(out: &Path) -> bool {
    out.join(JOURNAL).exists()
}

/// Removes what an interrupted [`run`] into `out` would go on from: what came of it is written.
///
/// # Errors
/// [`IdentifyError::Write`] when it cannot be removed.
pub fn close(out: &Path) -> Result<(), IdentifyError> {
    let path = out.join(JOURNAL);
    if !path.exists() {
        return Ok(());
    }
    std::fs::remove_file(&path).map_err(|source| cannot_write(&path, source))
}

/// The journal of a task, in the folder of what comes out.
fn opened(task: &Task<'_>, log: &dyn Fn(&str)) -> Result<Arc<Journal>, IdentifyError> {
    let all = (task.robot, &task.logs);
    let path = task.out.join(JOURNAL);
    let journal = Journal::open(&path, &all).map_err(|source| cannot_write(&path, source))?;
    if journal.len() > 0 {
        log(&format!(
            "goes on where it was interrupted: {} results are known",
            journal.len()
        ));
    }
    Ok(Arc::new(journal))
}

fn cannot_write(path: &Path, source: std::io::Error) -> IdentifyError {
    let path = path.display().to_string();
    IdentifyError::Write { path, source }
}

/// Errors of every effect at once, fitted to `logs`, there and on `heldout`: what identification is compared with, without it.
///
/// # Errors
/// [`IdentifyError`] when logs and robot do not fit together.
pub fn all_at_once(robot: &Robot, logs: &[Recording], heldout: &[Recording]) -> Result<Sets, IdentifyError> {
    let mut split = split::split(robot, logs, true)?;
    leave_disagreed(robot, &mut split, &|_| {})?;
    let heldout = split::agreed(robot, split::all(robot, heldout)?)?;
    let (mut whole, mut finest) = (Model::default(), 1);
    for limb in robot.limbs() {
        let trials = split.fit.iter().map(|trial| trial.of_limb(robot, &limb)).collect();
        let (mut model, finer) = limb::all_at_once(&limb.robot, windows::chosen(&limb.robot, trials))?;
        found::lift(&mut model, &limb);
        (whole, finest) = (whole.and(&model), finest.max(finer));
    }
    Ok(Sets {
        fit: outcome::measured(robot, &whole, &split.fit, finest)?,
        heldout: outcome::measured(robot, &whole, &heldout, finest)?,
    })
}

/// Looks at every limb by itself: nothing of another one's motion is in its own. What was found comes with the pieces of logs, their starts
/// fitted.
fn search(
    task: &Task<'_>,
    split: &Split,
    journal: &Arc<Journal>,
    log: &dyn Fn(&str),
) -> Result<Option<(Found, Vec<Trial>)>, IdentifyError> {
    let robot = task.robot;
    let limbs = robot.limbs();
    let search = Search {
        limbs: limbs.len(),
        compare: task.compare,
        journal: Arc::clone(journal),
    };
    let mut parts = Vec::with_capacity(limbs.len());
    // Starts are fitted where the base is not held: of a robot that is one limb.
    let mut fitted = split.fit.clone();
    for limb in limbs {
        if search.limbs > 1 {
            let joints = (0..limb.robot.dofs.len()).map(|d| limb.robot.dof(d).name.as_str());
            log(&joints.collect::<Vec<_>>().join(", "));
        }
        let trials = split.fit.iter().map(|trial| trial.of_limb(robot, &limb)).collect();
        let trials = windows::chosen(&limb.robot, trials);
        let (found, trials) = limb::find(&limb.robot, trials, &search, log)?;
        if robot.base == Base::Floating {
            fitted = trials;
        }
        parts.push((limb, found));
    }
    Ok(Found::together(parts, robot.dofs.len()).map(|found| (found, fitted)))
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
