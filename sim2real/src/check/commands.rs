//! Commands and readings: whether they are of one time, and of one joint.

use omniwalk_env::robot::Joint;

use super::findings::{At, Findings};
use super::relation::against_command;
use super::rules::{COMMANDED, LEAST_RANGE};
use super::text::fixed;
use super::{Fault, JointCheck, LogCheck};
use crate::recording::{CommandKind, LONGEST_PAUSE, Recording, Series};

impl Findings {
    /// Commands and readings have to be of the same time.
    pub(super) fn clocks(&mut self, recording: &Recording, check: &JointCheck, at: At<'_>) {
        let Some(record) = recording.joint(&check.name) else {
            return;
        };
        let ends = |series: &Series| Some((*series.time.first()?, *series.time.last()?));
        let (Some(command), Some(position)) = (ends(&record.command), ends(&record.position)) else {
            return;
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
        if let Some(relation) = check
            .following
            .filter(|relation| relation.best_correlation > 0.9 && relation.lag < -0.015 && relation.lag_matters())
        {
            let message = format!(
                "the position moves {:.0} ms before its command: the clocks of the two are apart",
                -1000.0 * relation.lag
            );
            self.remark(Fault::ClockOffset, at, message);
        }
    }

    pub(super) fn signs(&mut self, recording: &Recording, check: &JointCheck, joint: &Joint, at: At<'_>) {
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
        if relation.correlation < -0.6 && relation.best_correlation < 0.3 {
            let message = format!(
                "the position goes against the commands (correlation {}): the sign of one of them is flipped",
                fixed(relation.correlation, 2)
            );
            self.refuse(Fault::SignFlipped, at, message);
        } else if relation.best_correlation < 0.2 && !follows_another(recording, check) {
            let message = format!(
                "the joint does not follow its commands (correlation {}): log and commands do not belong together",
                fixed(relation.best_correlation, 2)
            );
            self.refuse(Fault::Unrelated, at, message);
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
