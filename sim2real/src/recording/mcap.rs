//! A recording from an MCAP file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::clock::{self, Times};
use super::labels::{label, possible};
use super::map::Map;
use super::repeats::fresh;
use super::{CommandKind, ImuRecord, JointRecord, OdometryRecord, Recording, RecordingError, Samples, Series, content};
use crate::log::messages::{self, Imu, JointState, Odometry};
use crate::log::{LogReader, Message};

const STATES: &str = "/joint_states";
const COMMANDS: &str = "/joint_commands";
const ENABLED: &str = "/actuator_enabled";
const IMU: &str = "/imu";
const ODOMETRY: &str = "/odom";
const BATTERY: &str = "/battery";
const VELOCITY: &str = "/cmd_vel";

/// Distinct joint names of a file, beyond which it is no robot's log.
const MAX_JOINTS: usize = 4096;

/// Reads the recording in the MCAP file at `path`, which is called `name`; `map` may label it.
pub(super) fn read(path: &Path, name: String, map: Option<&Map>) -> Result<Recording, RecordingError> {
    let mut gathered = Gathered {
        path: path.to_owned(),
        ..Gathered::default()
    };
    let mut log = LogReader::open(path)?;
    for entry in log.by_ref() {
        let entry = entry?;
        if let Some(message) = entry.message {
            gathered.take(entry.time, message)?;
        }
    }
    let mut recording = gathered.finish()?;
    recording.name = name;
    if let Some(groups) = log.metadata().get("groups") {
        recording.groups.clone_from(groups);
    }
    for (key, text) in log.metadata().get("robot_overrides").into_iter().flatten() {
        let value = text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
        let place = format!("metadata robot_overrides, key `{key}`");
        let value = value.ok_or_else(|| {
            let help = "give each overridden parameter a finite number";
            content(path, &place, format!("`{text}` is no number"), help)
        })?;
        possible(path, &place, key, value)?;
        recording.overrides.insert(key.clone(), value);
    }
    if let Some(map) = map {
        let records = log.metadata().iter();
        let fields = records.flat_map(|(name, record)| {
            record
                .iter()
                .map(move |(key, value)| (format!("{name}.{key}"), value.clone()))
        });
        label(path, map, &fields.collect(), None, &mut recording)?;
        if map.is_of_columns() {
            let note = "the map's columns say nothing of an MCAP file, whose topics and joints have names of their own: not used";
            recording.notes.push(note.into());
        }
    }
    Ok(recording)
}

/// Rows of one joint on one topic; a value that a message does not give is NaN.
#[derive(Default)]
struct Rows {
    /// Number of the message on the topic.
    message: Vec<usize>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
}

/// A topic of joint values.
#[derive(Default)]
struct JointTopic {
    times: Times,
    joints: BTreeMap<String, Rows>,
}

#[derive(Default)]
struct Gathered {
    path: PathBuf,
    /// Joints in the order in which they were met.
    order: Vec<String>,
    states: JointTopic,
    commands: JointTopic,
    enabled: JointTopic,
    imu: (Times, Vec<Imu>),
    odometry: (Times, Vec<Odometry>),
    battery: (Times, Vec<f64>),
    velocity: (Times, Vec<[f64; 3]>),
}

impl Gathered {
    fn take(&mut self, log: u64, message: Message) -> Result<(), RecordingError> {
        let stamp = message.stamp();
        match message {
            Message::JointStates(joints) => {
                self.meet(&joints, STATES)?;
                self.states.take(log, stamp, joints);
            }
            Message::JointCommands(joints) => {
                self.meet(&joints, COMMANDS)?;
                self.commands.take(log, stamp, joints);
            }
            Message::Enabled(joints) => self.enabled.take(log, stamp, joints),
            Message::Imu(imu) => {
                self.imu.0.push(log, stamp);
                self.imu.1.push(imu);
            }
            Message::Odom(odometry) => {
                self.odometry.0.push(log, stamp);
                self.odometry.1.push(*odometry);
            }
            Message::Battery(battery) => {
                self.battery.0.push(log, stamp);
                self.battery.1.push(f64::from(battery.voltage));
            }
            Message::CmdVel(twist) => {
                self.velocity.0.push(log, None);
                self.velocity.1.push([twist.linear.x, twist.linear.y, twist.angular.z]);
            }
            Message::Policy(_) | Message::Transforms(_) | Message::Description(_) => {}
        }
        Ok(())
    }

    /// Remembers joints that are new, of which there must not be too many.
    fn meet(&mut self, joints: &JointState, topic: &'static str) -> Result<(), RecordingError> {
        for name in &joints.name {
            let known = self.states.joints.contains_key(name) || self.commands.joints.contains_key(name);
            if !known && !self.order.contains(name) {
                self.order.push(name.clone());
            }
        }
        if self.order.len() > MAX_JOINTS {
            let index = self.states.times.len() + self.commands.times.len();
            let why = format!("more than {MAX_JOINTS} joint names so far");
            return Err(self.content(topic, index, why, "joint names must not change from message to message"));
        }
        Ok(())
    }

    fn content(&self, topic: &str, index: usize, why: String, help: &str) -> RecordingError {
        content(&self.path, &format!("message {index} of {topic}"), why, help)
    }

    fn finish(mut self) -> Result<Recording, RecordingError> {
        let clocks = clock::align(&[
            (STATES, &self.states.times),
            (COMMANDS, &self.commands.times),
            (ENABLED, &self.enabled.times),
            (IMU, &self.imu.0),
            (ODOMETRY, &self.odometry.0),
            (BATTERY, &self.battery.0),
            (VELOCITY, &self.velocity.0),
        ]);
        let mut recording = Recording {
            clocks: clocks.topics,
            notes: clocks.notes,
            ..Recording::default()
        };
        let [states, commands, enabled, imu, odometry, battery, velocity] = &clocks.times[..] else {
            unreachable!("as many clocks as topics");
        };
        for name in std::mem::take(&mut self.order) {
            let mut joint = self.joint(name, states, commands, &mut recording.notes)?;
            joint.enabled = self.enabled_series(&joint.name, enabled)?;
            recording.joints.push(joint);
        }
        for (name, rows) in self.enabled.joints.iter().filter(|(name, _)| !name.is_empty()) {
            if recording.joint(name).is_none() {
                recording.notes.push(format!(
                    "{ENABLED} names `{name}`, of which there is nothing else; not used"
                ));
            }
            if rows.position.iter().any(|value| *value != 0.0 && *value != 1.0) {
                recording.notes.push(format!(
                    "{ENABLED} of `{name}` has values that are neither 0 nor 1: more than 0 is on"
                ));
            }
        }
        if !imu.is_empty() {
            recording.imu = Some(self.imu_record(imu)?);
        }
        if !odometry.is_empty() {
            recording.odometry = Some(self.odometry_record(odometry)?);
        }
        recording.voltage = self.samples(BATTERY, battery, &self.battery.1, |v| {
            Some(*v).filter(|v| v.is_finite())
        })?;
        let finite = |v: &[f64; 3]| Some(*v).filter(|v| v.iter().all(|v| v.is_finite()));
        recording.velocity_command = self.samples(VELOCITY, velocity, &self.velocity.1, finite)?;
        Ok(recording)
    }

    fn joint(
        &self,
        name: String,
        states: &[f64],
        commands: &[f64],
        notes: &mut Vec<String>,
    ) -> Result<JointRecord, RecordingError> {
        let mut joint = JointRecord::default();
        if let Some(rows) = self.states.joints.get(&name) {
            let fresh = rows.fresh();
            joint.repeated = fresh.iter().filter(|fresh| !**fresh).count();
            joint.missing = rows.position.iter().filter(|position| !position.is_finite()).count();
            joint.position = self.series(STATES, states, rows, &rows.position, Some(&fresh))?;
            joint.velocity = self.series(STATES, states, rows, &rows.velocity, Some(&fresh))?;
            joint.effort = self.series(STATES, states, rows, &rows.effort, Some(&fresh))?;
        }
        if let Some(rows) = self.commands.joints.get(&name) {
            joint.command = self.series(COMMANDS, commands, rows, &rows.position, None)?;
            if joint.command.is_empty() {
                joint.command = self.series(COMMANDS, commands, rows, &rows.effort, None)?;
                joint.command_kind = CommandKind::Effort;
            }
            if joint.command.is_empty() {
                notes.push(format!(
                    "{COMMANDS} gives `{name}` neither position nor effort; its commands are not used"
                ));
            }
        }
        joint.name = name;
        Ok(joint)
    }

    fn enabled_series(&self, name: &str, times: &[f64]) -> Result<Series, RecordingError> {
        // The empty name stands for all joints.
        let Some(rows) = [name, ""].iter().find_map(|name| self.enabled.joints.get(*name)) else {
            return Ok(Series::default());
        };
        let mut enabled = self.series(ENABLED, times, rows, &rows.position, None)?;
        let is_on = |value: &mut f64| *value = f64::from(u8::from(*value > 0.0));
        enabled.value.iter_mut().for_each(is_on);
        Ok(enabled)
    }

    /// The values of `rows` that are there, on the topic's clock; of equal times the first counts.
    fn series(
        &self,
        topic: &str,
        times: &[f64],
        rows: &Rows,
        values: &[f64],
        fresh: Option<&[bool]>,
    ) -> Result<Series, RecordingError> {
        let mut series = Series::default();
        let mut last = f64::NEG_INFINITY;
        for (row, (&message, &value)) in rows.message.iter().zip(values).enumerate() {
            let time = times[message];
            self.check_order(topic, message, last, time)?;
            let wanted = fresh.is_none_or(|fresh| fresh[row]) && value.is_finite();
            if wanted && time > last {
                series.push(time, value);
            }
            last = time;
        }
        Ok(series)
    }

    /// What `value` makes of the messages, on the topic's clock; of equal times the first counts.
    fn samples<M, T>(
        &self,
        topic: &str,
        times: &[f64],
        messages: &[M],
        value: impl Fn(&M) -> Option<T>,
    ) -> Result<Samples<T>, RecordingError> {
        let mut samples = Samples::default();
        let mut last = f64::NEG_INFINITY;
        for (index, (message, &time)) in messages.iter().zip(times).enumerate() {
            self.check_order(topic, index, last, time)?;
            if let Some(value) = value(message).filter(|_| time > last) {
                samples.push(time, value);
            }
            last = time;
        }
        Ok(samples)
    }

    fn check_order(&self, topic: &str, index: usize, last: f64, time: f64) -> Result<(), RecordingError> {
        if time >= last {
            return Ok(());
        }
        let why = format!("time goes backwards: {time:.6} s after {last:.6} s, from the log's start");
        Err(self.content(
            topic,
            index,
            why,
            "record with one clock that never steps back, and do not join logs",
        ))
    }

    fn imu_record(&self, times: &[f64]) -> Result<ImuRecord, RecordingError> {
        let unknown = |imu: &Imu| imu.orientation_covariance.0[0] < 0.0;
        let orientation = |imu: &Imu| orientation(&imu.orientation).filter(|_| !unknown(imu));
        Ok(ImuRecord {
            orientation: self.samples(IMU, times, &self.imu.1, orientation)?,
            angular_velocity: self.samples(IMU, times, &self.imu.1, |imu| vector(&imu.angular_velocity))?,
            linear_acceleration: self.samples(IMU, times, &self.imu.1, |imu| vector(&imu.linear_acceleration))?,
        })
    }

    fn odometry_record(&self, times: &[f64]) -> Result<OdometryRecord, RecordingError> {
        let pose = |odometry: &Odometry| {
            let pose = &odometry.pose.pose;
            let position = Vector3::new(pose.position.x, pose.position.y, pose.position.z);
            let finite = position.iter().all(|x| x.is_finite());
            let orientation = orientation(&pose.orientation).filter(|_| finite)?;
            Some(Isometry3::from_parts(Translation3::from(position), orientation))
        };
        let messages = &self.odometry.1;
        Ok(OdometryRecord {
            pose: self.samples(ODOMETRY, times, messages, pose)?,
            linear_velocity: self.samples(ODOMETRY, times, messages, |o| vector(&o.twist.twist.linear))?,
            angular_velocity: self.samples(ODOMETRY, times, messages, |o| vector(&o.twist.twist.angular))?,
        })
    }
}

impl JointTopic {
    fn take(&mut self, log: u64, stamp: Option<u64>, joints: JointState) {
        let message = self.times.len();
        self.times.push(log, stamp);
        let value = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(f64::NAN);
        // One value without a name holds for all joints and is kept under the empty name.
        let names = if joints.name.is_empty() && !joints.position.is_empty() {
            vec![String::new()]
        } else {
            joints.name
        };
        for (i, name) in names.into_iter().enumerate() {
            let rows = self.joints.entry(name).or_default();
            rows.message.push(message);
            rows.position.push(value(&joints.position, i));
            rows.velocity.push(value(&joints.velocity, i));
            rows.effort.push(value(&joints.effort, i));
        }
    }
}

impl Rows {
    /// Which rows hold a reading of their own.
    fn fresh(&self) -> Vec<bool> {
        fresh(&self.position, &[&self.velocity, &self.effort])
    }
}

/// The rotation, unless it is none.
fn orientation(q: &messages::Quaternion) -> Option<UnitQuaternion<f64>> {
    UnitQuaternion::try_new(Quaternion::new(q.w, q.x, q.y, q.z), 1e-6)
        .filter(|q| q.coords.iter().all(|x| x.is_finite()))
}

fn vector(v: &messages::Vector3) -> Option<Vector3<f64>> {
    Some(Vector3::new(v.x, v.y, v.z)).filter(|v| v.iter().all(|x| x.is_finite()))
}
