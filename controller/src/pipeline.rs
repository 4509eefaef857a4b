//! One robot's loop between two steps: what turns readings into observations and actions into joint targets.

use alloc::{vec, vec::Vec};
use core::f64::consts::{PI, TAU};

use libm::{remainder, roundf};
use serde::{Deserialize, Serialize};

use crate::{
    attitude::{level, up_from_fused, yaw_rate},
    estimator::base_velocity,
    filter::Filter,
    kinematics::{Sole, sole},
    math::{Vec3, is_finite, rotate_z},
    mirror::{mirror_joints, mirror_observation},
    number::Number,
    spec::{ActionLaw, Block, MirroredJoint, Spec, TRACKING_SECONDS},
    validate::SpecError,
};

/// Readings of one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors<'a> {
    /// Measured positions of the policy's joints, rad or m.
    pub position: &'a [f32],
    /// Measured velocities of the policy's joints, rad/s or m/s.
    pub velocity: &'a [f32],
    /// Fused roll and pitch of the base, rad.
    pub attitude: [f32; 2],
    /// Angular velocity of the base in the base frame, rad/s.
    pub gyro: [f32; 3],
    /// Velocity of the base origin in the base frame, m/s, to use instead of the estimate from the legs.
    pub base_velocity: Option<[f32; 3]>,
}

/// The inertial frame of thesis 7.3.1: gravity-aligned, at the base's heading of some moments ago.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct InertialFrame {
    /// Heading of the base in it, rad, in [-pi, pi]: the integrated rate of the fused yaw.
    heading: f64,
    /// Rate of the fused yaw in the previous step, rad/s.
    rate: f64,
    /// Steps since it was set; `None` before the first step.
    age: Option<u32>,
    /// Steps after which it is set again.
    period: u32,
}

impl InertialFrame {
    fn advance(&mut self, rate: f64, dt: f64) {
        let rate = if rate.is_finite() { rate } else { self.rate };
        match self.age.map(|age| age + 1) {
            Some(age) if age < self.period => {
                let heading = self.heading + (0.5 * self.rate + 0.5 * rate) * dt;
                let heading = if heading.abs() <= PI {
                    heading
                } else {
                    remainder(heading, TAU)
                };
                self.heading = if heading.is_finite() { heading } else { self.heading };
                self.age = Some(age);
            }
            _ => (self.heading, self.age) = (0.0, Some(0)),
        }
        self.rate = rate;
    }
}

/// The state of one robot's control loop between steps. Build it once per robot, [`reset`](Self::reset) it at the
/// start of an episode, then alternate [`observe`](Self::observe) and [`decode`](Self::decode), each once a step.
///
/// Everything it remembers is in its serialised form: a loop restored from it goes on with the same bits. The spec handed to
/// each method must be the one it was built from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pipeline {
    frame: InertialFrame,
    /// Estimated velocity of the base, inertial and base frame, m/s.
    velocity: [Vec3<f64>; 2],
    /// By the readings of the last step.
    soles: Vec<Sole>,
    desired: Vec3,
    commanded: Vec3,
    /// Mean of what the velocity lacks to the commanded one, level, at the base's heading.
    tracking_error: Vec3<f64>,
    clock_phase: f32,
    filter: Option<Filter>,
    /// Measured positions of the last observation; the last finite reading of each joint.
    measured: Vec<f32>,
    previous_target: Vec<f32>,
}

impl Pipeline {
    /// Whether every list is as long as in `own`, which was made for the same specification, and joints and targets are somewhere: what was
    /// read from a file may be another's.
    pub fn has_shape_of(&self, own: &Self) -> bool {
        let lengths = |pipeline: &Self| {
            let channels = pipeline.filter.as_ref().map(Filter::channels);
            let lists = [
                pipeline.soles.len(),
                pipeline.measured.len(),
                pipeline.previous_target.len(),
            ];
            (lists, channels)
        };
        let mut places = self.measured.iter().chain(&self.previous_target);
        lengths(self) == lengths(own) && places.all(|place| place.is_finite())
    }

    /// A loop for `spec`, reset to clock phase 0.
    ///
    /// # Errors
    /// What [`Spec::validate`] finds.
    pub fn new(spec: &Spec) -> Result<Self, SpecError> {
        spec.validate()?;
        let joints = spec.joints.len();
        let period = roundf(spec.inertial_frame_period * spec.control_hz).max(1.0);
        let mut pipeline = Self {
            // The cast saturates: an infinite period is never reached.
            frame: InertialFrame {
                heading: 0.0,
                rate: 0.0,
                age: None,
                period: period as u32,
            },
            velocity: [[0.0; 3]; 2],
            soles: vec![Sole::default(); spec.legs.len()],
            desired: [0.0; 3],
            commanded: [0.0; 3],
            tracking_error: [0.0; 3],
            clock_phase: 0.0,
            filter: spec
                .action
                .filter
                .map(|filter| Filter::new(filter, spec.control_hz, joints)),
            measured: vec![0.0; joints],
            previous_target: vec![0.0; joints],
        };
        pipeline.reset(spec, 0.0);
        Ok(pipeline)
    }

    /// Starts an episode: the clock at `clock_phase` (cycles; 0 to 1), the commanded velocity at zero, the previous
    /// targets at the nominal pose, the inertial frame and the action filter at whatever the first step brings.
    pub fn reset(&mut self, spec: &Spec, clock_phase: f32) {
        self.frame = InertialFrame {
            heading: 0.0,
            rate: 0.0,
            age: None,
            period: self.frame.period,
        };
        self.velocity = [[0.0; 3]; 2];
        self.soles.fill(Sole::default());
        self.desired = [0.0; 3];
        self.commanded = [0.0; 3];
        self.tracking_error = [0.0; 3];
        self.clock_phase = wrap(clock_phase);
        if let Some(filter) = &mut self.filter {
            filter.reset();
        }
        for (i, joint) in spec.joints.iter().enumerate() {
            self.measured[i] = joint.nominal;
            self.previous_target[i] = joint.nominal;
        }
    }

    /// Sets the commanded velocity (m/s, m/s, rad/s), clipped to the spec's bounds, from which the ramp goes on: for
    /// episodes that start in motion.
    pub fn set_commanded(&mut self, spec: &Spec, commanded: [f32; 3]) {
        self.commanded = clip_velocity(spec, commanded, self.commanded);
        self.desired = self.commanded;
    }

    /// Takes the readings of a step and the desired velocity (m/s, m/s, rad/s; clipped to the spec's bounds), advances
    /// estimator, inertial frame and command ramp, and writes the observation.
    ///
    /// Readings are passed on as they are, so a reading that is not finite shows in its entry; the memory
    /// keeps the last finite value instead and stays finite.
    ///
    /// # Panics
    /// When `sensors.position`, `sensors.velocity` or `out` do not have the spec's lengths.
    pub fn observe(&mut self, spec: &Spec, sensors: &Sensors, desired: [f32; 3], out: &mut [f32]) {
        let up = self.take_in(spec, sensors);
        for (state, leg) in self.soles.iter_mut().zip(&spec.legs) {
            let of = |values: &'_ [f32], joint: usize| f64::from(values[joint]);
            *state = sole(leg, |j| of(sensors.position, j), |j| of(sensors.velocity, j));
        }
        let estimate = base_velocity(&self.soles, sensors.gyro.map(f64::from), up, self.velocity[1]);
        self.give_out(spec, sensors, up, estimate, desired, out);
    }

    /// Remembers the readings and advances the inertial frame; returns the unit vector against gravity in the base frame.
    pub(crate) fn take_in(&mut self, spec: &Spec, sensors: &Sensors) -> Vec3<f64> {
        assert_eq!(
            sensors.position.len(),
            spec.joints.len(),
            "one position for each policy joint"
        );
        assert_eq!(
            sensors.velocity.len(),
            spec.joints.len(),
            "one velocity for each policy joint"
        );
        for (measured, &position) in self.measured.iter_mut().zip(sensors.position) {
            if position.is_finite() {
                *measured = position;
            }
        }
        let up = up_from_fused(sensors.attitude);
        let rate = yaw_rate(sensors.gyro.map(f64::from), up);
        self.frame.advance(rate, 1.0 / f64::from(spec.control_hz));
        up
    }

    /// Takes over the velocity `estimate` of the base (base frame, m/s), advances the ramp and writes the observation.
    pub(crate) fn give_out(
        &mut self,
        spec: &Spec,
        sensors: &Sensors,
        up: Vec3<f64>,
        estimate: Option<Vec3<f64>>,
        desired: [f32; 3],
        out: &mut [f32],
    ) {
        let given = sensors.base_velocity.map(|velocity| velocity.map(f64::from));
        let given = given.filter(|velocity| is_finite(&single(*velocity)));
        if let Some(base) = given.or(estimate) {
            let inertial = rotate_z(self.frame.heading, level(up, base));
            if is_finite(&single(inertial)) && is_finite(&single(base)) {
                self.velocity = [inertial, base];
            }
        }
        self.ramp(spec, desired);
        self.track(spec, up);
        self.write(spec, sensors, out);
        if let Some(joints) = self.mirror(spec) {
            mirror_observation(spec, joints, out);
        }
    }

    /// The soles of [`Self::soles`], to be set by who computes them.
    pub(crate) fn soles_mut(&mut self) -> &mut [Sole] {
        &mut self.soles
    }

    /// Turns an action in [0, 1] into joint targets (rad or m) by the spec's filter and law, with the positions of the last
    /// [`observe`](Self::observe) as the measured ones, then advances the clock.
    ///
    /// Targets are always finite and within the joint limits. Actions are clipped to [0, 1]; if any of them is not a
    /// number all joints keep their previous targets and the filter its state.
    ///
    /// # Panics
    /// When `action` or `targets` do not have one entry for each policy joint.
    pub fn decode(&mut self, spec: &Spec, action: &[f32], targets: &mut [f32]) {
        assert_eq!(action.len(), spec.joints.len(), "one action for each policy joint");
        assert_eq!(targets.len(), spec.joints.len(), "one target for each policy joint");
        if action.iter().any(|a| a.is_nan()) {
            targets.copy_from_slice(&self.previous_target);
        } else {
            for (u, a) in targets.iter_mut().zip(action) {
                *u = 2.0 * a.clamp(0.0, 1.0) - 1.0;
            }
            if let Some(joints) = self.mirror(spec) {
                mirror_joints(joints, targets);
            }
            if let Some(filter) = &mut self.filter {
                filter.apply(targets);
            }
            for (i, target) in targets.iter_mut().enumerate() {
                *target = self.target(spec, i, *target);
            }
            self.previous_target.copy_from_slice(targets);
        }
        if let Some(clock) = spec.clock {
            self.clock_phase = wrap(self.clock_phase + 1.0 / (spec.control_hz * clock.period));
        }
    }

    /// Commanded velocity after the last step, m/s, m/s, rad/s.
    pub fn commanded(&self) -> [f32; 3] {
        self.commanded
    }

    /// Desired velocity of the last step after clipping, m/s, m/s, rad/s.
    pub fn desired(&self) -> [f32; 3] {
        self.desired
    }

    /// Phase of the clock in cycles, 0 to 1; the first half is the swing of leg 0.
    pub fn clock_phase(&self) -> f32 {
        self.clock_phase
    }

    /// The leg the clock has in swing and how far its swing is, 0 to 1; `None` without a clock.
    pub fn clock_swing(&self, spec: &Spec) -> Option<(usize, f32)> {
        spec.clock.map(|_| {
            let half = 2.0 * self.clock_phase;
            if half < 1.0 { (0, half) } else { (1, half - 1.0) }
        })
    }

    /// Whether the policy sees and moves the robot's mirror image in this step.
    pub fn is_mirrored(&self, spec: &Spec) -> bool {
        self.mirror(spec).is_some()
    }

    /// The mirror the policy looks into in this step: a symmetric policy in the second half of the clock's cycle.
    fn mirror<'a>(&self, spec: &'a Spec) -> Option<&'a [MirroredJoint]> {
        spec.symmetry.as_deref().filter(|_| self.clock_phase >= 0.5)
    }

    /// Velocity of the base origin in the base frame after the last step, m/s.
    pub(crate) fn base_velocity(&self) -> Vec3<f64> {
        self.velocity[1]
    }

    /// Velocity of the base origin as observed in the last step, m/s: in the inertial and in the base frame.
    pub fn velocity(&self) -> ([f32; 3], [f32; 3]) {
        (single(self.velocity[0]), single(self.velocity[1]))
    }

    /// The feet in the order of the spec's legs, relative to the base by the readings of the last step.
    pub fn soles(&self) -> &[Sole] {
        &self.soles
    }

    /// Heading of the base in the inertial frame, rad, in [-pi, pi].
    pub fn heading(&self) -> f32 {
        self.frame.heading as f32
    }

    /// True if the inertial frame was set to the base's heading in the last [`observe`](Self::observe), as in the first
    /// of an episode.
    pub fn frame_was_set(&self) -> bool {
        self.frame.age == Some(0)
    }

    /// Targets of the last [`decode`](Self::decode), rad or m; the nominal pose before the first.
    pub fn previous_target(&self) -> &[f32] {
        &self.previous_target
    }

    fn ramp(&mut self, spec: &Spec, desired: [f32; 3]) {
        self.desired = clip_velocity(spec, desired, self.desired);
        for axis in 0..3 {
            let step = spec.command.rate[axis] / spec.control_hz;
            self.commanded[axis] += (self.desired[axis] - self.commanded[axis]).clamp(-step, step);
        }
    }

    /// Goes on with the mean of the tracking error.
    fn track(&mut self, spec: &Spec, up: Vec3<f64>) {
        let [x, y, _] = level(up, self.velocity[1]);
        let measured = [x, y, self.frame.rate];
        let gain = f64::from(1.0 / (TRACKING_SECONDS * spec.control_hz)).min(1.0);
        let axes = self.commanded.iter().zip(measured);
        for (mean, (commanded, measured)) in self.tracking_error.iter_mut().zip(axes) {
            let next = *mean + gain * (f64::from(*commanded) - measured - *mean);
            if (next as f32).is_finite() {
                *mean = next;
            }
        }
    }

    fn write(&self, spec: &Spec, sensors: &Sensors, out: &mut [f32]) {
        assert_eq!(out.len(), spec.observation_len(), "the observation's length");
        let (sin, cos) = Number::sin_cos(TAU * f64::from(self.clock_phase));
        let mut rest = out;
        for &block in &spec.observation {
            let (entries, tail) = rest.split_at_mut(spec.block_len(block));
            rest = tail;
            match block {
                Block::JointPosition => entries.copy_from_slice(sensors.position),
                Block::JointVelocity => entries.copy_from_slice(sensors.velocity),
                Block::Attitude => entries.copy_from_slice(&sensors.attitude),
                Block::Gyro => entries.copy_from_slice(&sensors.gyro),
                Block::VelocityInertial => entries.copy_from_slice(&single(self.velocity[0])),
                Block::VelocityBase => entries.copy_from_slice(&single(self.velocity[1])),
                Block::DesiredVelocity => entries.copy_from_slice(&self.desired),
                Block::CommandedVelocity => entries.copy_from_slice(&self.commanded),
                Block::Clock => entries.copy_from_slice(&[sin as f32, cos as f32]),
                Block::TrackingError => entries.copy_from_slice(&single(self.tracking_error)),
                Block::PreviousTarget => {
                    for ((entry, target), joint) in entries.iter_mut().zip(&self.previous_target).zip(&spec.joints) {
                        *entry = target - joint.nominal;
                    }
                }
            }
        }
    }

    /// The target of joint `i` for the filtered action `u`, which a second-order filter can carry slightly over its bound.
    fn target(&self, spec: &Spec, i: usize, u: f32) -> f32 {
        let joint = &spec.joints[i];
        let base = match spec.action.law {
            ActionLaw::IncrementOnMeasured => self.measured[i],
            ActionLaw::IncrementOnTarget => self.previous_target[i],
            ActionLaw::OffsetFromNominal => joint.nominal,
        };
        let mut target = base + joint.action_scale * u.clamp(-1.0, 1.0);
        if spec.action.torque_clamp {
            let reach = joint.torque_limit / joint.kp;
            target = target.clamp(self.measured[i] - reach, self.measured[i] + reach);
        }
        target.clamp(joint.lower, joint.upper)
    }
}

/// `velocity` within the spec's bounds; axes that are not a number stay at `held`.
fn clip_velocity(spec: &Spec, velocity: Vec3, held: Vec3) -> Vec3 {
    core::array::from_fn(|axis| {
        let value = if velocity[axis].is_nan() {
            held[axis]
        } else {
            velocity[axis]
        };
        value.clamp(spec.command.lower[axis], spec.command.upper[axis])
    })
}

/// What is observed of a vector that is remembered in double precision.
fn single(v: Vec3<f64>) -> Vec3 {
    v.map(|x| x as f32)
}

/// The fraction of a cycle in [0, 1).
fn wrap(phase: f32) -> f32 {
    let fraction = phase - libm::floorf(phase);
    if fraction < 1.0 { fraction } else { 0.0 }
}

#[cfg(test)]
mod tests;
