//! One environment: what happens around one world between two actions.

use nalgebra::{Isometry3, Translation3, Vector3};
use omniwalk_controller::{Pipeline, Sensors, Turn};
use serde::{Deserialize, Serialize};

use super::command::CommandRange;
use super::episode::{End, Episode, Outcome, Sums};
use super::gait::{GaitMeter, Sole};
use super::poses::Poses;
use super::reward::{Factors, Motion, Swing};
use super::shared::Shared;
use super::sole::with_matrix;
use super::tracking::TrackingMeter;
use crate::actuators::Actuators;
use crate::engine::{Engine, Start, World};
use crate::error::EnvError;
use crate::random::Stream;
use crate::robot::Kinematics;
use crate::sensors::{History, Reading};
use crate::truth::Truth;

/// Everything an environment remembers; serialisable, so that a resumed run goes on with the same bits.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Environment {
    pub(super) index: usize,
    pub(super) episode: u64,
    pub(super) stream: Stream,
    pub(super) pipeline: Pipeline,
    pub(super) history: History,
    pub(super) range: CommandRange,
    pub(super) desired: [f64; 3],
    #[serde(skip)]
    pub(super) asked: Asked,
    pub(super) until_draw: u32,
    pub(super) step: u32,
    pub(super) length: u32,
    /// Factor on each joint's response in this episode (equation 7.14).
    pub(super) response: Vec<f64>,
    pub(super) targets: Vec<f32>,
    pub(super) previous_targets: Vec<f32>,
    pub(super) action_change: f64,
    /// Heading the inertial velocity is judged along: the true one when the inertial frame was set last, turned on as
    /// commanded if the configuration says so.
    pub(super) heading: [f64; 2],
    pub(super) motion: Motion,
    pub(super) swing: Swing,
    pub(super) push_steps: u32,
    pub(super) soles: Vec<Sole>,
    pub(super) gait: GaitMeter,
    pub(super) tracking: TrackingMeter,
    pub(super) sums: Sums,
}

/// The velocities (m/s, m/s, rad/s) the policy's last observation asked for, by which the step is judged.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Asked {
    /// Behind the ramp.
    pub commanded: [f64; 3],
    /// Before it.
    pub desired: [f64; 3],
}

/// Scratch one batch shares between its environments, for starts of episodes.
pub struct Scratch {
    pub(super) kinematics: Kinematics,
    pub(super) start: Start,
    pub(super) world: World,
}

impl Scratch {
    /// Scratch for `shared`'s robot.
    pub fn new(shared: &Shared) -> Self {
        let robot = &shared.robot;
        Self {
            kinematics: Kinematics::new(robot),
            start: Start::nominal(robot),
            world: shared.nominal.clone(),
        }
    }
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
            asked: Asked::default(),
            until_draw: 0,
            step: 0,
            length: 0,
            response: vec![1.0; joints],
            targets: vec![0.0; joints],
            previous_targets: vec![0.0; joints],
            action_change: 0.0,
            heading: [1.0, 0.0],
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

    /// Its index in the batch.
    pub fn index(&self) -> usize {
        self.index
    }

    /// The gait of the running episode.
    pub fn gait(&self) -> &GaitMeter {
        &self.gait
    }

    /// Leaves the running episode without a record: the next reset starts the one after it.
    pub fn pass_over(&mut self) {
        self.episode += 1;
    }

    /// The next reset starts the first episode.
    pub fn start_over(&mut self) {
        self.episode = 0;
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
            actuators.start(d, world, (position, 0.0), position);
        }
        let base = engine.base(world);
        let pose = Isometry3::from_parts(Translation3::from(base.position), base.orientation);
        scratch.kinematics.set_pose(&shared.robot, &pose, &scratch.start.joints);
        self.place_soles(shared, &scratch.kinematics);
        self.gait.reset(&self.soles);
        self.tracking.reset();
        let truth = Truth::new(&base);
        self.heading = truth.heading;
        self.motion = Motion::default();
        self.sums = Sums::default();
        self.sums.start = [base.position.x, base.position.y];
        let phase = if self.stream.unit() < 0.5 { 0.0 } else { 0.5 };
        self.pipeline.reset(&shared.spec, phase);
        self.swing = Swing::default();
        let delay = shared.draw_latency(&mut self.stream);
        let Self { history, stream, .. } = self;
        history.reset(delay, |reading| {
            measure(reading, shared, (engine, actuators), world, &truth, stream)
        });
        let turn = self.turn(shared, &truth, observation);
        turn.pipeline
            .observe(&shared.spec, &turn.sensors, turn.desired, turn.out);
    }

    /// Sets the targets of the next control step from `action` in [0, 1] per joint.
    pub fn act(
        &mut self,
        shared: &Shared,
        engine: &mut dyn Engine,
        actuators: &mut Actuators,
        world: usize,
        action: &[f32],
        largest_push: f64,
    ) {
        self.previous_targets.copy_from_slice(&self.targets);
        self.pipeline.decode(&shared.spec, action, &mut self.targets);
        self.action_change = if self.step == 0 {
            0.0
        } else {
            self.target_change(shared)
        };
        let (worlds, positions) = (engine.worlds(), &engine.joints().position);
        let joints = shared.joints.iter().zip(&self.response).zip(&self.targets);
        for ((joint, response), &target) in joints {
            let position = positions[joint.dof * worlds + world];
            let target = position + response * (f64::from(target) - position);
            let (lower, upper) = joint.limits;
            actuators.set_target(joint.dof, world, target.clamp(lower, upper));
        }
        self.push(shared, engine, world, largest_push);
    }

    /// Takes in the foot loads of one physics step of `dt` s, N: every `worlds`-th of `loads` from the first on.
    pub fn forces(&mut self, loads: &[f64], worlds: usize, dt: f64) {
        for (foot, &load) in loads.iter().step_by(worlds).enumerate() {
            self.gait.force(foot, load, dt);
        }
    }

    /// Ends a control step: looks at the robot and reads its sensors. `None` when its world has gone non-finite.
    pub fn sense(
        &mut self,
        shared: &Shared,
        engine: &dyn Engine,
        actuators: &Actuators,
        world: usize,
        poses: &Poses,
    ) -> Option<Truth> {
        self.step += 1;
        if !engine.is_finite(world) {
            return None;
        }
        let truth = Truth::new(&engine.base(world));
        for (sole, (foot, shape)) in self.soles.iter_mut().zip(shared.robot.feet.iter().zip(&shared.soles)) {
            *sole = shape.at(poses.of(world, foot.link), &shared.ground);
        }
        self.gait.soles(&self.soles, shared.config.control_dt());
        // What the policy knew when it acted: a command drawn now is not held against it.
        self.asked = Asked {
            commanded: self.pipeline.commanded().map(f64::from),
            desired: self.desired,
        };
        self.redraw(shared);
        let Self { history, stream, .. } = self;
        history.record(|reading| measure(reading, shared, (engine, actuators), world, &truth, stream));
        Some(truth)
    }

    /// What the controller takes to write the observation `out` after [`Environment::sense`] or at a reset.
    pub fn turn<'a>(&'a mut self, shared: &Shared, truth: &Truth, out: &'a mut [f32]) -> Turn<'a> {
        let jitter = shared.draw_jitter(&mut self.stream);
        let reading = self.history.delayed(jitter);
        let v = truth.velocity.map(|x| x as f32);
        let given = shared.config.observation.true_velocity;
        Turn {
            pipeline: &mut self.pipeline,
            sensors: Sensors {
                position: &reading.position,
                velocity: &reading.velocity,
                attitude: reading.attitude,
                gyro: reading.gyro,
                base_velocity: given.then_some([v.x, v.y, v.z]),
            },
            desired: self.desired.map(|x| x as f32),
            out,
        }
    }

    /// Judges the control step after its observation.
    pub fn conclude_step(
        &mut self,
        shared: &Shared,
        engine: &dyn Engine,
        world: usize,
        truth: &Truth,
        factors: Factors,
        poses: &Poses,
    ) -> Outcome {
        if self.pipeline.frame_was_set() {
            self.heading = truth.heading;
        }
        let alive = shared.stands(truth);
        let terms = self.judge(shared, engine, world, truth, alive, factors);
        self.measure_step(shared, engine, world, truth);
        if terms.not_finite().is_none() {
            self.sums.terms.add(&terms);
        }
        let overlap = || shared.config.task.end_on_overlap && shared.overlap.any(|link| poses.of(world, link));
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
            drift: sums.drift(),
        }
    }

    fn push(&mut self, shared: &Shared, engine: &mut dyn Engine, world: usize, largest: f64) {
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
            let force = self.stream.uniform(0.0, largest);
            engine.push(world, Vector3::new(force * angle.cos(), force * angle.sin(), 0.0));
            self.push_steps = (push.duration / dt).round().max(1.0) as u32;
        }
    }

    pub(super) fn place_soles(&mut self, shared: &Shared, kinematics: &Kinematics) {
        for (sole, (foot, shape)) in self.soles.iter_mut().zip(shared.robot.feet.iter().zip(&shared.soles)) {
            *sole = shape.at(&with_matrix(kinematics.pose(foot.link)), &shared.ground);
        }
    }
}

fn measure(
    reading: &mut Reading,
    shared: &Shared,
    (engine, actuators): (&dyn Engine, &Actuators),
    world: usize,
    truth: &Truth,
    stream: &mut Stream,
) {
    let (state, worlds) = (engine.joints(), engine.worlds());
    let joints = shared.joints.iter().map(|joint| {
        let k = joint.dof * worlds + world;
        (actuators.read(joint.dof, world, &state.position), state.velocity[k])
    });
    reading.measure(truth, joints, &shared.config.noise, stream);
}
