//! The log a robot would write: what it measured, what it was told, and when.

use std::path::Path;

use omniwalk_env::robot::Robot;
use omniwalk_env::sensors::Reading;
use omniwalk_sim2real::log::messages::{Header, Imu, JointState, Quaternion, Twist, Vector3};
use omniwalk_sim2real::log::{LogError, LogWriter, Message};

/// Writes a log; times are ns since the start.
pub struct Record {
    writer: LogWriter,
    names: Vec<String>,
}

impl Record {
    pub fn create(path: &Path, robot: &Robot) -> Result<Self, LogError> {
        let mut writer = LogWriter::create(path)?;
        let about = [("robot".to_owned(), robot.name.clone())];
        writer.metadata("rehearsal", about.into_iter().collect())?;
        let names = (0..robot.policy.len()).map(|i| robot.policy_joint(i).name.clone());
        Ok(Self {
            writer,
            names: names.collect(),
        })
    }

    /// Readings, with the orientation an IMU would give (x, y, z, w).
    pub fn reading(
        &mut self,
        time: u64,
        reading: &Reading,
        effort: Vec<f64>,
        orientation: [f64; 4],
        desired: [f32; 3],
    ) -> Result<(), LogError> {
        let joints = JointState {
            position: wide(&reading.position),
            velocity: wide(&reading.velocity),
            effort,
            ..self.joints(time)
        };
        self.writer.write(time, &Message::JointStates(joints))?;
        let [x, y, z, w] = orientation;
        let imu = Imu {
            header: Header::new(time, "base"),
            orientation: Quaternion { x, y, z, w },
            angular_velocity: vector(reading.gyro),
            ..Imu::default()
        };
        self.writer.write(time, &Message::Imu(imu))?;
        let [x, y, turn] = desired;
        let twist = Twist {
            linear: vector([x, y, 0.0]),
            angular: vector([0.0, 0.0, turn]),
        };
        self.writer.write(time, &Message::CmdVel(twist))
    }

    /// Targets as the servos took them.
    pub fn targets(&mut self, time: u64, targets: &[f32]) -> Result<(), LogError> {
        let joints = JointState {
            position: wide(targets),
            ..self.joints(time)
        };
        self.writer.write(time, &Message::JointCommands(joints))
    }

    pub fn finish(self) -> Result<(), LogError> {
        self.writer.finish()
    }

    fn joints(&self, time: u64) -> JointState {
        JointState {
            header: Header::new(time, ""),
            name: self.names.clone(),
            ..JointState::default()
        }
    }
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x)).collect()
}

fn vector(values: [f32; 3]) -> Vector3 {
    let [x, y, z] = values.map(f64::from);
    Vector3 { x, y, z }
}
