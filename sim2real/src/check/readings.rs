//! Readings by themselves: channels that are stuck or saturate, outliers, rows without any, rates.

use omniwalk_env::robot::Joint;

use super::findings::{At, Findings};
use super::rules::{COMMANDED, LEAST_RANGE};
use super::{Fault, JointCheck, LogCheck};
use crate::recording::{CommandKind, JointRecord, Recording, Series};

/// Lowest rate of readings that shows what a servo does, Hz.
const LOW_RATE: f64 = 20.0;
/// Below this rate even a servo that responds at 3 Hz has fewer than four readings a period, Hz.
const LOWEST_RATE: f64 = 12.0;
/// Share of the readings at the largest or smallest from which on a joint is worth a look.
const AT_BOUND: f64 = 0.3;
/// A rest at a bound is at least so many readings and s long.
const REST: (usize, f64) = (10, 0.05);
/// Commands that differ by this share of their range are not the same.
const BEYOND: f64 = 0.03;
/// A command that goes on by this share of its range is far beyond a joint that does not; twice is no chance.
const FAR_BEYOND: f64 = 0.1;
const TWICE: usize = 2;
/// A joint stops dead whose way over the last readings is no less than this share of that over as many before, and so many steps of its
/// encoder or of noise.
const DEAD: f64 = 0.6;
const SHOWN: f64 = 3.0;
/// So many readings: at a few hundred Hz a slow joint goes by less than a step from one to the next.
const WAY: usize = 3;
/// So many readings of two joints are not the same by chance; a few of coarse encoders are.
const MANY: usize = 50;
/// Rows without a position up to this share are lost; above it, joints have rows of their own.
const LOST: f64 = 0.5;

impl Findings {
    /// What is wrong with the readings of a joint.
    pub(super) fn readings(&mut self, recording: &Recording, check: &JointCheck, joint: &Joint, at: At<'_>) {
        self.stuck(check, at);
        self.told_what_it_did(recording, check, at);
        self.saturated(recording, check, joint, at);
        if check.outliers > 0 {
            let message = format!(
                "readings of the position that are far off those before and after, and are left out: {}",
                check.outliers
            );
            self.remark(Fault::Outliers, at, message);
        }
        let rows = check.missing + check.position.samples + check.repeated + check.outliers;
        if check.missing > 0 && (check.missing as f64) < LOST * rows as f64 {
            let message = format!("{} of {rows} rows have no number as its position", check.missing);
            self.remark(Fault::Missing, at, message);
        }
        if check.position.rate < LOW_RATE && check.position.samples > 1 {
            let message = format!("readings come at less than {LOW_RATE} Hz: fast effects cannot be told apart");
            self.remark(Fault::LowRate, At { joint: None, ..at }, message);
        }
    }

    fn stuck(&mut self, check: &JointCheck, at: At<'_>) {
        let told =
            check.enabled > 0.0 && check.command.width() > COMMANDED.max(LEAST_RANGE * check.position.resolution);
        if told && check.position.width() == 0.0 {
            let message = format!(
                "the position reads {} throughout, while the joint is told to move: the reading is stuck",
                // A zero without a sign.
                check.position.range.map_or(0.0, |range| range[0]) + 0.0
            );
            self.refuse(Fault::Stuck, at, message);
        }
        if check.velocity.samples > 0 && check.velocity.width() == 0.0 && check.position.width() > COMMANDED {
            self.remark(
                Fault::Stuck,
                at,
                "the velocity never changes while the joint moves; it is not used",
            );
        }
    }

    fn saturated(&mut self, recording: &Recording, check: &JointCheck, joint: &Joint, at: At<'_>) {
        let stop = recording.joint(&check.name).and_then(|record| dead_stop(record, check));
        let (lower, upper) = joint.limits;
        let is_limit = |value: f64| {
            [lower, upper]
                .iter()
                .any(|limit| (limit - value).abs() < BEYOND * (upper - lower))
        };
        if let Some(value) = stop.filter(|value| !is_limit(*value)) {
            let message = format!(
                "the position stops dead at {value:.4} again and again, however far its command goes on: the sensor saturates, or there is an end stop that the robot's limits ({lower:.3} to {upper:.3}) do not have; leave such motions \
                 out, or correct the limits"
            );
            self.refuse(Fault::Saturated, at, message);
        } else if check.position.at_bounds > AT_BOUND && check.position.width() > 0.0 {
            // Joints that stick rest where they came to, and may do so at their farthest.
            let message = format!(
                "the position rests at its largest or smallest reading for {:.0} % of the samples: an end stop, a joint that \
                 sticks, or a sensor that saturates",
                100.0 * check.position.at_bounds
            );
            self.remark(Fault::Saturated, at, message);
        }
        for (what, channel) in [("velocity", &check.velocity), ("effort", &check.effort)] {
            if channel.at_bounds > 0.02 && channel.width() > 0.0 {
                let message = format!(
                    "the {what} rests at a bound for {:.0} % of the samples: the sensor saturates",
                    100.0 * channel.at_bounds
                );
                self.remark(Fault::Saturated, at, message);
            }
        }
    }

    /// Readings that are the commands to the last bit: one column for two.
    fn told_what_it_did(&mut self, recording: &Recording, check: &JointCheck, at: At<'_>) {
        let Some(record) = recording.joint(&check.name) else {
            return;
        };
        let own = record.position.time.iter().zip(&record.position.value);
        let same = own
            .clone()
            .all(|(time, value)| record.command.held_at(*time) == Some(value));
        if same && check.position.samples >= MANY && check.position.width() > 0.0 {
            let message = "its readings are its commands throughout: the map gives one column to both, or the robot was simulated without a motor";
            self.refuse(Fault::SameReadings, at, message);
        }
    }

    /// Logs that are copies of others: what they show would count twice, and be held out from itself.
    pub(super) fn copies(&mut self, recordings: &[Recording]) {
        let moves = |recording: &Recording| {
            let mut joints = recording.joints.iter().map(|joint| &joint.position.value);
            joints.any(|own| own.len() >= MANY && own.iter().any(|value| *value != own[0]))
        };
        for (i, one) in recordings.iter().enumerate().filter(|(_, one)| moves(one)) {
            if let Some(first) = recordings[..i].iter().find(|other| other.is_copy_of(one)) {
                let at = At {
                    log: Some(&one.name),
                    joint: None,
                };
                let message = format!("its readings are those of {}: give each log once", first.name);
                self.refuse(Fault::Copy, at, message);
            }
        }
    }

    /// Joints of a log whose readings are the same to the last bit: one column for two.
    pub(super) fn same_readings(&mut self, recording: &Recording, log: &LogCheck) {
        let tells = |one: &JointCheck| one.position.samples >= MANY && one.position.width() > 0.0;
        for (i, one) in log.joints.iter().enumerate().filter(|(_, one)| tells(one)) {
            let own = recording.joint(&one.name).map(|joint| &joint.position);
            let same = |other: &&JointCheck| recording.joint(&other.name).map(|joint| &joint.position) == own;
            for other in log.joints[i + 1..].iter().filter(same) {
                let at = At {
                    log: Some(&log.name),
                    joint: Some(&other.name),
                };
                let message = format!(
                    "its readings are those of `{}` throughout: the map gives one column to two joints",
                    one.name
                );
                self.refuse(Fault::SameReadings, at, message);
            }
        }
    }

    /// Rates over `checks`, those of one joint in all logs.
    pub(super) fn rate(&mut self, checks: &[&JointCheck], at: At<'_>) {
        let slow = |check: &&JointCheck| check.position.rate < LOWEST_RATE;
        let moving = checks.iter().filter(|check| check.position.samples > 1);
        if moving.clone().next().is_some() && moving.clone().all(slow) {
            let rate = moving.map(|check| check.position.rate).fold(0.0, f64::max);
            let message = format!(
                "readings come at {rate:.1} Hz at most: at least {LOWEST_RATE} Hz are needed, and 100 Hz are good (if they came faster, the \
                 time's unit is another)"
            );
            self.refuse(Fault::LowRate, at, message);
        }
    }
}

/// The largest or smallest reading, where the joint stops dead at it again and again, while its command goes on far or to different
/// places: a joint that sticks stops where its command turned, and one that its load holds up slows down before.
fn dead_stop(record: &JointRecord, check: &JointCheck) -> Option<f64> {
    if record.command_kind != CommandKind::Position {
        return None;
    }
    let [smallest, largest] = check.position.range?;
    let [least, far] = [BEYOND, FAR_BEYOND].map(|share| share * check.command.width());
    let step = SHOWN * check.position.resolution.max(check.position.noise);
    // How far out the command is when each rest at a bound begins, and the farthest that it goes meanwhile.
    let told = |bound: f64, outward: f64| -> Vec<(f64, f64)> {
        let rests = rests(&record.position, bound, step);
        let farthest = |rest: Rest| farthest(&record.command, rest, outward);
        rests.into_iter().filter_map(farthest).collect()
    };
    let sides = [(largest, told(largest, 1.0)), (smallest, told(smallest, -1.0))];
    let goes_on = |(first, farthest): &&(f64, f64)| farthest - first > far;
    let far_beyond = sides.iter().flat_map(|(_, told)| told).filter(goes_on).count();
    let differ = |told: &[(f64, f64)]| {
        let [low, high] = [f64::min, f64::max].map(|pick| told.iter().map(|told| told.1).reduce(pick));
        low.zip(high).is_some_and(|(low, high)| high - low > least)
    };
    let stops = |told: &[(f64, f64)]| differ(told) || (far_beyond >= TWICE && told.iter().any(|told| goes_on(&told)));
    sides.iter().find(|(_, told)| stops(told)).map(|(bound, _)| *bound)
}

/// From when to when a joint rests, s.
type Rest = (f64, f64);

/// When `series` rests at `bound`, having come there without slowing down, by more than `step` in [`WAY`] readings.
fn rests(series: &Series, bound: f64, step: f64) -> Vec<Rest> {
    let mut start = 0;
    let mut rests = Vec::new();
    for run in series.value.chunk_by(|a, b| a == b) {
        let (from, to) = (series.time[start], series.time[start + run.len() - 1]);
        let is_rest = run[0] == bound && run.len() >= REST.0 && to - from >= REST.1;
        let before = &series.value[start.saturating_sub(2 * WAY + 1)..start];
        if let (true, [a, _, _, b, _, _, c]) = (is_rest, before) {
            let (last, earlier) = ((c - b).abs(), (b - a).abs());
            if last > step && last > DEAD * earlier {
                rests.push((from, to));
            }
        }
        start += run.len();
    }
    rests
}

/// How far `outward` `command` is when a rest begins, and the farthest that it goes meanwhile.
fn farthest(command: &Series, (from, to): Rest, outward: f64) -> Option<(f64, f64)> {
    let during = command.time.iter().zip(&command.value);
    let during = during.filter(|(time, _)| (from..=to).contains(*time));
    let mut during = during.map(|(_, value)| outward * value);
    let first = during.next()?;
    Some((first, during.fold(first, f64::max)))
}
