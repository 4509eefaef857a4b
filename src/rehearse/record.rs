//! The log a robot would write: what it measured, what it was told, and when.

use std::path::Path;
use std::sync::Arc;

use omniwalk_env::engine::BaseState;
use omniwalk_env::robot::Robot;
use omniwalk_env::sensors::Reading;
use omniwalk_sim2real::log::{LogError, LogWriter};

use crate::telemetry::Telemetry;

/// Writes a log; times are ns since the start.
pub struct Record {
    writer: LogWriter,
    telemetry: Telemetry,
}

impl Record {
    pub fn create(path: &Path, robot: &Arc<Robot>) -> Result<Self, LogError> {
        let mut writer = LogWriter::create(path)?;
        let about = [("robot".to_owned(), robot.name.clone())];
        writer.metadata("rehearsal", about.into_iter().collect())?;
        let telemetry = Telemetry::new(robot);
        Ok(Self { writer, telemetry })
    }

    /// Readings, with the orientation an IMU would give.
    pub fn reading(
        &mut self,
        time: u64,
        reading: &Reading,
        effort: Vec<f64>,
        base: &BaseState,
        desired: [f32; 3],
    ) -> Result<(), LogError> {
        let messages = self.telemetry.reading(time, reading, effort, base, desired);
        messages.iter().try_for_each(|message| self.writer.write(time, message))
    }

    /// Targets as the servos took them.
    pub fn targets(&mut self, time: u64, targets: &[f32]) -> Result<(), LogError> {
        self.writer.write(time, &self.telemetry.targets(time, targets))
    }

    /// What has been written so far survives the process from here on.
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.writer.flush()
    }

    pub fn finish(self) -> Result<(), LogError> {
        self.writer.finish()
    }
}
