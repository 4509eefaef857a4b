//! What logs can carry, before anything is concluded from them: rates, gaps, units, signs, excitation.
//!
//! A [`Check`] holds figures for each log and joint, remarks, and refusals: what makes any answer from these logs
//! unfounded. It judges what the logs show, by the robot's limits and by what command, position and velocity say of
//! each other; which parameters of a model the motion can tell is for the model to say.

mod amounts;
mod channel;
mod commands;
mod findings;
mod readings;
mod relation;
mod rules;
mod text;
mod units;

use std::collections::BTreeMap;

use omniwalk_env::robot::Robot;
use serde::Serialize;

use crate::recording::{JointRecord, Recording};

pub use channel::Channel;
pub use relation::Relation;

/// What is wrong with logs, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// No logs, or logs without joints.
    Empty,
    /// Too few readings or too little time.
    TooShort,
    /// Nothing moves by more than noise and resolution.
    NoExcitation,
    /// A joint of the robot is not in the log.
    MissingJoint,
    /// None of the log's joints is the robot's.
    WrongRobot,
    /// Commands, but no measurement.
    NoMeasurement,
    /// A motor that is on, but no commands.
    NoCommand,
    /// A reading that stays the same while the joint is told to move.
    Stuck,
    /// A reading that rests at its largest or smallest value.
    Saturated,
    /// Values that fit the robot when taken as degrees (or millimetres).
    Units,
    /// Positions that the robot cannot have.
    OutOfRange,
    /// A position or velocity of the wrong sign.
    SignFlipped,
    /// Two joints that follow each other's commands.
    Swapped,
    /// A joint that does not follow its commands at all.
    Unrelated,
    /// Commands and measurements of different times.
    ClockOffset,
    /// Times that jump: a clock that was set meanwhile, or logs that were joined.
    ClockJump,
    /// Time without readings.
    Gaps,
    /// Readings that no joint took.
    Outliers,
    /// Rows without a reading.
    Missing,
    /// Two joints with the same readings, or commands that are the readings.
    SameReadings,
    /// A log that is another's copy.
    Copy,
    /// A motor that follows its commands while it is said to be off.
    Switch,
    /// Readings that are far apart.
    LowRate,
    /// Joints of the log that the robot does not have.
    UnknownJoint,
    /// A joint that moves too little to say anything of it, or one way only.
    LittleMotion,
    /// A parameter that a log overrides, and that is not used, or not everywhere.
    UnusedOverride,
    /// What reading the file had to assume.
    Note,
}

/// Something that is wrong, or should be known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What kind of thing.
    pub fault: Fault,
    /// The log it is in, of several the first; `None` for all of them together.
    pub log: Option<String>,
    /// Other logs that it is true of, with other numbers perhaps.
    pub others: usize,
    /// The joint it is about.
    pub joint: Option<String>,
    /// What is wrong and what would be right.
    pub message: String,
}

/// How much of what a joint can do the logs show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Excitation {
    /// Smallest and largest position, rad or m.
    pub range: [f64; 2],
    /// Range over what noise and resolution alone make of a joint at rest.
    pub range_over_noise: f64,
    /// Largest speed, rad/s or m/s, over 50 ms.
    pub fastest: f64,
    /// Shares of the time in which the joint moves forward, backward, and rests (below 2 % of its largest speed).
    pub forward_backward_rest: [f64; 3],
    /// Share of the cells that position and velocity visit, of 10 x 10 within joint limits and motor speed.
    pub coverage: f64,
}

/// The figures of one joint in one log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointCheck {
    /// The joint.
    pub name: String,
    /// Commands.
    pub command: Channel,
    /// Measured positions.
    pub position: Channel,
    /// Measured velocities.
    pub velocity: Channel,
    /// Measured efforts.
    pub effort: Channel,
    /// Readings that repeated the one before and were left out.
    pub repeated: usize,
    /// Readings that no joint took and were left out.
    pub outliers: usize,
    /// Rows or messages without a position.
    pub missing: usize,
    /// Share of the time in which the motor was on.
    pub enabled: f64,
    /// Position against command, while the motor is on.
    pub following: Option<Relation>,
    /// Measured velocity against the slope of the position.
    pub velocity_to_slope: Option<Relation>,
    /// How the joint moved.
    pub excitation: Excitation,
}

/// The figures of one log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogCheck {
    /// The recording.
    pub name: String,
    /// Time from its start to its last sample, s.
    pub seconds: f64,
    /// The robot's joints that are in it.
    pub joints: Vec<JointCheck>,
    /// Per topic of an MCAP file, the median of log time minus stamp, s; none where log time was used.
    pub clocks: Vec<(String, Option<f64>)>,
}

/// What a set of logs can carry.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// The figures.
    pub logs: Vec<LogCheck>,
    /// Why no answer can be had from these logs; empty if one can.
    pub refusals: Vec<Finding>,
    /// What should be known.
    pub remarks: Vec<Finding>,
}

impl Check {
    /// Checks `recordings` of `robot`.
    pub fn new(recordings: &[Recording], robot: &Robot) -> Self {
        let logs: Vec<LogCheck> = recordings.iter().map(|recording| log_check(recording, robot)).collect();
        let findings = findings::Findings::new(recordings, &logs, robot);
        Self {
            logs,
            refusals: findings.refusals.into_findings(),
            remarks: findings.remarks.into_findings(),
        }
    }

    /// Adds, and returns, a remark for each joint that the nominal robot's simulation misses by the root mean squares of `errors` (rad or m)
    /// as far as it moves: is it this robot's?
    pub(crate) fn far_off(&mut self, errors: &BTreeMap<String, f64>) -> Vec<Finding> {
        let spread = |name: &str| {
            let own = self
                .logs
                .iter()
                .flat_map(|log| &log.joints)
                .filter(|joint| joint.name == name);
            own.map(|joint| joint.position.deviation).fold(0.0, f64::max)
        };
        let far = errors
            .iter()
            .filter(|(name, error)| **error > spread(name) && spread(name) > 0.0);
        let remark = |(name, error): (&String, &f64)| Finding {
            fault: Fault::WrongRobot,
            log: None,
            others: 0,
            joint: Some(name.clone()),
            message: format!(
                "the nominal robot is off by {} there, more than the joint moves ({}, root mean squares): what was found is doubtful \
                 if the logs, the map or the robot's files are another robot's",
                text::fixed(*error, 4),
                text::fixed(spread(name), 4)
            ),
        };
        let found: Vec<Finding> = far.map(remark).collect();
        self.remarks.extend_from_slice(&found);
        found
    }

    /// Refusals that make an error on these logs unfounded too: that they are short or hardly move does not.
    pub fn unfounded(&self) -> impl Iterator<Item = &Finding> {
        let little = [Fault::TooShort, Fault::NoExcitation, Fault::LowRate];
        self.refusals
            .iter()
            .filter(move |finding| !little.contains(&finding.fault))
    }

    /// Whether anything may be concluded from the logs.
    pub fn usable(&self) -> bool {
        self.refusals.is_empty()
    }
}

/// The robot's joint of this name.
fn robot_joint<'r>(robot: &'r Robot, name: &str) -> Option<&'r omniwalk_env::robot::Joint> {
    robot
        .dofs
        .iter()
        .map(|&joint| &robot.joints[joint])
        .find(|joint| joint.name == name)
}

fn log_check(recording: &Recording, robot: &Robot) -> LogCheck {
    let joints = recording.joints.iter();
    LogCheck {
        name: recording.name.clone(),
        seconds: recording.duration(),
        joints: joints
            .filter_map(|joint| Some(joint_check(joint, robot_joint(robot, &joint.name)?)))
            .collect(),
        clocks: recording
            .clocks
            .iter()
            .map(|clock| (clock.topic.clone(), clock.log_minus_stamp))
            .collect(),
    }
}

fn joint_check(record: &JointRecord, joint: &omniwalk_env::robot::Joint) -> JointCheck {
    let position = Channel::new(&record.position);
    let count = record.position.time.iter().filter(|time| record.is_on(**time)).count();
    JointCheck {
        name: record.name.clone(),
        command: Channel::new(&record.command),
        velocity: Channel::new(&record.velocity),
        effort: Channel::new(&record.effort),
        repeated: record.repeated,
        outliers: record.outliers,
        missing: record.missing,
        enabled: count as f64 / record.position.len().max(1) as f64,
        following: relation::following(record),
        velocity_to_slope: relation::velocity_to_slope(record),
        excitation: excitation(record, joint, &position),
        position,
    }
}

/// Cells of each axis in which coverage is counted.
const CELLS: usize = 10;
/// Speed below which a joint counts as resting, as a share of its largest.
const REST: f64 = 0.02;

fn excitation(record: &JointRecord, joint: &omniwalk_env::robot::Joint, position: &Channel) -> Excitation {
    let Some(range) = position.range else {
        return Excitation::default();
    };
    let slopes = relation::slopes(&record.position);
    let fastest = slopes
        .iter()
        .fold(0.0_f64, |fastest, slope| fastest.max(slope.speed.abs()));
    let mut shares = [0.0; 3];
    let mut visited = [false; CELLS * CELLS];
    let (lower, upper) = joint.limits;
    let limits = if (upper - lower).is_finite() {
        [lower, upper]
    } else {
        range
    };
    let speed_limit = joint.actuator.map_or(fastest, |motor| motor.speed_limit);
    for slope in &slopes {
        let kind = if slope.speed.abs() <= REST * fastest {
            2
        } else {
            usize::from(slope.speed < 0.0)
        };
        shares[kind] += 1.0 / slopes.len() as f64;
        let cell = |share: f64| ((share * CELLS as f64) as usize).min(CELLS - 1);
        let along = cell(((slope.position - limits[0]) / (limits[1] - limits[0]).max(1e-12)).max(0.0));
        let across = cell((0.5 + 0.5 * slope.speed / speed_limit.max(1e-12)).max(0.0));
        visited[along * CELLS + across] = true;
    }
    Excitation {
        range,
        range_over_noise: (range[1] - range[0]) / position.noise.max(position.resolution).max(1e-12),
        fastest,
        forward_backward_rest: shares,
        coverage: visited.iter().filter(|visited| **visited).count() as f64 / visited.len() as f64,
    }
}

#[cfg(test)]
mod tests;
