//! Commands and readings: whether they are of one time, and of one joint.

use std::ops::Range;

use omniwalk_env::robot::{Base, Joint, Robot};

use super::findings::{At, Findings};
use super::relation::{Relation, against_command, followed_far, following_while_off};
use super::rules::{COMMANDED, LEAST_RANGE};
use super::text::fixed;
use super::{Fault, JointCheck, LogCheck, robot_joint};
use crate::recording::{CommandKind, JointRecord, LONGEST_PAUSE, Recording, Series};

/// What a lag leaves of what does not follow without it, from which on it is worth a remark, and from which on it is no chance.
const REMARKED: f64 = 0.5;
const REFUSED: f64 = 0.1;
/// A position this long before its command is worth a remark, s: more than the step between lags.
const REMARKED_LEAD: f64 = 0.015;
/// And this long before it, it can be no answer to it, s: stamps are off by more than jitter.
const LONGEST_LEAD: f64 = 0.045;
/// A servo that does just what it is told does so within this time, s.
const LONGEST_LAG: f64 = 0.305;
/// What correlates better with its commands, and is as wide within these bounds, follows them.
const FOLLOWED: f64 = 0.95;
const FOLLOWS: Range<f64> = 0.8..1.25;
/// A log of which more, as a share, is without commands is none of what a joint was told.
const MOST_LOST: f64 = 0.5;

impl Findings {
    /// Commands and readings have to be of the same time. Whether they are of times so far apart that nothing else is to be said of them.
    pub(super) fn clocks(&mut self, recording: &Recording, check: &JointCheck, at: At<'_>) -> bool {
        let Some(record) = recording.joint(&check.name) else {
            return false;
        };
        let ends = |series: &Series| Some((*series.time.first()?, *series.time.last()?));
        let (Some(command), Some(position)) = (ends(&record.command), ends(&record.position)) else {
            return false;
        };
        let measured_after = position.1 - command.0;
        let apart = command.0 > position.1 || command.1 - position.1 > LONGEST_PAUSE;
        if apart || (position.0 - command.1 > 1.0 && check.enabled > 0.0) {
            let [a, b, c, d] = [command.0, command.1, position.0, position.1].map(|time| fixed(time, 3));
            let message = format!(
                "commands are from {a} s to {b} s, readings from {c} s to {d} s: their clocks differ, or they are of different logs"
            );
            self.refuse(Fault::ClockOffset, at, message);
        } else if measured_after < 0.5 * record.position.span() && check.enabled > 0.5 {
            self.refuse(
                Fault::ClockOffset,
                at,
                "most readings are from before the first command",
            );
        }
        // Half a period of an oscillation is a wrong sign.
        let followed = check.following.filter(|relation| !is_flipped(relation));
        if let Some(near) = followed {
            let relation = followed_far(record, near);
            // A servo that gives way answers in a shape of its own, which goes best with another time.
            let stiff = FOLLOWS.contains(&near.ratio);
            let late = (stiff && near.lag_leaves() < REMARKED) || relation.lag_leaves() < REFUSED;
            if late && relation.best_correlation > 0.9 {
                self.lag(&relation, at);
            }
        }
        apart
    }

    /// Stretches without commands are not compared.
    pub(super) fn lost_commands(&mut self, recording: &Recording, at: At<'_>) {
        let record = at.joint.and_then(|joint| recording.joint(joint));
        let lost = record.map(JointRecord::lost_commands).unwrap_or_default();
        let longest = lost
            .iter()
            .copied()
            .reduce(|a, b| if b.1 - b.0 > a.1 - a.0 { b } else { a });
        let Some((from, to)) = longest else {
            return;
        };
        let seconds: f64 = lost.iter().map(|(from, to)| to - from).sum();
        if seconds > MOST_LOST * recording.duration() {
            let share = fixed(100.0 * seconds / recording.duration(), 0);
            let message = format!(
                "no commands for {share} % of the time, while the motor is on and the joint is not seen to rest: what it was told is not known"
            );
            return self.refuse(Fault::NoCommand, at, message);
        }
        let message = format!(
            "commands are missing, for {} s at most, from {} s on, while the joint is not seen to rest: that time, with what follows in \
             the next half second or so, is left out",
            fixed(to - from, 2),
            fixed(from, 2)
        );
        self.remark(Fault::Gaps, at, message);
    }

    /// A position that goes best with its command at another time than a servo's.
    fn lag(&mut self, relation: &Relation, at: At<'_>) {
        let least = if relation.is_longest() { "at least " } else { "" };
        let ms = 1000.0 * relation.lag.abs();
        let surely = relation.lag_leaves() < REFUSED;
        if relation.lag < -REMARKED_LEAD {
            let message = format!(
                "the position moves {least}{ms:.0} ms before its command: the clocks of the two are apart, or commands and positions \
                 are mixed up"
            );
            if surely && relation.lag < -LONGEST_LEAD {
                self.refuse(Fault::ClockOffset, at, message);
            } else {
                self.remark(Fault::ClockOffset, at, message);
            }
        } else if surely && relation.lag > LONGEST_LAG {
            let message = format!(
                "the position moves {least}{ms:.0} ms after its command, and else as told: no servo is so late, the clocks of the two are apart"
            );
            self.refuse(Fault::ClockOffset, at, message);
        }
    }

    pub(super) fn signs(&mut self, check: &JointCheck, joint: &Joint, at: At<'_>) {
        if let Some(relation) = check.velocity_to_slope.filter(|relation| relation.correlation < -0.5) {
            let message = format!(
                "the velocity goes against the slope of the position (correlation {}): its sign is flipped",
                fixed(relation.correlation, 2)
            );
            self.refuse(Fault::SignFlipped, at, message);
        }
        let Some(relation) = check.following.filter(|_| told(check) && joint.actuator.is_some()) else {
            return;
        };
        if is_flipped(&relation) {
            let message = format!(
                "the position goes against the commands (correlation {}): the sign of one of them is flipped",
                fixed(relation.correlation, 2)
            );
            self.refuse(Fault::SignFlipped, at, message);
        }
    }

    /// Joints that follow no commands. On the ground, one whose commands are late or limited is moved by what it stands on: where the others of
    /// a robot that walks follow theirs, log and commands do belong together.
    pub(super) fn unrelated(&mut self, recording: &Recording, log: &LogCheck, robot: &Robot) {
        let driven =
            |check: &&JointCheck| robot_joint(robot, &check.name).is_some_and(|joint| joint.actuator.is_some());
        let told = log.joints.iter().filter(driven).filter(|check| told(check));
        let related: Vec<(&JointCheck, Relation)> = told.filter_map(|check| Some((check, check.following?))).collect();
        let follow = related.iter().filter(|(_, own)| own.best_correlation > 0.5).count();
        let walks = robot.base == Base::Floating && 2 * follow > related.len();
        let lost = |(check, own): &&(&JointCheck, Relation)| {
            own.best_correlation < 0.2 && !is_flipped(own) && !follows_another(recording, check)
        };
        for (check, relation) in related.iter().filter(lost) {
            let at = At {
                log: Some(&log.name),
                joint: Some(&check.name),
            };
            let correlation = fixed(relation.best_correlation, 2);
            let message = format!("the joint does not follow its commands (correlation {correlation})");
            if walks {
                self.remark(Fault::Unrelated, at, format!("{message}, as others do"));
            } else {
                let message = format!("{message}: log and commands do not belong together");
                self.refuse(Fault::Unrelated, at, message);
            }
        }
    }

    /// A motor that is off follows nothing.
    pub(super) fn switch(&mut self, recording: &Recording, check: &JointCheck, at: At<'_>) {
        let relation = recording.joint(&check.name).and_then(following_while_off);
        let follows = relation.filter(|own| own.best_correlation > FOLLOWED && FOLLOWS.contains(&own.ratio));
        if let Some(relation) = follows.filter(|_| check.command.width() > COMMANDED) {
            let message = format!(
                "the joint follows its commands while its motor is said to be off (correlation {}): `enabled` is inverted, or another joint's",
                fixed(relation.best_correlation, 2)
            );
            self.refuse(Fault::Switch, at, message);
        }
    }

    /// Joints that follow each other's commands and not their own.
    pub(super) fn swaps(&mut self, recording: &Recording, log: &LogCheck) {
        let lost: Vec<&JointCheck> = log
            .joints
            .iter()
            .filter(|check| told(check) && check.following.is_some_and(|relation| relation.best_correlation < 0.5))
            .collect();
        for (i, one) in lost.iter().enumerate() {
            for other in &lost[i + 1..] {
                if follows(recording, &one.name, &other.name) && follows(recording, &other.name, &one.name) {
                    let at = At {
                        log: Some(&log.name),
                        joint: Some(&one.name),
                    };
                    let message = format!(
                        "`{}` and `{}` follow each other's commands: they are swapped",
                        one.name, other.name
                    );
                    self.refuse(Fault::Swapped, at, message);
                }
            }
        }
    }
}

/// Whether a position goes against its commands at any lag of a servo.
fn is_flipped(relation: &Relation) -> bool {
    relation.correlation < -0.6 && relation.best_correlation < 0.3
}

/// Whether the motor was told to move the joint by more than its reading resolves.
fn told(check: &JointCheck) -> bool {
    let width = check.command.range.map_or(0.0, |range| range[1] - range[0]);
    check.enabled > 0.2 && width > COMMANDED.max(LEAST_RANGE * check.position.resolution)
}

fn follows(recording: &Recording, joint: &str, commanded: &str) -> bool {
    let (Some(joint), Some(other)) = (recording.joint(joint), recording.joint(commanded)) else {
        return false;
    };
    let position = other.command_kind == CommandKind::Position;
    position && against_command(joint, &other.command).is_some_and(|relation| relation.best_correlation > 0.8)
}

fn follows_another(recording: &Recording, check: &JointCheck) -> bool {
    let others = recording.joints.iter().filter(|joint| joint.name != check.name);
    others
        .into_iter()
        .any(|other| follows(recording, &check.name, &other.name))
}
