//! Cuts a log into the pieces that are followed.

use std::sync::Arc;

use omniwalk_env::robot::{Base, Robot};

use super::base::MeasuredBase;
use super::landings::landings;
use super::motion::Motion;
use super::state::{Near, state};
use super::trial::{Commands, DT, LEAD, Reading, Told, Trial, TrialError, steps};
use crate::recording::{CommandKind, JointRecord, Recording, Series};

/// How long a log is followed at a stretch, s: longer ones are cut, and every piece starts from the measured state.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    /// Longest piece that is compared.
    longest: f64,
    /// A rollout runs this long before it is compared: what its start did not know has died away.
    warm_up: f64,
}

/// Of rigs, arms and robots on a stand, where nothing shorter is asked for.
const HELD: Stretch = Stretch {
    longest: 60.0,
    warm_up: 0.5,
};
/// Of a shorter log, s, half a second would be too much to lose: what its start did not know stays in it.
const SHORT: f64 = 2.0;
/// Of what walks freely: it diverges with the time in which it would fall, sqrt(height / g), and is started anew before that
/// (multiple shooting), and after every landing. Contacts have formed and servos have answered after the warm-up.
const FREE: Stretch = Stretch {
    longest: 0.3,
    warm_up: 0.06,
};

/// Rollouts begin so long after a foot was about to land, s.
const LANDED: f64 = 0.06;
/// Pieces between landings, or commands that are missing, that are shorter are not compared, s.
const SHORTEST: f64 = 0.05;

/// What a log is cut into.
#[derive(Clone, Copy, Debug)]
pub struct Lengths {
    /// Of a block of time, s.
    pub block: f64,
    /// Longest piece where the base is held, s.
    pub piece: f64,
}

/// From when to when every joint of `robot` was read, and its base is known, s.
fn span(robot: &Robot, recording: &Recording, joints: &[&JointRecord]) -> Result<(f64, f64), TrialError> {
    let known = match robot.base {
        Base::Floating => base_known(robot, recording)?,
        Base::Fixed => (f64::NEG_INFINITY, f64::INFINITY),
    };
    let first = joints.iter().map(|j| j.position.time[0]).fold(known.0, f64::max);
    let last = joints.iter().map(|j| end(&j.position)).fold(known.1, f64::min);
    Ok((first, last))
}

/// How long that is, s.
///
/// # Errors
/// [`TrialError`] when the log is not one of this robot.
pub fn seconds(robot: &Robot, recording: &Recording) -> Result<f64, TrialError> {
    let (first, last) = span(robot, recording, &joints(robot, recording)?)?;
    Ok((last - first).max(0.0))
}

/// The part of `recording` (log number `log`) from `from` to `to` s after its first reading, in pieces.
///
/// # Errors
/// [`TrialError`] when the log is not one of this robot.
pub fn cut(
    robot: &Robot,
    recording: &Recording,
    log: usize,
    (from, to): (f64, f64),
    lengths: Lengths,
) -> Result<Vec<Trial>, TrialError> {
    let joints = joints(robot, recording)?;
    let free = robot.base == Base::Floating;
    let (first, last) = span(robot, recording, &joints)?;
    let stretch = if free { FREE } else { stand(last - first, lengths) };
    let earliest = first + LEAD + stretch.warm_up;
    let (from, to) = ((first + from).max(earliest), (first + to).min(last));
    let source = Source {
        recording,
        joints: &joints,
        log,
        from,
        block: lengths.block,
    };
    let piece = |&(begin, end): &(f64, f64)| {
        let start = begin - stretch.warm_up;
        let base = free.then(|| MeasuredBase::at(recording, start)).flatten();
        // Where the base is not known for a while, nothing is compared.
        (base.is_some() == free).then(|| source.piece(start, (begin, end), base))
    };
    let mut disturbed = unheard(&joints);
    if free {
        let landings = landings(robot, recording, &joints, (from, to));
        disturbed.extend(landings.iter().map(|landing| (*landing, landing + LANDED)));
        disturbed.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let undisturbed = match disturbed.as_slice() {
        [] if !free => vec![(from, to)],
        disturbed => between((from, to), disturbed, stretch.warm_up),
    };
    let pieces = undisturbed.iter().flat_map(|&span| equal(span, stretch.longest));
    Ok(pieces.filter_map(|span| piece(&span)).collect())
}

/// How a robot is followed whose base is held, in a log of so many `seconds`.
fn stand(seconds: f64, lengths: Lengths) -> Stretch {
    let warm_up = if seconds < SHORT { FREE.warm_up } else { HELD.warm_up };
    Stretch {
        longest: HELD.longest.min(lengths.piece),
        warm_up,
    }
}

/// When any joint was told what is not in the log: rollouts begin where what it is told is known for [`LEAD`].
fn unheard(joints: &[&JointRecord]) -> Vec<(f64, f64)> {
    let lost = joints.iter().flat_map(|joint| joint.lost_commands());
    let mut lost: Vec<(f64, f64)> = lost.map(|(from, to)| (from, to + LEAD)).collect();
    lost.sort_by(|a, b| a.0.total_cmp(&b.0));
    lost
}

/// The times between what is `disturbed`, from when to when in order of their beginning, in which something is compared after a warm-up.
fn between((from, to): (f64, f64), disturbed: &[(f64, f64)], warm_up: f64) -> Vec<(f64, f64)> {
    let mut begin = from;
    let mut spans = Vec::with_capacity(disturbed.len() + 1);
    for &(start, end) in disturbed {
        spans.push((begin, start.min(to)));
        begin = begin.max(end + warm_up);
    }
    spans.push((begin, to));
    spans.retain(|(begin, end)| end - begin >= SHORTEST);
    spans
}

/// The span from `from` to `to` in pieces of equal length, `longest` at most.
fn equal((from, to): (f64, f64), longest: f64) -> impl Iterator<Item = (f64, f64)> {
    let pieces = ((to - from) / longest).ceil().max(1.0) as usize;
    let length = (to - from) / pieces as f64;
    (0..pieces).map(move |i| {
        let begin = from + i as f64 * length;
        (begin, begin + length)
    })
}

/// What pieces are cut from.
struct Source<'a> {
    recording: &'a Recording,
    joints: &'a [&'a JointRecord],
    log: usize,
    /// Where what is used of the log begins, s.
    from: f64,
    /// Length of a block, s.
    block: f64,
}

impl Source<'_> {
    /// A rollout from `start` that is compared `from` and `to` s.
    fn piece(&self, start: f64, (from, to): (f64, f64), base: Option<MeasuredBase>) -> Trial {
        let Self { recording, joints, .. } = *self;
        let steps = (((to - start) / DT).floor().max(0.0)) as usize;
        let times: Vec<f64> = (0..=steps).map(|k| start + k as f64 * DT).collect();
        let mut readings = Vec::new();
        for (dof, joint) in joints.iter().enumerate() {
            let series = &joint.position;
            for (&time, &position) in series.time.iter().zip(&series.value) {
                let at = (time - start) / DT;
                if time >= from && at <= steps as f64 {
                    let block = ((time - self.from) / self.block) as usize;
                    readings.push(Reading {
                        at,
                        dof,
                        position,
                        block,
                    });
                }
            }
        }
        readings.sort_by(|a, b| a.at.total_cmp(&b.at).then(a.dof.cmp(&b.dof)));
        let own = joints.iter().enumerate().flat_map(|(d, joint)| {
            joint
                .extra
                .iter()
                .map(move |(name, series)| (Some(d), name.clone(), series))
        });
        // A joint that measures its own says more.
        let measured = joints.iter().any(|joint| joint.extra.contains_key("voltage"));
        let supply =
            (!recording.voltage.is_empty() && !measured).then(|| (None, "voltage".to_owned(), &recording.voltage));
        let conditions = own.chain(supply).filter(|(_, _, series)| !series.is_empty());
        Trial {
            name: recording.name.clone(),
            log: self.log,
            overrides: recording.overrides.clone(),
            start,
            steps,
            told: joints.iter().map(|joint| told(joint, start, &times)).collect(),
            readings,
            initial: joints.iter().map(|joint| states(&joint.position, start)).collect(),
            spread: joints
                .iter()
                .map(|joint| Near::new(&joint.position, start).spread())
                .collect(),
            shift: vec![0.0; base.map_or(0, |_| super::starts::size(joints.len()))],
            starts: None,
            motion: Arc::new(Motion::new(recording, joints, start, (from, to), base.is_some())),
            base,
            measured: joints.iter().map(|j| linear(&j.position, &times)).collect(),
            conditions: conditions
                .map(|(joint, name, series)| (joint, name, linear(series, &times)))
                .collect(),
        }
    }
}

/// From when to when `recording` says how the base is, s.
fn base_known(robot: &Robot, recording: &Recording) -> Result<(f64, f64), TrialError> {
    if robot.feet.is_empty() {
        return Err(TrialError::NoFeet {
            robot: robot.name.clone(),
        });
    }
    MeasuredBase::known(recording).ok_or_else(|| TrialError::NoBase {
        log: recording.name.clone(),
        robot: robot.name.clone(),
    })
}

fn end(series: &Series) -> f64 {
    series.time.last().copied().unwrap_or(f64::NEG_INFINITY)
}

/// The record of every degree of freedom. Pieces take memory by the time that they span, which readings without a jump bound.
fn joints<'a>(robot: &Robot, recording: &'a Recording) -> Result<Vec<&'a JointRecord>, TrialError> {
    let names: Vec<&str> = (0..robot.dofs.len()).map(|d| robot.dof(d).name.as_str()).collect();
    if !recording
        .joints
        .iter()
        .any(|joint| names.contains(&joint.name.as_str()))
    {
        let list = |names: &mut dyn Iterator<Item = &str>| names.take(30).collect::<Vec<_>>().join(", ");
        return Err(TrialError::OtherRobot {
            log: recording.name.clone(),
            found: list(&mut recording.joints.iter().map(|joint| joint.name.as_str())),
            robot: robot.name.clone(),
            wanted: list(&mut names.iter().copied()),
        });
    }
    let find = |(d, name): (usize, &&str)| {
        let missing = |what| TrialError::Missing {
            log: recording.name.clone(),
            joint: (*name).to_owned(),
            what,
        };
        let joint = recording.joint(name).ok_or_else(|| missing("record"))?;
        if joint.position.len() < 2 {
            return Err(missing("measured positions"));
        }
        if let Some(jump) = joint.position.jump() {
            return Err(TrialError::Jump {
                log: recording.name.clone(),
                joint: (*name).to_owned(),
                jump,
            });
        }
        if joint.command.is_empty() && robot.dof(d).actuator.is_some() {
            return Err(missing("commands"));
        }
        Ok(joint)
    };
    names.iter().enumerate().map(find).collect()
}

fn told(joint: &JointRecord, start: f64, times: &[f64]) -> Told {
    let effort = joint.command_kind == CommandKind::Effort;
    let before = if effort { 0.0 } else { joint.position.value[0] };
    // Before the log's first command its first command is taken to have held.
    let before = joint.command.value.first().copied().unwrap_or(before);
    let lead: Vec<f64> = (0..steps(LEAD)).map(|k| start - LEAD + k as f64 * DT).collect();
    let mut past = held(&joint.command, before, &lead);
    past.reverse();
    Told {
        command: commands(&joint.command, before, start, times),
        otherwise: (!joint.otherwise.is_empty()).then(|| commands(&joint.otherwise, before, start, times)),
        effort,
        enabled: held(&joint.enabled, 1.0, times).iter().map(|&on| on > 0.5).collect(),
        past,
    }
}

/// Those of `series` from `start` on, at the steps that begin at `times`; `before` holds before the first.
fn commands(series: &Series, before: f64, start: f64, times: &[f64]) -> Commands {
    let end = times.last().map_or(start, |last| last + DT);
    let own = series.time.iter().zip(&series.value);
    let given = own.map(|(time, value)| ((time - start) / DT, *value));
    // What held before the trial begins is the last that was given.
    let first = series.time.partition_point(|time| *time <= start);
    let value = first.checked_sub(1).map_or(before, |last| series.value[last]);
    let during = given
        .skip(first)
        .take(series.time.partition_point(|time| *time < end).saturating_sub(first));
    Commands {
        mean: held(series, before, times),
        given: std::iter::once((0.0, value)).chain(during).collect(),
    }
}

/// Means of `series`, whose values hold until the next, over the step that begins at each of `times`: what switches within
/// a step acts in proportion. `before` holds before the first.
fn held(series: &Series, before: f64, times: &[f64]) -> Vec<f64> {
    let mut next = 0;
    let mut value = before;
    let mut mean = |&time: &f64| {
        let (mut from, end) = (time, time + DT);
        let mut sum = 0.0;
        while let Some(&change) = series.time.get(next).filter(|&&change| change < end) {
            sum += value * (change - from).max(0.0);
            from = from.max(change);
            value = series.value[next];
            next += 1;
        }
        (sum + value * (end - from)) / DT
    };
    times.iter().map(&mut mean).collect()
}

/// Positions and velocities at every step from [`LEAD`] before `start` until [`LEAD`] after it.
fn states(series: &Series, start: f64) -> Vec<(f64, f64)> {
    (0..=2 * steps(LEAD))
        .map(|k| state(series, start - LEAD + k as f64 * DT))
        .collect()
}

/// Values of `series` at `times`, linear between its own and constant beyond.
pub fn linear(series: &Series, times: &[f64]) -> Vec<f64> {
    let (t, v) = (&series.time, &series.value);
    let mut next = 0;
    let at = |&time: &f64| {
        while next < t.len() && t[next] <= time {
            next += 1;
        }
        match next {
            0 => v[0],
            n if n == t.len() => v[n - 1],
            n => v[n - 1] + (time - t[n - 1]) / (t[n] - t[n - 1]) * (v[n] - v[n - 1]),
        }
    };
    times.iter().map(at).collect()
}
