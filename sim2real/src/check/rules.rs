//! From figures to refusals and remarks.

use omniwalk_env::robot::{Joint, JointKind, Robot};

use super::channel::Channel;
use super::relation::against_command;
use super::{Fault, Finding, JointCheck, LogCheck, robot_joint};
use crate::recording::{CommandKind, Recording};

/// Least range of motion, in units of noise or resolution, that is motion and not noise (six sigma each way).
pub(super) const LEAST_RANGE: f64 = 12.0;
/// Commanded range that should show in the position, rad or m, if it is also well above the resolution.
const COMMANDED: f64 = 0.02;
/// Lowest rate of readings that shows what a servo does, Hz.
const LOW_RATE: f64 = 20.0;
/// Positions may lie beyond the limits by this share of the range: stops give, zeros are off.
const BEYOND_LIMITS: f64 = 0.25;
/// Degrees per radian, millimetres per metre.
const FACTORS: [(JointKind, f64, &str); 2] = [
    (
        JointKind::Revolute,
        180.0 / std::f64::consts::PI,
        "degrees, not radians",
    ),
    (JointKind::Prismatic, 1000.0, "millimetres, not metres"),
];
/// A ratio within this factor of one of those above is one of units.
const NEAR: f64 = 2.0;

/// What was found.
#[derive(Default)]
pub(super) struct Findings {
    pub refusals: Vec<Finding>,
    pub remarks: Vec<Finding>,
}

/// Where a finding is.
#[derive(Clone, Copy, Default)]
pub(super) struct At<'a> {
    pub log: Option<&'a str>,
    pub joint: Option<&'a str>,
}

impl Findings {
    pub fn new(recordings: &[Recording], logs: &[LogCheck], robot: &Robot) -> Self {
        let mut found = Self::default();
        if recordings.iter().all(|recording| recording.joints.is_empty()) {
            found.refuse(
                Fault::Empty,
                At::default(),
                "there are no joints in the logs: give logs with measured joint positions and commands",
            );
            return found;
        }
        for (recording, log) in recordings.iter().zip(logs) {
            found.names(recording, log, robot);
            for note in &recording.notes {
                found.remark(
                    Fault::Note,
                    At {
                        log: Some(&log.name),
                        joint: None,
                    },
                    note.as_str(),
                );
            }
            for check in &log.joints {
                if let Some(joint) = robot_joint(robot, &check.name) {
                    found.joint(recording, check, joint);
                }
            }
            found.swaps(recording, log);
        }
        found.amounts(logs, robot);
        found
    }

    pub(super) fn refuse(&mut self, fault: Fault, at: At<'_>, message: impl Into<String>) {
        self.refusals.push(finding(fault, at, message.into()));
    }

    /// What is said of several logs in the same words is said once, of no log by name.
    pub(super) fn remark(&mut self, fault: Fault, at: At<'_>, message: impl Into<String>) {
        let new = finding(fault, at, message.into());
        let same = |old: &&mut Finding| (old.fault, &old.joint, &old.message) == (new.fault, &new.joint, &new.message);
        match self.remarks.iter_mut().find(same) {
            Some(old) if old.log == new.log => {}
            Some(old) => old.log = None,
            None => self.remarks.push(new),
        }
    }

    /// Whether the log is of this robot, and has all its joints.
    fn names(&mut self, recording: &Recording, log: &LogCheck, robot: &Robot) {
        let at = At {
            log: Some(&log.name),
            joint: None,
        };
        let in_log = || {
            recording
                .joints
                .iter()
                .map(|joint| joint.name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        };
        if log.joints.is_empty() {
            let of_robot: Vec<&str> = (0..robot.dofs.len()).map(|d| robot.dof(d).name.as_str()).collect();
            let message = format!(
                "none of its joints ({}) is one of robot `{}` ({}): another robot's log, or other names in the map",
                in_log(),
                robot.name,
                of_robot.join(", "),
            );
            return self.refuse(Fault::WrongRobot, at, message);
        }
        for d in 0..robot.dofs.len() {
            let name = robot.dof(d).name.as_str();
            if recording.joint(name).is_some() {
                continue;
            }
            let at = At {
                joint: Some(name),
                ..at
            };
            if robot.policy.contains(&d) {
                let message = format!(
                    "the robot's joint `{name}` is not in the log, which has {}: log it, or lock it in the robot's TOML",
                    in_log()
                );
                self.refuse(Fault::MissingJoint, at, message);
            } else {
                self.remark(
                    Fault::MissingJoint,
                    at,
                    "not in the log; taken to stay at its nominal position",
                );
            }
        }
        for joint in recording
            .joints
            .iter()
            .filter(|joint| robot_joint(robot, &joint.name).is_none())
        {
            let at = At {
                joint: Some(&joint.name),
                ..at
            };
            self.remark(
                Fault::UnknownJoint,
                at,
                "in the log, but not a moving joint of the robot; ignored",
            );
        }
    }

    fn joint(&mut self, recording: &Recording, check: &JointCheck, joint: &Joint) {
        let at = At {
            log: Some(&recording.name),
            joint: Some(&check.name),
        };
        if check.position.samples == 0 {
            let what = if check.command.samples > 0 {
                "commands, but no measured positions"
            } else {
                "no measured positions"
            };
            return self.refuse(
                Fault::NoMeasurement,
                at,
                format!("there are {what}: what the joint did cannot be known"),
            );
        }
        if check.command.samples == 0 && joint.actuator.is_some() && check.enabled > 0.0 {
            self.refuse(
                Fault::NoCommand,
                at,
                "the motor is on, but there are no commands: log them, or say with `enabled` when it is off",
            );
        }
        self.clocks(recording, check, at);
        self.stuck(check, at);
        self.units(check, joint, at);
        self.signs(recording, check, joint, at);
        if check.position.in_gaps > 0.5 {
            let message = format!(
                "{:.0} % of the time has no readings; the longest gap is {:.2} s",
                100.0 * check.position.in_gaps,
                check.position.longest_gap
            );
            self.refuse(Fault::Gaps, at, message);
        } else if check.position.in_gaps > 0.0 {
            let message = format!(
                "gaps in the readings, the longest of {:.2} s",
                check.position.longest_gap
            );
            self.remark(Fault::Gaps, at, message);
        }
        if check.position.rate < LOW_RATE && check.position.samples > 1 {
            let message = format!("readings come at less than {LOW_RATE} Hz: fast effects cannot be told apart");
            self.remark(Fault::LowRate, At { joint: None, ..at }, message);
        }
    }

    /// Commands and readings have to be of the same time.
    fn clocks(&mut self, recording: &Recording, check: &JointCheck, at: At<'_>) {
        let Some(record) = recording.joint(&check.name) else {
            return;
        };
        let ends = |series: &crate::recording::Series| Some((*series.time.first()?, *series.time.last()?));
        let (Some(command), Some(position)) = (ends(&record.command), ends(&record.position)) else {
            return;
        };
        let measured_after = position.1 - command.0;
        if command.0 > position.1 || (position.0 - command.1 > 1.0 && check.enabled > 0.0) {
            let message = format!(
                "commands are from {:.3} s to {:.3} s, readings from {:.3} s to {:.3} s: their clocks differ, or they are of different logs",
                command.0, command.1, position.0, position.1,
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

    fn stuck(&mut self, check: &JointCheck, at: At<'_>) {
        let width = |channel: &Channel| channel.range.map_or(0.0, |range| range[1] - range[0]);
        let told =
            check.enabled > 0.0 && width(&check.command) > COMMANDED.max(LEAST_RANGE * check.position.resolution);
        if told && width(&check.position) == 0.0 {
            let message = format!(
                "the position reads {} throughout, while the joint is told to move: the reading is stuck",
                check.position.range.map_or(0.0, |range| range[0])
            );
            self.refuse(Fault::Stuck, at, message);
        }
        if check.velocity.samples > 0 && width(&check.velocity) == 0.0 && width(&check.position) > COMMANDED {
            self.remark(
                Fault::Stuck,
                at,
                "the velocity never changes while the joint moves; it is not used",
            );
        }
        // Joints that stick rest where they came to, and may do so at their farthest.
        if check.position.at_bounds > 0.3 && width(&check.position) > 0.0 {
            let message = format!(
                "the position rests at its largest or smallest reading for {:.0} % of the samples: an end stop, a joint that \
                 sticks, or a sensor that saturates",
                100.0 * check.position.at_bounds
            );
            self.remark(Fault::Saturated, at, message);
        }
        for (what, channel) in [("velocity", &check.velocity), ("effort", &check.effort)] {
            if channel.at_bounds > 0.02 && width(channel) > 0.0 {
                let message = format!(
                    "the {what} rests at a bound for {:.0} % of the samples: the sensor saturates",
                    100.0 * channel.at_bounds
                );
                self.remark(Fault::Saturated, at, message);
            }
        }
    }

    /// Positions beyond the limits, and ratios of about 57 between quantities that should agree.
    fn units(&mut self, check: &JointCheck, joint: &Joint, at: At<'_>) {
        let factor = FACTORS.iter().find(|(kind, ..)| *kind == joint.kind);
        let Some((_, factor, words)) = factor else { return };
        let near = |ratio: f64| (factor / NEAR..factor * NEAR).contains(&ratio);
        if let Some(relation) = check.following.filter(|relation| relation.best_correlation > 0.7) {
            for (ratio, what) in [(relation.ratio, "the position"), (1.0 / relation.ratio, "the command")] {
                if near(ratio) {
                    self.refuse(
                        Fault::Units,
                        at,
                        format!(
                            "{what} is {ratio:.0} times the other of command and position: it seems to be in {words}"
                        ),
                    );
                }
            }
        }
        if let Some(relation) = check
            .velocity_to_slope
            .filter(|relation| relation.correlation.abs() > 0.7)
        {
            if near(relation.ratio) {
                self.refuse(
                    Fault::Units,
                    at,
                    format!(
                        "the velocity is {:.0} times the slope of the position: it seems to be in {words}, per second",
                        relation.ratio
                    ),
                );
            } else if !(0.5..2.0).contains(&relation.ratio) {
                self.refuse(
                    Fault::Units,
                    at,
                    format!(
                        "the velocity is {:.3} times the slope of the position: its unit or scale is another",
                        relation.ratio
                    ),
                );
            }
        }
        let (lower, upper) = joint.limits;
        let slack = BEYOND_LIMITS * (upper - lower);
        let Some([smallest, largest]) = check.position.range.filter(|_| slack.is_finite()) else {
            return;
        };
        if smallest >= lower - slack && largest <= upper + slack {
            return;
        }
        let fits = smallest / factor >= lower - slack && largest / factor <= upper + slack;
        let range = format!("positions from {smallest:.3} to {largest:.3}, limits {lower:.3} to {upper:.3}");
        if fits && (smallest.abs().max(largest.abs())) > 3.0 * lower.abs().max(upper.abs()) {
            self.refuse(Fault::Units, at, format!("{range}: they seem to be in {words}"));
        } else {
            self.refuse(
                Fault::OutOfRange,
                at,
                format!("{range}: another robot, another zero, or another unit"),
            );
        }
    }

    fn signs(&mut self, recording: &Recording, check: &JointCheck, joint: &Joint, at: At<'_>) {
        if let Some(relation) = check.velocity_to_slope.filter(|relation| relation.correlation < -0.5) {
            let message = format!(
                "the velocity goes against the slope of the position (correlation {:.2}): its sign is flipped",
                relation.correlation
            );
            self.refuse(Fault::SignFlipped, at, message);
        }
        let Some(relation) = check.following.filter(|_| told(check) && joint.actuator.is_some()) else {
            return;
        };
        if relation.correlation < -0.6 && relation.best_correlation < 0.3 {
            let message = format!(
                "the position goes against the commands (correlation {:.2}): the sign of one of them is flipped",
                relation.correlation
            );
            self.refuse(Fault::SignFlipped, at, message);
        } else if relation.best_correlation < 0.2 && !follows_another(recording, check) {
            let message = format!(
                "the joint does not follow its commands (correlation {:.2}): log and commands do not belong together",
                relation.best_correlation
            );
            self.refuse(Fault::Unrelated, at, message);
        }
    }

    /// Joints that follow each other's commands and not their own.
    fn swaps(&mut self, recording: &Recording, log: &LogCheck) {
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

fn finding(fault: Fault, at: At<'_>, message: String) -> Finding {
    Finding {
        fault,
        log: at.log.map(str::to_owned),
        joint: at.joint.map(str::to_owned),
        message,
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
