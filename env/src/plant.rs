//! One robot in one world that takes joint targets whenever they come, as a real one does.

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};

use crate::actuators::Actuators;
use crate::config::EnvConfig;
use crate::engine::{self, BaseState, Engine, JointState, Start, World};
use crate::error::EnvError;
use crate::random::Stream;
use crate::robot::Robot;
use crate::sensors::Reading;
use crate::task::shared::Shared;
use crate::truth::Truth;

/// A simulated robot with its servos and sensors.
pub struct Plant {
    shared: Shared,
    engine: Box<dyn Engine>,
    actuators: Actuators,
    stream: Stream,
    reading: Reading,
    world: World,
}

impl Plant {
    /// `robot` in its nominal pose, in a world drawn with `seed` as `config` says.
    ///
    /// # Errors
    /// [`EnvError`] when robot, configuration and engine do not fit together.
    pub fn new(robot: &Arc<Robot>, config: &EnvConfig, seed: u64) -> Result<Self, EnvError> {
        let shared = Shared::new(robot.clone(), config, seed)?;
        let mut engine = engine::build(robot, &shared.ground, config, 1)?;
        let mut stream = Stream::new(seed, 0, 0);
        let mut world = shared.nominal.clone();
        shared.draw_world(&mut stream, &mut world);
        engine.reset(0, &shared.nominal_start(), &world);
        Ok(Self {
            actuators: Actuators::new(robot, config.physics_dt(), 1),
            reading: Reading::zero(robot.policy.len()),
            engine,
            stream,
            shared,
            world,
        })
    }

    /// Sets the targets of the policy's joints, rad or m.
    pub fn set_targets(&mut self, targets: &[f32]) {
        for (joint, &target) in self.shared.joints.iter().zip(targets) {
            let (lower, upper) = joint.limits;
            self.actuators
                .set_target(joint.dof, 0, f64::from(target).clamp(lower, upper));
        }
    }

    /// The physical parameters now.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The physical parameters without randomisation.
    pub fn nominal(&self) -> &World {
        &self.shared.nominal
    }

    /// Changes the physical parameters under the robot, which goes on from the pose and the velocities it has; a push ends.
    pub fn change_world(&mut self, world: World) {
        let (base, joints) = (self.engine.base(0), self.engine.joints());
        let start = Start {
            position: base.position,
            orientation: base.orientation,
            linear_velocity: base.linear_velocity,
            angular_velocity: base.angular_velocity,
            joints: joints.position.clone(),
            joint_velocities: joints.velocity.clone(),
        };
        self.engine.reset(0, &start, &world);
        self.world = world;
    }

    /// Puts the robot on the ground at `place` (world frame, m) in its nominal pose, turned by `yaw`, rad.
    pub fn stand(&mut self, place: [f64; 2], yaw: f64) {
        let mut start = self.shared.nominal_start();
        let ground = &self.shared.ground;
        let rise = ground.height(place[0], place[1]) - ground.height(0.0, 0.0);
        start.position += Vector3::new(place[0], place[1], rise);
        start.orientation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * start.orientation;
        self.engine.reset(0, &start, &self.world);
        for (d, &position) in start.joints.iter().enumerate() {
            self.actuators.start(d, 0, (position, 0.0), position);
        }
    }

    /// Sets the force on the base link's origin, world frame, N; it acts until it is set again.
    pub fn push(&mut self, force: Vector3<f64>) {
        self.engine.push(0, force);
    }

    /// State of the degrees of freedom.
    pub fn joints(&self) -> &JointState {
        self.engine.joints()
    }

    /// Vertical ground force on every foot in the last physics step, N.
    pub fn foot_loads(&self) -> &[f64] {
        self.engine.foot_loads()
    }

    /// Target of degree of freedom `d`, rad or m.
    pub fn target(&self, d: usize) -> f64 {
        self.actuators.target(d, 0)
    }

    /// False once the simulation has left the physically possible.
    pub fn is_finite(&self) -> bool {
        self.engine.is_finite(0)
    }

    /// One physics step.
    pub fn step(&mut self) {
        self.engine.step(self.actuators.drive(self.engine.joints()));
        self.actuators.sense(self.engine.joints());
    }

    /// Reads the sensors, with noise where the configuration has it.
    pub fn measure(&mut self) -> &Reading {
        let (truth, state, actuators) = (self.truth(), self.engine.joints(), &self.actuators);
        let joints = self.shared.joints.iter().map(|joint| {
            let position = actuators.read(joint.dof, 0, &state.position);
            (position, state.velocity[joint.dof])
        });
        self.reading
            .measure(&truth, joints, &self.shared.config.noise, &mut self.stream);
        &self.reading
    }

    /// A latency as the configuration draws it, s.
    pub fn draw_latency(&mut self) -> f64 {
        self.shared.draw_latency(&mut self.stream) * self.shared.config.control_dt()
    }

    /// By how much a single reading comes later than that, s, as the configuration draws it.
    pub fn draw_jitter(&mut self) -> f64 {
        self.shared.draw_jitter(&mut self.stream) * self.shared.config.control_dt()
    }

    /// The torques of the policy's joints in the last step, N m or N.
    pub fn torques(&self) -> Vec<f64> {
        let (state, actuators) = (self.engine.joints(), &self.actuators);
        let joints = self.shared.joints.iter();
        joints
            .map(|joint| actuators.motor_torque(joint.dof, 0, state))
            .collect()
    }

    /// Pose and velocity of the base.
    pub fn base(&self) -> BaseState {
        self.engine.base(0)
    }

    /// The true motion of the base.
    pub fn truth(&self) -> Truth {
        Truth::new(&self.engine.base(0))
    }

    /// Whether the robot stands, by the configuration's bounds.
    pub fn stands(&self) -> bool {
        self.engine.is_finite(0) && self.shared.stands(&self.truth())
    }
}
