//! The logs that are held out, once they may be opened: an hour's search is not lost to one of them that is bad.

use omniwalk_env::robot::Robot;

use super::trial::Trial;
use super::{IdentifyError, Open, split};
use crate::check::Check;
use crate::recording::Recording;

/// What can be compared of the logs that are held out.
#[derive(Default)]
pub struct Heldout {
    /// Pieces of them.
    pub trials: Vec<Trial>,
    /// Logs that are left out, with the reason.
    pub left_out: Vec<String>,
    /// Why none of them could be compared, if so.
    pub error: Option<String>,
}

impl Heldout {
    /// Pieces that were set aside of logs that were checked.
    pub fn of(trials: Vec<Trial>) -> Self {
        Self {
            trials,
            ..Self::default()
        }
    }
}

/// Opens the logs of `robot` that are held out, beside those that were `fitted`; `log` hears of what is wrong with them.
pub fn opened(robot: &Robot, fitted: &[Recording], open: Open<'_>, log: &dyn Fn(&str)) -> Heldout {
    let mut heldout = Heldout::default();
    match pieces(robot, fitted, open, &mut heldout.left_out) {
        Ok(trials) if trials.is_empty() => heldout.error = Some("no held-out log can be compared".into()),
        Ok(trials) => heldout.trials = trials,
        Err(error) => heldout.error = Some(format!("the held-out logs cannot be compared: {error}")),
    }
    heldout
        .left_out
        .iter()
        .for_each(|reason| log(&format!("left out: {reason}")));
    heldout
}

fn pieces(
    robot: &Robot,
    fitted: &[Recording],
    open: Open<'_>,
    left_out: &mut Vec<String>,
) -> Result<Vec<Trial>, IdentifyError> {
    let mut kept = Vec::new();
    for recording in open()? {
        match fitted_too(&recording, fitted).or_else(|| wrong(&recording, robot)) {
            Some(reason) => left_out.push(reason),
            None => kept.push(recording),
        }
    }
    split::agreed(robot, split::all(robot, &kept)?)
}

/// That the readings of `recording` are among those that were `fitted`, if so: its error would say nothing.
fn fitted_too(recording: &Recording, fitted: &[Recording]) -> Option<String> {
    let same = fitted.iter().find(|log| log.is_copy_of(recording))?;
    Some(format!(
        "{}: its readings are those of {}, which was fitted: a copy is not held out",
        recording.name, same.name
    ))
}

/// What makes any error on `recording` unfounded.
fn wrong(recording: &Recording, robot: &Robot) -> Option<String> {
    let check = Check::new(std::slice::from_ref(recording), robot);
    let finding = check.unfounded().next()?;
    Some(match &finding.log {
        Some(_) => finding.to_string(),
        None => format!("{}: {finding}", recording.name),
    })
}
