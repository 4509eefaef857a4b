//! The controller of a robot: a policy in its loop, and what it does when readings are late, missing or absurd.
//!
//! ```text
//!            fault                after HOLD_SECONDS                at the nominal pose
//! walking ----------> holding ------------------------> ramping ------------------------> resting
//!    ^  <------------    |                                                                   |
//!    |      readings are good again                                                          |
//!    +------------------------------ readings were good for RECOVERY_SECONDS, then a reset --+
//! ```
//!
//! A fault is a reading that is stale, not finite or that no working sensor gives ([`Fault::Absurd`]), or a fall; after a fall
//! only [`Controller::reset`] and [`Controller::take_over`] lead back to walking. Resting goes on while a joint is farther from the
//! nominal pose than a quarter of its range: it did not follow. A pause of more than HOLD_SECONDS between two steps leads to the
//! ramp as well: the servos held the last targets for as long. Readings that no fault tells from good ones are bounded to what training
//! saw before the policy sees them. Targets are finite and within the joint limits in every state and for every input.

mod readings;
mod status;

pub use status::{Command, Fault, Mode, Reading, Sentence, Status};

use crate::{
    actor::Inference,
    pipeline::{Pipeline, Sensors},
    policy::{Policy, PolicyError},
    spec::Spec,
    walker::Walker,
};

/// How long the last targets are held, s: about the time `sqrt(height / gravity)` in which a humanoid topples, beyond which
/// the pose of an interrupted step is no better than another.
pub const HOLD_SECONDS: f32 = 0.25;

/// Time in which the ramp to the nominal pose moves a joint through its whole range, s: slow enough to step back from.
pub const RAMP_SECONDS: f32 = 4.0;

/// How long readings must be good before a robot at rest walks again, s.
pub const RECOVERY_SECONDS: f32 = 0.5;

/// Control periods by which a reading may be older than the largest latency of training: one since it was due, one for a
/// message that was lost.
pub const STALE_PERIODS: f32 = 2.0;

/// A policy in its loop on a robot. Nothing allocates after [`Controller::new`].
#[derive(Clone, Debug)]
pub struct Controller {
    walker: Walker,
    mode: Mode,
    fallen: bool,
    /// Whether nobody knows yet where the joints are: a takeover began with positions that cannot be believed.
    lost: bool,
    /// Whether a first step has been since the reset.
    begun: bool,
    /// Time of the last step that was due, ns.
    last: u64,
    /// When the next is due, ns.
    due: u64,
    /// Since when the mode is what it is, or while resting since when readings are good, ns.
    since: u64,
    period: u64,
    stale_after: u64,
    targets: alloc::vec::Vec<f32>,
}

impl Controller {
    /// A loop for `policy`, reset to the phase of its clock.
    ///
    /// # Errors
    /// Those of [`Policy::new`]; none for a policy that was built or loaded.
    pub fn new(policy: &Policy) -> Result<Self, PolicyError> {
        Ok(Self::around(Walker::new(policy)?, policy))
    }

    /// [`Controller::new`] with [`Inference::portable`].
    ///
    /// # Errors
    /// As above.
    pub fn portable(policy: &Policy) -> Result<Self, PolicyError> {
        let inference = Inference::portable(&policy.actor)?;
        Ok(Self::around(Walker::with_inference(policy, inference)?, policy))
    }

    fn around(walker: Walker, policy: &Policy) -> Self {
        let spec = walker.spec();
        let period = 1.0 / spec.control_hz;
        let mut controller = Self {
            mode: Mode::Resting,
            fallen: false,
            lost: false,
            begun: false,
            last: 0,
            due: 0,
            since: 0,
            period: nanoseconds(period),
            stale_after: nanoseconds(policy.identity().latency[1] + STALE_PERIODS * period),
            targets: spec.joints.iter().map(|joint| joint.nominal).collect(),
            walker,
        };
        controller.reset(controller.reset_phase());
        controller
    }

    /// Phase of the clock, cycles, that the policy begins with; 0 without a clock.
    pub fn reset_phase(&self) -> f32 {
        self.walker.spec().clock.map_or(0.0, |clock| clock.reset_phase)
    }

    /// Starts an episode with the clock at `clock_phase`, see [`Pipeline::reset`]; a fall is forgotten. The robot should stand in
    /// the nominal pose.
    pub fn reset(&mut self, clock_phase: f32) {
        self.forget(clock_phase);
        self.mode = Mode::Walking;
        for (target, joint) in self.targets.iter_mut().zip(&self.walker.spec().joints) {
            *target = joint.nominal;
        }
    }

    /// What was before, but for the targets.
    fn forget(&mut self, clock_phase: f32) {
        self.walker.reset(clock_phase);
        (self.fallen, self.lost, self.begun) = (false, false, false);
    }

    /// Starts with a robot in whatever pose, its joints at `position` (rad or m): ramps to the nominal pose, rests, then walks
    /// from the start of an episode. A fall is forgotten.
    ///
    /// Positions that are not finite or beyond a joint's limits ([`Fault::Absurd`]) are not believed. Then nothing is known to
    /// ramp from, so no target is safe to send to servos that are on: steps hold what was told last, with the fault, and the
    /// takeover begins with the first step whose readings are good.
    ///
    /// # Errors
    /// [`Fault::NotFinite`] or [`Fault::Absurd`] with the first such joint.
    ///
    /// # Panics
    /// When the length is not the spec's.
    pub fn take_over(&mut self, position: &[f32]) -> Result<(), Fault> {
        assert_eq!(position.len(), self.targets.len(), "one position for each joint");
        self.forget(self.reset_phase());
        match readings::judge_positions(self.walker.spec(), position) {
            None => {
                self.begin_ramp(position);
                Ok(())
            }
            Some(fault) => {
                self.mode = Mode::Holding;
                self.lost = true;
                Err(fault)
            }
        }
    }

    /// Ramps from `position`, which was judged.
    fn begin_ramp(&mut self, position: &[f32]) {
        self.lost = false;
        self.mode = Mode::Ramping;
        let joints = self.walker.spec().joints.iter().zip(position);
        for (target, (joint, &position)) in self.targets.iter_mut().zip(joints) {
            *target = position.clamp(joint.lower, joint.upper);
        }
    }

    /// One step, to be made once a control period: writes the joint targets (rad or m, finite and within limits).
    ///
    /// `now` and `measured` are the time of the step and of its readings, ns on one clock that does not jump. `desired` is the
    /// desired velocity (m/s, m/s, rad/s). A step that comes too soon changes nothing; one that comes late is made and said to
    /// be late.
    ///
    /// # Panics
    /// When a length is not the spec's.
    pub fn step(
        &mut self,
        now: u64,
        measured: u64,
        sensors: &Sensors,
        desired: [f32; 3],
        targets: &mut [f32],
    ) -> Status {
        let mut status = Status {
            mode: self.mode,
            fault: None,
            out_of_range: None,
            command: self.judge_command(desired),
            late: 0.0,
        };
        if self.begun && now < self.last.saturating_sub(self.period) {
            // A clock that went back, against what was agreed: times before are worth nothing. By less it is a step too soon.
            (self.begun, self.since) = (false, now);
        }
        if self.begun && now < self.due.saturating_sub(self.period / 2) {
            status.fault = Some(Fault::OverRate);
            targets.copy_from_slice(&self.targets);
            return status;
        }
        let elapsed = if self.begun { now.saturating_sub(self.last) } else { 0 };
        status.late = self.schedule(now);
        if status.late > HOLD_SECONDS && matches!(self.mode, Mode::Walking | Mode::Holding) && !self.lost {
            self.mode = Mode::Ramping;
        }
        status.fault = self.find_fault(now, measured, sensors);
        match status.fault {
            None => self.go_on(now, sensors, desired),
            Some(_) => self.fall_back(now, elapsed),
        }
        status.mode = self.mode;
        status.out_of_range = self.walker.out_of_range().filter(|_| self.mode == Mode::Walking);
        targets.copy_from_slice(&self.targets);
        status
    }

    /// Notes the step and when the next is due; returns how late this one is, s.
    fn schedule(&mut self, now: u64) -> f32 {
        let late = now.saturating_sub(self.due);
        let pause = now.saturating_sub(self.last);
        self.last = now;
        let first = !core::mem::replace(&mut self.begun, true);
        if first || late > self.period / 2 && pause <= self.period + self.period / 16 {
            // It keeps the pace, on a beat of its own.
            self.due = now.saturating_add(self.period);
            return 0.0;
        }
        // The beat is kept from step to step, so that a loop that runs a little too fast is noticed, and over a step that is late,
        // because many loops make the next on their own beat again.
        let missed = if late > self.period / 2 { late / self.period } else { 0 };
        self.due = self.due.saturating_add((missed + 1).saturating_mul(self.period));
        if late > self.period / 2 {
            late as f32 * 1e-9
        } else {
            0.0
        }
    }

    fn find_fault(&mut self, now: u64, measured: u64, sensors: &Sensors) -> Option<Fault> {
        let (age, lead) = (now.saturating_sub(measured), measured.saturating_sub(now));
        if age > self.stale_after || lead > self.period {
            let age = (age as f32 - lead as f32) * 1e-9;
            return Some(Fault::Stale { age });
        }
        if let Some(fault) = readings::judge(self.walker.spec(), sensors) {
            return Some(fault);
        }
        let upright = self.walker.spec().upright;
        let beyond = |axis: usize| libm::fabsf(sensors.attitude[axis]) > upright[axis];
        self.fallen |= beyond(0) || beyond(1);
        self.fallen.then_some(Fault::Fallen)
    }

    /// With good readings.
    fn go_on(&mut self, now: u64, sensors: &Sensors, desired: [f32; 3]) {
        if self.lost {
            self.begin_ramp(sensors.position);
            return;
        }
        match self.mode {
            Mode::Walking | Mode::Holding => self.mode = Mode::Walking,
            // What was begun is finished: the policy starts from the pose it knows.
            Mode::Ramping => self.ramp(now, self.period),
            // A servo that is off, or hangs somewhere, does not go where it is told.
            Mode::Resting if !self.walker.spec().is_near_nominal(sensors.position) => self.since = now,
            Mode::Resting if now.saturating_sub(self.since) >= nanoseconds(RECOVERY_SECONDS) => {
                self.walker.reset(self.reset_phase());
                self.mode = Mode::Walking;
            }
            Mode::Resting => {}
        }
        if self.mode == Mode::Walking {
            self.walker.step(sensors, desired, &mut self.targets);
        }
    }

    fn fall_back(&mut self, now: u64, elapsed: u64) {
        if self.lost {
            return;
        }
        match self.mode {
            Mode::Walking => (self.mode, self.since) = (Mode::Holding, now),
            Mode::Holding if now.saturating_sub(self.since) >= nanoseconds(HOLD_SECONDS) => self.mode = Mode::Ramping,
            Mode::Holding => {}
            Mode::Ramping => self.ramp(now, elapsed),
            Mode::Resting => self.since = now,
        }
        if self.mode == Mode::Holding {
            self.walker.hold(&mut self.targets);
        }
    }

    /// Moves the targets towards the nominal pose, as far as `elapsed` ns allow.
    fn ramp(&mut self, now: u64, elapsed: u64) {
        // After a pause the ramp goes on as if there had been none.
        let share = elapsed.min(2 * self.period) as f32 * 1e-9 / RAMP_SECONDS;
        let mut arrived = true;
        for (target, joint) in self.targets.iter_mut().zip(&self.walker.spec().joints) {
            let step = share * (joint.upper - joint.lower);
            *target += (joint.nominal - *target).clamp(-step, step);
            *target = target.clamp(joint.lower, joint.upper);
            arrived &= *target == joint.nominal;
        }
        if arrived {
            (self.mode, self.since) = (Mode::Resting, now);
        }
    }

    fn judge_command(&self, desired: [f32; 3]) -> Command {
        let trained = self.walker.trained();
        let inside = |axis: usize| desired[axis] >= trained.lower[axis] && desired[axis] <= trained.upper[axis];
        if desired.iter().any(|x| x.is_nan()) {
            Command::NotFinite
        } else if (0..3).all(inside) {
            Command::Taken
        } else {
            Command::Clipped
        }
    }

    /// The action for an observation alone, without advancing the loop.
    ///
    /// # Panics
    /// When a length is not the spec's.
    pub fn act(&mut self, observation: &[f32], action: &mut [f32]) {
        self.walker.act(observation, action);
    }

    /// The observation of the last step of the policy, before bounds, as the policy sees it: mirrored in the second half of a
    /// symmetric policy's cycle.
    pub fn observation(&self) -> &[f32] {
        self.walker.observation()
    }

    /// The action of the last step of the policy; not a number while the targets were held.
    pub fn action(&self) -> &[f32] {
        self.walker.action()
    }

    /// The loop's memory: commanded velocity, clock, estimated velocity.
    pub fn pipeline(&self) -> &Pipeline {
        self.walker.pipeline()
    }

    /// What observation and action mean.
    pub fn spec(&self) -> &Spec {
        self.walker.spec()
    }

    /// The control period, ns.
    pub fn period(&self) -> u64 {
        self.period
    }

    /// Name of the instruction set the network runs with.
    pub fn instruction_set(&self) -> &'static str {
        self.walker.instruction_set()
    }
}

/// The cast saturates: what is too long never comes.
fn nanoseconds(seconds: f32) -> u64 {
    (f64::from(seconds) * 1e9) as u64
}

#[cfg(test)]
mod tests;
