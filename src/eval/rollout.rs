//! Episodes of an evaluation as MCAP logs, as a real robot would write them, with the truth beside them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Vector3 as Vector;
use omniwalk_env::Batch;
use omniwalk_env::engine::GRAVITY;
use omniwalk_env::robot::Robot;
use omniwalk_env::task::reward::TERM_NAMES;
use serde_json::{Map, json};

use omniwalk_sim2real::log::messages::{
    Header, Imu, JointState, Odometry, Point, PolicyStep, Pose, PoseWithCovariance, Quaternion, Twist,
    TwistWithCovariance, Vector3,
};
use omniwalk_sim2real::log::{LogError, LogWriter, Message};

/// Writes the first episode of one environment of a batch.
pub struct Recorder {
    environment: usize,
    writer: LogWriter,
    path: PathBuf,
    names: Vec<String>,
    time: u64,
    step: u64,
    velocity: Option<Vector<f64>>,
    over: bool,
}

impl Recorder {
    /// Records `environment` to `path`; a control step lasts `dt` s.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be written.
    pub fn create(path: &Path, environment: usize, robot: &Robot, dt: f64) -> Result<Self, LogError> {
        let mut writer = LogWriter::create(path)?;
        let about = [("robot", robot.name.clone()), ("control_dt", dt.to_string())];
        writer.metadata(
            "rollout",
            about
                .map(|(key, value)| (key.to_owned(), value))
                .into_iter()
                .collect::<BTreeMap<_, _>>(),
        )?;
        Ok(Self {
            environment,
            writer,
            path: path.to_owned(),
            names: (0..robot.policy.len())
                .map(|i| robot.policy_joint(i).name.clone())
                .collect(),
            time: 0,
            step: (dt * 1e9).round() as u64,
            velocity: None,
            over: false,
        })
    }

    /// Takes in the batch after a step with `actions`, which started from `observations`.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be written.
    pub fn step(&mut self, batch: &Batch, observations: &[f32], actions: &[f32]) -> Result<(), LogError> {
        if self.over {
            return Ok(());
        }
        let e = self.environment;
        let row = |all: &[f32]| {
            let n = all.len() / batch.environments();
            all[e * n..(e + 1) * n]
                .iter()
                .map(|&x| f64::from(x))
                .collect::<Vec<_>>()
        };
        let (environment, ..) = batch.look(e);
        let targets = environment.targets().iter().map(|&x| f64::from(x)).collect();
        self.joints(targets, Vec::new(), Vec::new(), Message::JointCommands)?;
        let reward: Map<_, _> = TERM_NAMES
            .iter()
            .zip(batch.terms()[e].array())
            .map(|(name, x)| ((*name).to_owned(), json!(x)))
            .collect();
        let policy = PolicyStep {
            observation: row(observations),
            action: row(actions),
            reward,
        };
        self.writer.write(self.time, &Message::Policy(policy))?;
        self.time += self.step;
        if batch.ends()[e].is_some() {
            // The environment has already started another episode.
            self.over = true;
            return Ok(());
        }
        self.state(batch)
    }

    /// Takes in the state of the batch at the beginning.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be written.
    pub fn state(&mut self, batch: &Batch) -> Result<(), LogError> {
        let e = self.environment;
        let (environment, engine, world) = batch.look(e);
        let reading = environment.reading();
        let wide = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        let torque = &engine.joints().torque;
        let effort = batch
            .shared()
            .robot
            .policy
            .iter()
            .map(|&d| torque[d * engine.worlds() + world])
            .collect();
        self.joints(
            wide(&reading.position),
            wide(&reading.velocity),
            effort,
            Message::JointStates,
        )?;
        let base = engine.base(world);
        let q = base.orientation;
        let turned = Quaternion {
            x: q.i,
            y: q.j,
            z: q.k,
            w: q.w,
        };
        let last = self
            .velocity
            .replace(base.linear_velocity)
            .unwrap_or(base.linear_velocity);
        let acceleration = (base.linear_velocity - last) / (self.step as f64 * 1e-9) + Vector::z() * GRAVITY;
        let [x, y, z] = reading.gyro.map(f64::from);
        let imu = Imu {
            header: Header::new(self.time, "base"),
            orientation: turned.clone(),
            angular_velocity: Vector3 { x, y, z },
            linear_acceleration: vector(q.inverse() * acceleration),
            ..Imu::default()
        };
        self.writer.write(self.time, &Message::Imu(imu))?;
        let [x, y, z] = environment.desired();
        let command = Twist {
            linear: Vector3 { x, y, z: 0.0 },
            angular: Vector3 { x: 0.0, y: 0.0, z },
        };
        self.writer.write(self.time, &Message::CmdVel(command))?;
        let position = Point {
            x: base.position.x,
            y: base.position.y,
            z: base.position.z,
        };
        let twist = Twist {
            linear: vector(q.inverse() * base.linear_velocity),
            angular: vector(q.inverse() * base.angular_velocity),
        };
        let odometry = Odometry {
            header: Header::new(self.time, "odom"),
            child_frame_id: "base".to_owned(),
            pose: PoseWithCovariance {
                pose: Pose {
                    position,
                    orientation: turned,
                },
                ..PoseWithCovariance::default()
            },
            twist: TwistWithCovariance {
                twist,
                ..TwistWithCovariance::default()
            },
        };
        self.writer.write(self.time, &Message::Odom(Box::new(odometry)))
    }

    /// Completes the file and returns its path.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be written.
    pub fn finish(self) -> Result<PathBuf, LogError> {
        self.writer.finish()?;
        Ok(self.path)
    }

    fn joints(
        &mut self,
        position: Vec<f64>,
        velocity: Vec<f64>,
        effort: Vec<f64>,
        topic: fn(JointState) -> Message,
    ) -> Result<(), LogError> {
        let header = Header::new(self.time, "");
        let message = JointState {
            header,
            name: self.names.clone(),
            position,
            velocity,
            effort,
        };
        self.writer.write(self.time, &topic(message))
    }
}

fn vector(v: Vector<f64>) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}
