//! The logs that are held out, once they may be opened: an hour's search is not lost to one of them that is bad.

use omniwalk_env::robot::Robot;

use super::trial::Trial;
use super::{IdentifyError, Open, split};
use crate::check::{Check, Fault};
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

/// Opens the logs that are held out of `robot`; `log` hears of what is wrong with them.
pub fn opened(robot: &Robot, open: Open<'_>, log: &dyn Fn(&str)) -> Heldout {
    let mut heldout = Heldout::default();
    match pieces(robot, open, &mut heldout.left_out) {
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

fn pieces(robot: &Robot, open: Open<'_>, left_out: &mut Vec<String>) -> Result<Vec<Trial>, IdentifyError> {
    let mut kept = Vec::new();
    for recording in open()? {
        match wrong(&recording, robot) {
            Some(reason) => left_out.push(reason),
            None => kept.push(recording),
        }
    }
    split::agreed(robot, split::all(robot, &kept)?)
}

/// What makes any error on `recording` unfounded; that it is short or moves little does not.
fn wrong(recording: &Recording, robot: &Robot) -> Option<String> {
    let check = Check::new(std::slice::from_ref(recording), robot);
    let little = [Fault::TooShort, Fault::NoExcitation];
    let finding = check.refusals.iter().find(|finding| !little.contains(&finding.fault))?;
    Some(match &finding.log {
        Some(_) => finding.to_string(),
        None => format!("{}: {finding}", recording.name),
    })
}
