//! Joints that logs or a column map call by each other's names, in commands and readings alike: each follows the commands under its name, and
//! the simulation moves the wrong ones.
//!
//! Such logs are far off the nominal robot, and near to it with the two names exchanged. That cannot be seen of joints that are each other's
//! mirror image, nor where a robot walks: what a joint does on the ground hangs on all others.

use std::collections::BTreeMap;

use omniwalk_env::robot::{Base, Robot};

use super::cut::{self, Lengths};
use super::{IdentifyError, Model, outcome};
use crate::check::{Check, Fault, Finding, LogCheck};
use crate::recording::Recording;

/// So much of every log is simulated, s.
const LOOKED_AT: f64 = 20.0;
/// A joint is far off where its error is more than this share of how far it moves (root mean squares).
const FAR_OFF: f64 = 0.05;
/// Joints are exchanged where that leaves less than this share of the error of both.
const LEFT: f64 = 1.0 / 3.0;
/// Most joints that are tried with each other: the farthest off.
const MOST: usize = 12;

/// Errors by joint, rad or m.
type Errors = BTreeMap<String, f64>;

/// What `check` says of joints of `robot` that `logs` call by each other's names.
///
/// # Errors
/// [`IdentifyError`] when logs and robot do not fit together.
pub fn exchanged(robot: &Robot, logs: &[Recording], check: &Check) -> Result<Vec<Finding>, IdentifyError> {
    if robot.base == Base::Floating || robot.dofs.len() < 2 {
        return Ok(Vec::new());
    }
    for (log, check) in logs.iter().zip(&check.logs) {
        let errors = errors(robot, log)?;
        let far = far_off(&errors, check);
        let pairs = far
            .iter()
            .enumerate()
            .flat_map(|(i, a)| far[i + 1..].iter().map(move |b| (a, b)));
        let mut best: Option<(f64, Finding)> = None;
        for (a, b) in pairs {
            // Of a joint without a reading there no error is known, and nothing is found.
            let of = |errors: &Errors, joint: &str| errors.get(joint).copied().unwrap_or(f64::NAN);
            let both = |errors: &Errors| of(errors, a).hypot(of(errors, b));
            let (before, after) = (both(&errors), both(&self::errors(robot, &with_exchanged(log, a, b))?));
            if after < LEFT * before && best.as_ref().is_none_or(|(share, _)| after / before < *share) {
                best = Some((after / before, finding(log, (a, b), [before, after])));
            }
        }
        if let Some((_, finding)) = best {
            return Ok(vec![finding]);
        }
    }
    Ok(Vec::new())
}

/// Errors of the nominal `robot` over the beginning of `log`.
fn errors(robot: &Robot, log: &Recording) -> Result<Errors, IdentifyError> {
    let (block, piece) = (LOOKED_AT, f64::INFINITY);
    let trials = cut::cut(robot, log, 0, (0.0, LOOKED_AT), Lengths { block, piece })?;
    Ok(outcome::measured(robot, &Model::default(), &trials, 1)?.rmse.0)
}

/// Joints whose error is large beside their motion, the farthest off first.
fn far_off<'c>(errors: &Errors, check: &'c LogCheck) -> Vec<&'c str> {
    let share = |joint: &'c crate::check::JointCheck| {
        let error = errors.get(&joint.name)?;
        let moves = joint.position.deviation;
        (moves > 0.0 && *error > FAR_OFF * moves).then_some((error / moves, joint.name.as_str()))
    };
    let mut far: Vec<(f64, &str)> = check.joints.iter().filter_map(share).collect();
    far.sort_by(|a, b| b.0.total_cmp(&a.0));
    far.into_iter().take(MOST).map(|(_, name)| name).collect()
}

/// `log` in which two joints have each other's names.
fn with_exchanged(log: &Recording, a: &str, b: &str) -> Recording {
    let mut log = log.clone();
    for joint in &mut log.joints {
        let other = if joint.name == a { b } else { a };
        if joint.name == a || joint.name == b {
            other.clone_into(&mut joint.name);
        }
    }
    log
}

fn finding(log: &Recording, (a, b): (&str, &str), [before, after]: [f64; 2]) -> Finding {
    Finding {
        fault: Fault::Swapped,
        log: Some(log.name.clone()),
        others: 0,
        joint: Some(a.to_owned()),
        message: format!(
            "`{a}` and `{b}` have each other's names: with them exchanged the nominal robot is off by {after:.4} there instead of {before:.4} \
             (root mean squares)"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::hinge::chain;
    use super::*;
    use crate::recording::{JointRecord, Series};

    /// A log of `robot` in which joint `d` does what the simulation says of swings of its own.
    fn log(robot: &Robot) -> Recording {
        let time: Vec<f64> = (0..1600).map(|k| f64::from(k) * 5e-3).collect();
        let swing = |d: usize| Series {
            value: time.iter().map(|t| 0.4 * ((2.0 + 1.3 * d as f64) * t).sin()).collect(),
            time: time.clone(),
        };
        let joint = |d: usize| JointRecord {
            name: robot.dof(d).name.clone(),
            command: swing(d),
            position: swing(d),
            ..JointRecord::default()
        };
        let mut log = Recording {
            name: "log".into(),
            joints: (0..robot.dofs.len()).map(joint).collect(),
            ..Recording::default()
        };
        let lengths = Lengths {
            block: 1.0,
            piece: f64::INFINITY,
        };
        let trials = cut::cut(robot, &log, 0, (0.0, f64::INFINITY), lengths).expect("trials");
        let predictions = outcome::measured(robot, &Model::default(), &trials, 1)
            .expect("simulated")
            .predictions;
        for joint in &mut log.joints {
            joint.position = Series::default();
        }
        for (reading, position) in trials[0].readings.iter().zip(&predictions[0]) {
            let own = &mut log.joints[reading.dof].position;
            own.time.push(trials[0].time(reading));
            own.value.push(*position);
        }
        log
    }

    #[test]
    fn joints_with_each_others_names_are_told_and_others_are_not() {
        let robot = chain(
            &["hip", "knee", "ankle"],
            "kp = 2.0\nkd = 0.05\ntorque_limit = 20.0\nspeed_limit = 8.0\n",
        );
        let own = log(&robot);
        let told = |log: &Recording, robot: &Robot| {
            let logs = [log.clone()];
            exchanged(robot, &logs, &Check::new(&logs, robot)).expect("findings")
        };
        assert_eq!(told(&own, &robot), []);
        let other = with_exchanged(&own, "hip", "ankle");
        let [found] = &told(&other, &robot)[..] else {
            panic!("{:?}", told(&other, &robot))
        };
        assert!(
            found.message.starts_with("`hip` and `ankle` have each other's names")
                || found.message.starts_with("`ankle` and `hip`")
        );
        // Another robot is far off too, and not for that.
        let soft = chain(
            &["hip", "knee", "ankle"],
            "kp = 1.0\nkd = 0.05\ntorque_limit = 20.0\nspeed_limit = 8.0\n",
        );
        assert_eq!(told(&own, &soft), []);
    }
}
