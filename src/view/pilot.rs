//! The thread that lives with the robot: real time, orders, frames, recordings.

use std::fs::rename;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use omniwalk_sim2real::log::{LogError, LogWriter};
use serde_json::json;
use tokio::sync::{broadcast, watch};

use super::clips::Clips;
use super::drive::Drive;
use super::live::Live;
use super::orders::{Condition, Order};
use crate::run::create_folder;

/// A simulation that is this late leaves out what it missed.
const HOPELESS: Duration = Duration::from_millis(250);
/// Control steps between two reports of the robot's condition.
const REPORT: u64 = 10;
/// Longest recording, s.
const LONGEST: f64 = 3600.0;
/// Recordings of a folder.
const MOST: u32 = 9999;

/// What the thread is given.
pub struct Pilot {
    /// The robot.
    pub drive: Drive,
    /// What it is told.
    pub orders: Receiver<Order>,
    /// Where its rows go; whoever is too slow misses some.
    pub frames: broadcast::Sender<Bytes>,
    /// Where reports of its condition go, as JSON.
    pub reports: watch::Sender<String>,
    /// Foxglove.
    pub live: Option<Live>,
    /// Where recordings are offered.
    pub clips: Arc<Clips>,
    /// Where recordings are written.
    pub folder: PathBuf,
    /// Set to end the thread.
    pub stop: Arc<AtomicBool>,
}

/// What changes while it flies.
#[derive(Default)]
struct Now {
    recording: Option<Recording>,
    /// What went wrong last.
    trouble: Option<String>,
    /// Simulated over wall time, over the last reports.
    pace: f64,
}

struct Recording {
    writer: LogWriter,
    /// Where it is until it is whole.
    draft: PathBuf,
    path: PathBuf,
    /// Simulated time at its beginning, ns.
    began: u64,
}

impl Pilot {
    /// Lives until it is stopped; a recording is completed then.
    pub fn fly(mut self) {
        let period = Duration::from_nanos(self.drive.period());
        let mut due = Instant::now();
        let mut now = Now::default();
        let mut last_report = (Instant::now(), self.drive.now());
        let mut step = 0_u64;
        while !self.stop.load(Ordering::Relaxed) {
            while let Ok(order) = self.orders.try_recv() {
                self.obey(order, &mut now);
            }
            self.drive.step();
            self.show(&mut now);
            if step.is_multiple_of(REPORT) {
                let (wall, simulated) = (last_report.0.elapsed(), self.drive.now() - last_report.1);
                last_report = (Instant::now(), self.drive.now());
                now.pace = simulated as f64 * 1e-9 / wall.as_secs_f64().max(1e-9);
                self.report(&now);
            }
            step += 1;
            due += period;
            if due.elapsed() > HOPELESS {
                due = Instant::now();
            }
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        self.end_recording(&mut now);
    }

    fn obey(&mut self, order: Order, now: &mut Now) {
        match order {
            Order::Record { on: true } if now.recording.is_none() => match self.begin_recording() {
                Ok(recording) => (now.recording, now.trouble) = (Some(recording), None),
                Err(why) => now.trouble = Some(why),
            },
            Order::Record { on: false } => self.end_recording(now),
            order => self.drive.obey(order),
        }
    }

    /// The last step, to everybody who looks.
    fn show(&mut self, now: &mut Now) {
        if self.frames.receiver_count() > 0 {
            let mut row = Vec::new();
            self.drive.row(&mut row);
            // Nobody looks any more.
            let _ = self.frames.send(row.into());
        }
        if let Some(live) = self.live.as_ref().filter(|live| live.is_watched()) {
            let messages = self.drive.messages(live.epoch() + self.drive.now());
            messages.iter().for_each(|(time, message)| live.send(*time, message));
        }
        let Some(recording) = &mut now.recording else { return };
        let time = self.drive.now() - recording.began;
        let messages = self.drive.messages(time);
        let written = messages
            .iter()
            .try_for_each(|(time, message)| recording.writer.write(*time, message));
        if let Err(error) = written {
            now.trouble = Some(error.to_string());
            now.recording = None;
        } else if time as f64 * 1e-9 > LONGEST {
            self.end_recording(now);
        }
    }

    fn report(&self, now: &Now) {
        let drive = &self.drive;
        let (mode, fault) = drive.mode();
        let seconds = |recording: &Recording| (drive.now() - recording.began) as f64 * 1e-9;
        let report = json!({
            "type": "report",
            "mode": mode,
            "fault": fault,
            "falls": drive.falls(),
            "pace": now.pace,
            "friction": drive.condition(Condition::Friction),
            "latency": drive.condition(Condition::Latency),
            "payload": drive.condition(Condition::Payload),
            "recording": now.recording.as_ref().map(seconds),
            "clips": self.clips.len(),
            "trouble": now.trouble,
        });
        self.reports.send_replace(report.to_string());
    }

    fn begin_recording(&self) -> Result<Recording, String> {
        let refused = |why: std::io::Error| format!("cannot record in {}: {why}", self.folder.display());
        create_folder(&self.folder).map_err(refused)?;
        let mut names = (1..=MOST).map(|n| self.folder.join(format!("drive-{n:04}.mcap")));
        let path = names
            .find(|path| !path.exists())
            .ok_or_else(|| format!("{} is full of recordings", self.folder.display()))?;
        let draft = path.with_extension("mcap.unfinished");
        let begin = || -> Result<LogWriter, LogError> {
            let mut writer = LogWriter::create(&draft)?;
            writer.metadata("drive", [("program".to_owned(), "omniwalk view".to_owned())].into())?;
            writer.write(0, &self.drive.description())?;
            Ok(writer)
        };
        Ok(Recording {
            writer: begin().map_err(|error| error.to_string())?,
            // The next step begins now.
            began: self.drive.now(),
            draft,
            path,
        })
    }

    fn end_recording(&self, now: &mut Now) {
        let Some(recording) = now.recording.take() else { return };
        let whole = recording.writer.finish().map_err(|error| error.to_string());
        let named = whole.and_then(|()| rename(&recording.draft, &recording.path).map_err(|error| error.to_string()));
        match named {
            Ok(()) => self.clips.add(recording.path),
            Err(error) => now.trouble = Some(error),
        }
    }
}
