//! The robot's side: physics in real time, readings that arrive late, servos that hold what they were told last.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use omniwalk_env::plant::Plant;

use super::clock::{now, sleep_until};
use super::record::Record;
use super::report::Report;
use super::wire::{Commanded, Line, Measured};
use crate::deployed::Deployed;

/// A simulation that is this late, ns, leaves out what it missed: the controller must not meet a robot in fast motion.
const HOPELESS: u64 = 50_000_000;

/// How often the log is made safe against the end of this process, ns.
const FLUSH: u64 = 500_000_000;

/// Walking, by the number of [`omniwalk_controller::Mode`].
const WALKING: u32 = 0;

/// A simulated robot at one end of the line.
pub struct Simulated {
    plant: Plant,
    line: Line,
    record: Record,
    report: Report,
    desired: [f32; 3],
    /// Length of a physics step, ns.
    dt: u64,
    /// Physics steps of a control step.
    substeps: u64,
    /// How long readings are underway, ns.
    latency: u64,
    /// How much longer those of this control period are, ns.
    jitter: u64,
    /// Readings on their way, with the time they arrive.
    underway: VecDeque<(u64, Measured)>,
    /// When each reading was measured and the true velocity of the base then, in the base frame.
    truths: Vec<(u64, [f64; 3])>,
    mode: u32,
    start: u64,
    heard: u64,
}

impl Simulated {
    /// The robot of `deployed`, asked to walk at `desired`, with its controller at the other end of `line` and its log at `log`.
    ///
    /// # Errors
    /// When robot and engine do not fit, or the log cannot be made.
    pub fn new(deployed: &Deployed, desired: [f32; 3], seed: u64, line: Line, log: &Path) -> miette::Result<Self> {
        let config = &deployed.settings.env;
        let mut plant = Plant::new(&deployed.robot, config, seed)?;
        let latency = plant.draw_latency();
        let report = Report {
            latency,
            jitter: if config.latency.enabled {
                config.latency.jitter
            } else {
                0.0
            },
            ..Report::default()
        };
        Ok(Self {
            record: Record::create(log, &deployed.robot)?,
            // The newest reading has waited for half a physics step when the controller takes it, and the targets wait for as
            // long until the physics takes them.
            latency: ((latency - config.physics_dt()).max(0.0) * 1e9) as u64,
            jitter: 0,
            plant,
            report,
            dt: (config.physics_dt() * 1e9).round() as u64,
            substeps: u64::from(config.substeps()),
            underway: VecDeque::new(),
            truths: Vec::new(),
            mode: u32::MAX,
            start: now(),
            heard: now(),
            line,
            desired,
        })
    }

    /// Lives for `seconds`, or until `stop` is set, and reports. `tend` is called once a control step and gives the line to a
    /// controller that was started in place of one that died.
    ///
    /// # Errors
    /// What `tend` says, and when the log cannot be written.
    pub fn run(
        mut self,
        seconds: f64,
        stop: &AtomicBool,
        mut tend: impl FnMut() -> miette::Result<Option<Line>>,
    ) -> miette::Result<Report> {
        self.start = now();
        self.heard = self.start;
        let end = self.start + (seconds * 1e9) as u64;
        let (mut step, mut due, mut flushed) = (0u64, self.start, self.start);
        while now() < end && !stop.load(Ordering::Relaxed) {
            self.hear()?;
            self.deliver();
            let late = now().saturating_sub(due);
            if late > HOPELESS {
                self.report.physics_skipped += late / self.dt;
                due = now();
            }
            if now() >= due {
                let controls = step.is_multiple_of(self.substeps);
                self.sense(controls)?;
                if controls && let Some(line) = tend()? {
                    self.line = line;
                    self.report.restarts += 1;
                }
                if now() - flushed >= FLUSH {
                    flushed = now();
                    self.record.flush()?;
                }
                self.plant.step();
                step += 1;
                due += self.dt;
            }
            let arrival = self.underway.front().map_or(due, |(arrival, _)| *arrival);
            sleep_until(due.min(arrival));
        }
        let ended = now();
        self.silence(ended);
        self.report.seconds = seconds.min((ended - self.start) as f64 * 1e-9);
        self.record.finish()?;
        Ok(self.report)
    }

    /// Takes the commands that have come; the servos get the newest.
    fn hear(&mut self) -> miette::Result<()> {
        while let Some(command) = self.line.receive::<Commanded>() {
            let time = now();
            let Some(&(measured, velocity)) = self.truths.get(command.sequence as usize) else {
                continue;
            };
            if command.targets.iter().any(|target| !target.is_finite()) {
                return Err(miette::miette!(
                    "the controller sent a target that is not a finite number"
                ));
            }
            self.silence(time);
            self.plant.set_targets(&command.targets);
            self.record.targets(time - self.start, &command.targets)?;
            let report = &mut self.report;
            report.commands += 1;
            report.deadline_misses += u64::from(command.late > 0.0);
            report.latencies.push((time - measured) as f64 * 1e-9);
            report.steps.push(command.duration as f64 * 1e-9);
            report.note((time - self.start) as f64 * 1e-9, command.mode, command.fault);
            report.out_of_range += u64::from(command.out_of_range > 0);
            self.mode = command.mode;
            if command.mode == WALKING && command.fault == 0 && report.fell.is_none() {
                let miss = |axis: usize| f64::from(command.velocity[axis]) - velocity[axis];
                report.walk.estimator.0 += (0..3).map(|axis| miss(axis).powi(2)).sum::<f64>();
                report.walk.estimator.1 += 1;
            }
        }
        Ok(())
    }

    /// Notes how long nothing was heard until `time`.
    fn silence(&mut self, time: u64) {
        let silence = time.saturating_sub(self.heard) as f64 * 1e-9;
        self.report.silence = self.report.silence.max(silence);
        self.heard = time;
    }

    /// Sends the readings whose time has come.
    fn deliver(&mut self) {
        while self.underway.front().is_some_and(|(arrival, _)| *arrival <= now()) {
            if let Some((_, measured)) = self.underway.pop_front() {
                // A controller that is gone is noticed by whoever tends it.
                let _ = self.line.send(&measured);
            }
        }
    }

    /// Measures; once a control step also judges the walk and writes the log.
    fn sense(&mut self, controls: bool) -> miette::Result<()> {
        let time = now();
        let truth = self.plant.truth();
        let since = time - self.start;
        if !self.plant.stands() && self.report.fell.is_none() {
            self.report.fell = Some(since as f64 * 1e-9);
        }
        if controls && self.mode == WALKING && self.report.fell.is_none() {
            let [along, left] = truth.velocity_along(truth.heading);
            let walk = &mut self.report.walk;
            walk.steps += 1;
            let sums = walk.velocity.iter_mut().zip([along, left, truth.vertical_turn]);
            sums.for_each(|(sum, x)| *sum += x);
        }
        self.truths.push((time, truth.velocity.into()));
        if controls {
            self.jitter = (self.plant.draw_jitter() * 1e9) as u64;
        }
        let (torques, base) = (self.plant.torques(), self.plant.base());
        let reading = self.plant.measure();
        if controls {
            self.record.reading(since, reading, torques, &base, self.desired)?;
            self.report.control_steps += 1;
        }
        let measured = Measured {
            sequence: self.truths.len() as u64 - 1,
            time,
            desired: self.desired,
            attitude: reading.attitude,
            gyro: reading.gyro,
            position: reading.position.clone(),
            velocity: reading.velocity.clone(),
        };
        // In the order in which they were made.
        let before = self.underway.back().map_or(0, |(arrival, _)| *arrival);
        self.underway
            .push_back(((time + self.latency + self.jitter).max(before), measured));
        self.report.readings += 1;
        Ok(())
    }
}
