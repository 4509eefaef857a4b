//! One environment: what happens around one world between two actions.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use omniwalk_controller::attitude::fused_from_orientation;
use omniwalk_controller::{Pipeline, Sensors};
use serde::{Deserialize, Serialize};

use super::command::CommandRange;
use super::gait::{Gait, GaitMeter, Sole};
use super::reward::{Factors, Judged, Motion, Swing, Terms, foot_error};
use super::shared::Shared;
use super::tracking::{Tracking, TrackingMeter};
use crate::actuators::Actuators;
use crate::engine::{BaseState, Engine, Start, World};
use crate::error::EnvError;
use crate::random::Stream;
use crate::robot::{Kinematics, Robot};
use crate::sensors::{History, Reading};

/// How an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum End {
    /// The base came too low or tilted too far.
    Fallen,
    /// The legs passed through each other.
    Overlap,
    /// The time was over; the robot had not fallen.
    TimeOut,
    /// The physics went non-finite; nothing of the last step reaches the learner.
    Lost,
}

/// A finished episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Index of the environment in its batch.
    pub environment: usize,
    /// How it ended.
    pub end: End,
    /// Length in control steps.
    pub steps: u32,
    /// Reward by term, summed over the episode.
    pub terms: Terms,
    /// The desired velocity at the end (m/s, m/s, rad/s).
    pub desired: [f64; 3],
    /// How the robot walked.
    pub gait: Gait,
    /// Touchdowns per second of each foot.
    pub touchdowns_per_second: Vec<f64>,
    /// How well it held the command.
    pub tracking: Option<Tracking>,
    /// Mean magnitude of the policy joints' torques, N m.
    pub torque: f64,
    /// Mean square change of the targets per step, in half ranges of the action.
    pub action_change: f64,
    /// Mean error of the estimated base velocity, m/s.
    pub estimator_error: f64,
    /// Horizontal distance from the start, m.
    pub drift: f64,
}

/// Everything an environment remembers; serialisable, so that a resumed run goes on with the same bits.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Environment {
    index: usize,
    episode: u64,
    stream: Stream,
    pipeline: Pipeline,
    history: History,
    range: CommandRange,
    desired: [f64; 3],
    until_draw: u32,
    step: u32,
    length: u32,
    /// Factor on each joint's response in this episode (equation 7.14).
    response: Vec<f64>,
    targets: Vec<f32>,
    previous_targets: Vec<f32>,
    action_change: f64,
    /// True heading at which the inertial frame was set last, rad.
    heading: f64,
    motion: Motion,
    swing: Swing,
    push_steps: u32,
    soles: Vec<Sole>,
    gait: GaitMeter,
    tracking: TrackingMeter,
    sums: Sums,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Sums {
    terms: Terms,
    torque: f64,
    action_change: f64,
    estimator_error: f64,
    start: [f64; 2],
    position: [f64; 2],
}

/// Scratch one batch shares between its environments.
pub struct Scratch {
    /// Link poses of the world looked at last.
    pub kinematics: Kinematics,
    positions: Vec<f64>,
    start: Start,
    world: World,
}

impl Scratch {
    /// Scratch for `shared`'s robot.
    pub fn new(shared: &Shared) -> Self {
        let robot = &shared.robot;
        Self {
            kinematics: Kinematics::new(robot),
            positions: robot.nominal(),
            start: Start::nominal(robot),
            world: shared.nominal.clone(),
        }
    }
}

/// What one control step gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Reward by term.
    pub terms: Terms,
    /// The end of the episode, if it ended.
    pub end: Option<End>,
}

impl Environment {
    /// Environment `index` before its first episode.
    ///
    /// # Errors
    /// [`EnvError::Layout`] when the layout is not one the controller can run.
    pub fn new(shared: &Shared, index: usize) -> Result<Self, EnvError> {
        let joints = shared.robot.policy.len();
        let command = &shared.config.command;
        Ok(Self {
            index,
            episode: 0,
            stream: Stream::new(shared.seed, index as u64, 0),
            pipeline: Pipeline::new(&shared.spec).map_err(|error| EnvError::Layout(error.to_string()))?,
            history: History::new(joints, shared.longest_latency()),
            range: CommandRange {
                lower: command.lower,
                upper: command.upper,
                zero_share: command.zero_share,
                axis_share: command.axis_share,
            },
            desired: [0.0; 3],
            until_draw: 0,
            step: 0,
            length: 0,
            response: vec![1.0; joints],
            targets: vec![0.0; joints],
            previous_targets: vec![0.0; joints],
            action_change: 0.0,
            heading: 0.0,
            motion: Motion::default(),
            swing: Swing::default(),
            push_steps: 0,
            soles: vec![Sole::default(); shared.robot.feet.len()],
            gait: GaitMeter::new(shared.robot.feet.len(), shared.weight),
            tracking: TrackingMeter::new(shared.config.engine.control_hz as usize),
            sums: Sums::default(),
        })
    }

    /// Where desired velocities are drawn from, from the next draw on.
    pub fn set_range(&mut self, range: CommandRange) {
        self.range = range;
    }

    /// Sets the desired velocity (m/s, m/s, rad/s), from the next observation on and in later episodes.
    pub fn set_desired(&mut self, velocity: [f64; 3]) {
        self.range = CommandRange::fixed(velocity);
        self.desired = velocity;
    }

    /// The desired velocity.
    pub fn desired(&self) -> [f64; 3] {
        self.desired
    }

    /// The controller's state.
    pub fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// The targets of the last action in the policy's order, rad or m.
    pub fn targets(&self) -> &[f32] {
        &self.targets
    }

    /// The newest sensor reading, without latency.
    pub fn reading(&self) -> &Reading {
        self.history.newest()
    }

    /// The gait of the running episode.
    pub fn gait(&self) -> &GaitMeter {
        &self.gait
    }

    /// Starts an episode in `world` of `engine` and writes its first observation.
    pub fn reset(
        &mut self,
        shared: &Shared,
        engine: &mut dyn Engine,
        actuators: &mut Actuators,
        world: usize,
        scratch: &mut Scratch,
        observation: &mut [f32],
    ) {
        self.stream = Stream::new(shared.seed, self.index as u64, self.episode);
        self.draw_episode(shared);
        self.draw_start(shared, scratch);
        engine.reset(world, &scratch.start, &scratch.world);
        for (d, &position) in scratch.start.joints.iter().enumerate() {
            actuators.set_target(d, world, position);
        }
        let base = engine.base(world);
        self.look(shared, engine, world, &base, scratch);
        self.gait.reset(&self.soles);
        self.tracking.reset();
        self.heading = heading(&base.orientation);
        self.motion = Motion::default();
        self.sums = Sums::default();
        self.sums.start = [base.position.x, base.position.y];
        let phase = if self.stream.unit() < 0.5 { 0.0 } else { 0.5 };
        self.pipeline.reset(&shared.spec, phase);
        self.swing = Swing::default();
        let delay = shared.draw_latency(&mut self.stream);
        let Self { history, stream, .. } = self;
        history.reset(delay, |reading| measure(reading, shared, engine, world, &base, stream));
        self.observe(shared, &base, observation);
    }

    /// Sets the targets of the next control step from `action` in [0, 1] per joint.
    pub fn act(
        &mut self,
        shared: &Shared,
        engine: &mut dyn Engine,
        actuators: &mut Actuators,
        world: usize,
        action: &[f32],
    ) {
        self.previous_targets.copy_from_slice(&self.targets);
        self.pipeline.decode(&shared.spec, action, &mut self.targets);
        self.action_change = if self.step == 0 {
            0.0
        } else {
            self.target_change(shared)
        };
        let worlds = engine.worlds();
        for (i, &d) in shared.robot.policy.iter().enumerate() {
            let position = engine.joints().position[d * worlds + world];
            let (lower, upper) = shared.robot.policy_joint(i).limits;
            let target = position + self.response[i] * (f64::from(self.targets[i]) - position);
            actuators.set_target(d, world, target.clamp(lower, upper));
        }
        self.push(shared, engine, world);
    }

    /// Takes in the foot forces of one physics step of `dt` s.
    pub fn forces(&mut self, engine: &dyn Engine, world: usize, dt: f64) {
        for foot in 0..self.soles.len() {
            self.gait.force(foot, engine.foot_force(world, foot).z, dt);
        }
    }

    /// Ends a control step: measures, observes, judges. The observation is the final one if the episode ended.
    pub fn finish(
        &mut self,
        shared: &Shared,
        engine: &dyn Engine,
        world: usize,
        factors: Factors,
        scratch: &mut Scratch,
        observation: &mut [f32],
    ) -> Outcome {
        self.step += 1;
        if !engine.is_finite(world) {
            return Outcome {
                terms: Terms::default(),
                end: Some(End::Lost),
            };
        }
        let dt = shared.config.control_dt();
        let base = engine.base(world);
        self.look(shared, engine, world, &base, scratch);
        self.gait.soles(&self.soles, dt);
        self.redraw(shared);
        let Self { history, stream, .. } = self;
        history.record(|reading| measure(reading, shared, engine, world, &base, stream));
        self.observe(shared, &base, observation);
        let alive = standing(shared, &base);
        let terms = self.judge(shared, engine, world, &base, alive, factors);
        self.sums.terms.add(&terms);
        let overlap = || shared.config.task.end_on_overlap && shared.overlap.any(|link| scratch.kinematics.pose(link));
        let end = if !alive {
            Some(End::Fallen)
        } else if overlap() {
            Some(End::Overlap)
        } else {
            (self.step >= self.length).then_some(End::TimeOut)
        };
        Outcome { terms, end }
    }

    /// The record of the episode that ended with `end`; the next [`Environment::reset`] starts another.
    pub fn conclude(&mut self, end: End) -> Episode {
        self.episode += 1;
        let n = f64::from(self.step.max(1));
        let sums = &self.sums;
        Episode {
            environment: self.index,
            end,
            steps: self.step,
            terms: sums.terms,
            desired: self.desired,
            gait: self.gait.gait(),
            touchdowns_per_second: self.gait.touchdowns_per_second(),
            tracking: self.tracking.tracking(),
            torque: sums.torque / n,
            action_change: sums.action_change / n,
            estimator_error: sums.estimator_error / n,
            drift: (sums.position[0] - sums.start[0]).hypot(sums.position[1] - sums.start[1]),
        }
    }

    fn draw_episode(&mut self, shared: &Shared) {
        let config = &shared.config;
        let full = config.episode_steps();
        let stream = &mut self.stream;
        let share = stream.unit();
        self.length = if config.task.random_first_length && self.episode == 0 {
            1 + (share * f64::from(full)) as u32
        } else {
            full
        };
        self.desired = self.range.draw(stream);
        self.until_draw = self.draw_interval(shared);
        let epsilon = config.randomise.pd_noise;
        for response in &mut self.response {
            *response = self.stream.uniform(1.0 - epsilon, 1.0 + epsilon);
        }
        self.step = 0;
        self.push_steps = 0;
    }

    fn draw_start(&mut self, shared: &Shared, scratch: &mut Scratch) {
        shared.draw_world(&mut self.stream, &mut scratch.world);
        let robot = &shared.robot;
        let deviation = shared.config.randomise.start_position;
        for d in 0..robot.dofs.len() {
            let joint = robot.dof(d);
            let noise = if deviation > 0.0 {
                self.stream.normal(deviation)
            } else {
                0.0
            };
            scratch.start.joints[d] = (joint.nominal + noise).clamp(joint.limits.0, joint.limits.1);
        }
        // The lowest corner of the soles touches the ground.
        if deviation > 0.0 && !robot.feet.is_empty() {
            scratch
                .kinematics
                .set_pose(robot, &robot.base_pose, &scratch.start.joints);
            let lowest = soles(robot, &scratch.kinematics)
                .map(|sole| sole.lowest)
                .fold(f64::INFINITY, f64::min);
            scratch.start.position.z = robot.base_pose.translation.z - lowest;
        }
    }

    /// Steps until the next draw of the desired velocity, between half and one and a half times the mean.
    fn draw_interval(&mut self, shared: &Shared) -> u32 {
        let mean = shared.config.command.resample_seconds * f64::from(shared.config.engine.control_hz);
        let share = self.stream.uniform(0.5, 1.5);
        if mean > 0.0 {
            (share * mean).round().max(1.0) as u32
        } else {
            u32::MAX
        }
    }

    /// Mean square of the change of the targets, in half ranges of the action.
    fn target_change(&self, shared: &Shared) -> f64 {
        let pairs = self.targets.iter().zip(&self.previous_targets);
        let change = pairs.zip(&shared.spec.joints).map(|((new, old), joint)| {
            let share = f64::from((new - old) / joint.action_scale);
            share * share
        });
        change.sum::<f64>() / self.targets.len() as f64
    }

    fn redraw(&mut self, shared: &Shared) {
        self.until_draw -= 1;
        if self.until_draw == 0 {
            self.desired = self.range.draw(&mut self.stream);
            self.until_draw = self.draw_interval(shared);
        }
    }

    fn push(&mut self, shared: &Shared, engine: &mut dyn Engine, world: usize) {
        let push = &shared.config.push;
        if !push.enabled {
            return;
        }
        let dt = shared.config.control_dt();
        if self.push_steps > 0 {
            self.push_steps -= 1;
            if self.push_steps == 0 {
                engine.push(world, Vector3::zeros());
            }
        } else if self.stream.unit() < dt / push.interval {
            let angle = self.stream.uniform(0.0, std::f64::consts::TAU);
            let force = self.stream.uniform(0.0, push.force);
            engine.push(world, Vector3::new(force * angle.cos(), force * angle.sin(), 0.0));
            self.push_steps = (push.duration / dt).round().max(1.0) as u32;
        }
    }

    /// Link poses and soles of the true state.
    fn look(&mut self, shared: &Shared, engine: &dyn Engine, world: usize, base: &BaseState, scratch: &mut Scratch) {
        let worlds = engine.worlds();
        for (d, position) in scratch.positions.iter_mut().enumerate() {
            *position = engine.joints().position[d * worlds + world];
        }
        let pose = Isometry3::from_parts(Translation3::from(base.position), base.orientation);
        scratch.kinematics.set_pose(&shared.robot, &pose, &scratch.positions);
        for (out, sole) in self.soles.iter_mut().zip(soles(&shared.robot, &scratch.kinematics)) {
            *out = sole;
        }
    }

    fn observe(&mut self, shared: &Shared, base: &BaseState, observation: &mut [f32]) {
        let true_velocity = base.orientation.inverse() * base.linear_velocity;
        let reading = self.history.delayed();
        let sensors = Sensors {
            position: &reading.position,
            velocity: &reading.velocity,
            attitude: reading.attitude,
            gyro: reading.gyro,
            base_velocity: shared
                .config
                .observation
                .true_velocity
                .then(|| [true_velocity.x, true_velocity.y, true_velocity.z].map(|x| x as f32)),
        };
        self.pipeline
            .observe(&shared.spec, &sensors, self.desired.map(|x| x as f32), observation);
        if self.pipeline.frame_was_set() {
            self.heading = heading(&base.orientation);
        }
    }

    fn judge(
        &mut self,
        shared: &Shared,
        engine: &dyn Engine,
        world: usize,
        base: &BaseState,
        alive: bool,
        factors: Factors,
    ) -> Terms {
        let config = &shared.config.reward;
        let dt = shared.config.control_dt();
        let commanded = self.pipeline.commanded().map(f64::from);
        let motion = self.true_motion(base);
        let gain = if config.velocity_filter > 0.0 {
            dt / (config.velocity_filter + dt)
        } else {
            1.0
        };
        self.motion.follow(&motion, gain);
        let worlds = engine.worlds();
        let robot = &shared.robot;
        let pose_error = shared
            .pose_joints
            .iter()
            .map(|&i| {
                (engine.joints().position[robot.policy[i] * worlds + world] - robot.policy_joint(i).nominal).powi(2)
            })
            .sum::<f64>()
            .sqrt();
        let foot_error = self.foot_error(shared);
        let judged = Judged {
            motion: &self.motion,
            commanded,
            pose_error,
            alive,
            foot_error,
            action_change: self.action_change,
            slip: self.gait.slip_squared(),
        };
        let terms = judged.terms(config, factors, dt);
        self.measure_step(shared, engine, world, base, commanded);
        terms
    }

    fn true_motion(&self, base: &BaseState) -> Motion {
        let body = base.orientation.inverse() * base.linear_velocity;
        let inertial = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -self.heading) * base.linear_velocity;
        let turn = (base.orientation.inverse() * base.angular_velocity).z;
        Motion {
            base: [body.x, body.y],
            inertial: [inertial.x, inertial.y],
            turn,
        }
    }

    fn foot_error(&mut self, shared: &Shared) -> Option<f64> {
        let config = &shared.config.reward;
        let [left, right] = self.soles.as_slice() else {
            return None;
        };
        let share = if config.clock_swing {
            self.swing.by_clock(f64::from(self.pipeline.clock_phase()))
        } else {
            self.swing
                .by_height([left.centre[2], right.centre[2]], config.swing_hysteresis);
            1.0
        };
        let (swing, stance) = if self.swing.leg() == 0 {
            (left, right)
        } else {
            (right, left)
        };
        Some(foot_error(
            swing,
            stance,
            share * config.clearance,
            config.foot_height_weight,
        ))
    }

    fn measure_step(
        &mut self,
        shared: &Shared,
        engine: &dyn Engine,
        world: usize,
        base: &BaseState,
        commanded: [f64; 3],
    ) {
        let yaw = heading(&base.orientation);
        let v = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw) * base.linear_velocity;
        let reached = (0..3).all(|k| (commanded[k] - self.desired[k]).abs() < 1e-4);
        self.tracking
            .step([v.x, v.y, base.angular_velocity.z], commanded, reached);
        let (_, estimate) = self.pipeline.velocity();
        let truth = base.orientation.inverse() * base.linear_velocity;
        let miss = Vector3::new(estimate[0].into(), estimate[1].into(), estimate[2].into()) - truth;
        let worlds = engine.worlds();
        let torque: f64 = shared
            .robot
            .policy
            .iter()
            .map(|&d| engine.joints().torque[d * worlds + world].abs())
            .sum();
        let sums = &mut self.sums;
        sums.estimator_error += miss.norm();
        sums.torque += torque / shared.robot.policy.len() as f64;
        sums.action_change += self.action_change;
        sums.position = [base.position.x, base.position.y];
    }
}

/// Heading of the base: the direction of its x axis in the horizontal plane, rad.
pub fn heading(orientation: &UnitQuaternion<f64>) -> f64 {
    let x = orientation * Vector3::x();
    x.y.atan2(x.x)
}

fn standing(shared: &Shared, base: &BaseState) -> bool {
    let task = &shared.config.task;
    let q = base.orientation;
    let [roll, pitch] = fused_from_orientation([q.i as f32, q.j as f32, q.k as f32, q.w as f32]).map(f64::from);
    let upright = (q * Vector3::z()).z > 0.0;
    base.position.z > task.min_height * shared.robot.base_pose.translation.z
        && upright
        && roll.abs() < task.max_roll
        && pitch.abs() < task.max_pitch
}

fn measure(
    reading: &mut Reading,
    shared: &Shared,
    engine: &dyn Engine,
    world: usize,
    base: &BaseState,
    stream: &mut Stream,
) {
    let (joints, worlds) = (engine.joints(), engine.worlds());
    let joint = |i: usize| {
        let k = shared.robot.policy[i] * worlds + world;
        (joints.position[k], joints.velocity[k])
    };
    reading.measure(base, joint, &shared.config.noise, stream);
}

fn soles<'a>(robot: &'a Robot, kinematics: &'a Kinematics) -> impl Iterator<Item = Sole> + 'a {
    robot.feet.iter().map(|foot| {
        let link = kinematics.pose(foot.link);
        let pose = link * foot.sole;
        // The tilt of the sole's y axis against the horizontal is its rotation about the forward direction.
        let sideways = pose.rotation * Vector3::y();
        let lowest = foot
            .corners()
            .iter()
            .map(|corner| (link * corner).z)
            .fold(f64::INFINITY, f64::min);
        let centre = pose.translation.vector;
        Sole {
            centre: [centre.x, centre.y, centre.z],
            lowest,
            roll: sideways.z.clamp(-1.0, 1.0).asin(),
        }
    })
}
