//! Episodes of an evaluation as MCAP logs, as a real robot would write them, with the truth beside them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::Vector3 as Vector;
use omniwalk_env::Batch;
use omniwalk_env::engine::GRAVITY;
use omniwalk_env::robot::Robot;
use omniwalk_env::task::reward::TERM_NAMES;
use serde_json::{Map, json};

use omniwalk_sim2real::log::messages::{Header, Imu, PolicyStep, Vector3};
use omniwalk_sim2real::log::{LogError, LogWriter, Message};

use crate::telemetry::{BASE, Telemetry, command, odometry, quaternion, vector, wide};

/// Writes the first episode of one environment of a batch.
pub struct Recorder {
    environment: usize,
    writer: LogWriter,
    path: PathBuf,
    /// Where it is written until it is whole: what a kill, or a full disk, leaves of it is not taken for a log, and what was at `path` stays.
    draft: PathBuf,
    telemetry: Telemetry,
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
    pub fn create(path: &Path, environment: usize, robot: &Arc<Robot>, dt: f64) -> Result<Self, LogError> {
        let draft = path.with_extension("mcap.unfinished");
        let mut writer = LogWriter::create(&draft)?;
        let about = [("robot", robot.name.clone()), ("control_dt", dt.to_string())];
        writer.metadata(
            "rollout",
            about
                .map(|(key, value)| (key.to_owned(), value))
                .into_iter()
                .collect::<BTreeMap<_, _>>(),
        )?;
        let telemetry = Telemetry::new(robot);
        writer.write(0, &telemetry.description())?;
        Ok(Self {
            environment,
            writer,
            path: path.to_owned(),
            draft,
            telemetry,
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
        let targets = self.telemetry.targets(self.time, environment.targets());
        self.writer.write(self.time, &targets)?;
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
        let torque = &engine.joints().torque;
        let effort = batch
            .shared()
            .robot
            .policy
            .iter()
            .map(|&d| torque[d * engine.worlds() + world])
            .collect();
        let (position, velocity) = (wide(&reading.position), wide(&reading.velocity));
        let joints = self.telemetry.joints(self.time, position, velocity, effort);
        self.writer.write(self.time, &Message::JointStates(joints))?;
        let base = engine.base(world);
        let q = base.orientation;
        let last = self
            .velocity
            .replace(base.linear_velocity)
            .unwrap_or(base.linear_velocity);
        let acceleration = (base.linear_velocity - last) / (self.step as f64 * 1e-9) + Vector::z() * GRAVITY;
        let [x, y, z] = reading.gyro.map(f64::from);
        let imu = Imu {
            header: Header::new(self.time, BASE),
            orientation: quaternion(&q),
            angular_velocity: Vector3 { x, y, z },
            linear_acceleration: vector(q.inverse() * acceleration),
            ..Imu::default()
        };
        self.writer.write(self.time, &Message::Imu(imu))?;
        let count = engine.worlds();
        let positions: Vec<f64> = engine
            .joints()
            .position
            .iter()
            .skip(world)
            .step_by(count)
            .copied()
            .collect();
        let rest = [
            command(environment.desired()),
            self.telemetry.transforms(self.time, &base, &positions),
            odometry(self.time, &base),
        ];
        rest.iter()
            .try_for_each(|message| self.writer.write(self.time, message))
    }

    /// Completes the file and returns its path.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be written.
    pub fn finish(self) -> Result<PathBuf, LogError> {
        self.writer.finish()?;
        let renamed = std::fs::rename(&self.draft, &self.path);
        renamed.map_err(|source| LogError::Io {
            path: self.path.clone(),
            source,
        })?;
        Ok(self.path)
    }
}
