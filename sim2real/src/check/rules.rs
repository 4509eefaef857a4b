//! From figures to refusals and remarks.

use omniwalk_env::effect::Kind;
use omniwalk_env::robot::{Joint, Robot};

use super::findings::{At, Findings};
use super::{Fault, JointCheck, LogCheck, robot_joint};
use crate::recording::overrides::{self, SUPPLY};
use crate::recording::{CommandKind, Jump, Recording};

/// Least range of motion, in units of noise or resolution, that is motion and not noise (six sigma each way).
pub(super) const LEAST_RANGE: f64 = 12.0;
/// Commanded range that should show in the position, rad or m, if it is also well above the resolution.
pub(super) const COMMANDED: f64 = 0.02;

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
            found.overrides(recording, robot);
            if found.jumps(recording, log) {
                continue;
            }
            for check in &log.joints {
                if let Some(joint) = robot_joint(robot, &check.name) {
                    found.joint(recording, check, joint);
                }
            }
            found.unrelated(recording, log, robot);
            found.swaps(recording, log);
            found.same_readings(recording, log);
        }
        found.copies(recordings);
        found.amounts(logs, robot);
        found
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
        if recording.joints.is_empty() {
            let message = "there are no joints in it: /joint_states and /joint_commands have other names or no messages, or the map \
                           names no joint";
            return self.refuse(Fault::Empty, at, message);
        }
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
            let message = format!(
                "the robot's joint `{name}` is not in the log, which has {}: log it, or lock it in the robot's TOML",
                in_log()
            );
            self.refuse(Fault::MissingJoint, at, message);
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

    /// Overrides that change nothing, or not everywhere.
    fn overrides(&mut self, recording: &Recording, robot: &Robot) {
        let knows_voltage = |joint: Option<&str>| {
            let mut own = robot.effects.iter().filter(|effect| effect.kind == Kind::SupplyVoltage);
            own.any(|effect| joint.is_none_or(|joint| robot.dof(effect.target).name == joint))
        };
        let at = At {
            log: Some(&recording.name),
            joint: None,
        };
        for key in recording.overrides.keys() {
            let (joint, name) = overrides::parts(key);
            if name == SUPPLY && !knows_voltage(joint) {
                let joints = joint.unwrap_or("*");
                let message = format!(
                    "the override `{key}` is not used, as the robot has no nominal voltage to compare it with: add `[[effect]]`, \
                     `id = \"{SUPPLY}\"`, `match = [\"{joints}\"]`, `actual = V` and `nominal = V` to its TOML, V the voltage at which \
                     its kp, torque and speed limits hold"
                );
                self.remark(Fault::UnusedOverride, at, message);
            } else if overrides::is_tuned(key) {
                let message = format!(
                    "the override `{key}` holds in `replay`; `identify` re-tunes {name} to one value for all logs, unless it is zero in \
                     the robot's TOML"
                );
                self.remark(Fault::UnusedOverride, at, message);
            }
        }
    }

    /// Whether the readings of any joint jump in time; what else would be said of them would be said of two logs.
    fn jumps(&mut self, recording: &Recording, log: &LogCheck) -> bool {
        let own = log.joints.iter().filter_map(|check| recording.joint(&check.name));
        let jumps = own.filter_map(|joint| Some((joint, joint.position.jump()?)));
        let jumps: Vec<_> = jumps.collect();
        let Some((first, jump)) = jumps.first() else {
            return false;
        };
        let at = At {
            log: Some(&log.name),
            joint: Some(&first.name),
        };
        let more = match jumps.len() - 1 {
            0 => String::new(),
            more => format!(", and {more} more joints jump"),
        };
        self.refuse(Fault::ClockJump, at, format!("{jump}{more}: {}", Jump::HELP));
        true
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
        if !self.clocks(recording, check, at) {
            self.lost_commands(recording, at);
        }
        self.units(check, joint, at);
        let own = recording.joints.iter().find(|own| own.name == check.name);
        if own.is_some_and(|own| own.command_kind == CommandKind::Position) {
            self.far_targets(check, at);
        }
        self.signs(check, joint, at);
        self.switch(recording, check, at);
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
        self.readings(recording, check, joint, at);
    }
}
