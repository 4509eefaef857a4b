//! Physics behind one trait over batches of worlds.
//!
//! An [`Engine`] steps `worlds()` copies of one robot on one [`Ground`]. It knows gravity, joints, contacts and a
//! drive per degree of freedom that is constant over one physics step; everything an actuator or a sensor does
//! beyond that is written once, outside. Arrays over joints are structures of arrays:
//! entry `d * worlds + w` is degree of freedom `d` of world `w`.

pub mod lanes;
pub mod rapier;

use nalgebra::{IsometryMatrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::config::{EngineKind, EnvConfig};
use crate::effect::engine_passive;
use crate::ground::Ground;
use crate::robot::{Inertial, Passive, Robot};

/// Why an engine cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// A step that is not a positive, finite time.
    #[error("a physics step of {dt} s is impossible; use 0.001 to 0.005 s")]
    TimeStep {
        /// The step, s.
        dt: f64,
    },
    /// A robot that is a single rigid link.
    #[error("robot {robot:?} has no moving joint; an engine needs at least one")]
    NoJoints {
        /// The robot's name.
        robot: String,
    },
    /// A lane type whose instructions this processor lacks.
    #[error("this processor has no instructions for simd = {:?}; the fastest it has is {:?}", .level.name(), lanes::Simd::detect().name())]
    Simd {
        /// The lane type.
        level: lanes::Simd,
    },
    /// An engine of a [`Maker`] that is not there, or does not take the robot.
    #[error("{0}")]
    Made(String),
}

/// Standard gravity, m/s^2.
pub const GRAVITY: f64 = 9.81;

/// Friction between sole and ground (thesis 7.4).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Friction {
    /// Tangential coefficient.
    pub tangential: f64,
    /// Torsional coefficient about the contact normal, m.
    pub torsional: f64,
    /// Rolling coefficient about the contact tangents, m.
    pub rolling: f64,
}

/// No robot moves this fast, m/s or rad/s: a world that does is broken, in every engine.
pub const MAX_SPEED: f64 = 1e4;

/// The physical parameters of one world for one episode.
#[derive(Debug, PartialEq)]
pub struct World {
    /// Sole-ground friction.
    pub friction: Friction,
    /// Gravity in the world frame, m/s^2 (tilted for a slope).
    pub gravity: Vector3<f64>,
    /// Mass properties of every link, in the order of `Robot::links`.
    pub links: Vec<Inertial>,
    /// Passive dynamics of every joint, in the order of `Robot::joints`. `friction` here is not used: dry friction is in the [`Drive`].
    pub joints: Vec<Passive>,
}

impl Clone for World {
    fn clone(&self) -> Self {
        Self {
            links: self.links.clone(),
            joints: self.joints.clone(),
            ..*self
        }
    }

    /// Without an allocation between worlds of one robot: every episode begins with it.
    fn clone_from(&mut self, other: &Self) {
        (self.friction, self.gravity) = (other.friction, other.gravity);
        self.links.clone_from(&other.links);
        self.joints.clone_from(&other.joints);
    }
}

impl World {
    /// The robot's own masses and passive joints under gravity along -z, on a ground of the given friction.
    pub fn nominal(robot: &Robot, friction: Friction) -> Self {
        Self {
            friction,
            gravity: Vector3::new(0.0, 0.0, -GRAVITY),
            links: robot.links.iter().map(|link| link.inertial).collect(),
            joints: engine_passive(robot),
        }
    }
}

/// Where a world starts.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Position of the base link's frame in the world, m. Ignored for a fixed base.
    pub position: Vector3<f64>,
    /// Orientation of the base link in the world. Ignored for a fixed base.
    pub orientation: UnitQuaternion<f64>,
    /// Linear velocity of the base link's origin in the world frame, m/s. Ignored for a fixed base.
    pub linear_velocity: Vector3<f64>,
    /// Angular velocity of the base in the world frame, rad/s. Ignored for a fixed base.
    pub angular_velocity: Vector3<f64>,
    /// Positions of the degrees of freedom, rad or m.
    pub joints: Vec<f64>,
    /// Velocities of the degrees of freedom, rad/s or m/s.
    pub joint_velocities: Vec<f64>,
}

impl Start {
    /// The nominal pose at rest.
    pub fn nominal(robot: &Robot) -> Self {
        Self {
            position: robot.base_pose.translation.vector,
            orientation: robot.base_pose.rotation,
            linear_velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
            joints: robot.nominal(),
            joint_velocities: vec![0.0; robot.dofs.len()],
        }
    }
}

/// What acts at the joints during one physics step: an implicit spring-damper with a clamp, a feed-forward
/// torque and dry friction.
///
/// `torque = clamp(stiffness (target - q') - damping dq' + feed_forward, torque_min, torque_max)` with q', dq'
/// at the end of the step (implicit), and a dry friction of at most `friction` that opposes motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Target positions, rad or m.
    pub target: Vec<f64>,
    /// Position gains, N m/rad or N/m.
    pub stiffness: Vec<f64>,
    /// Velocity gains, N m s/rad or N s/m.
    pub damping: Vec<f64>,
    /// Torque added before the clamp, N m or N.
    pub feed_forward: Vec<f64>,
    /// Lower clamp, N m or N.
    pub torque_min: Vec<f64>,
    /// Upper clamp, N m or N.
    pub torque_max: Vec<f64>,
    /// Dry friction, N m or N, not negative.
    pub friction: Vec<f64>,
}

impl Drive {
    /// A drive without any torque for `dofs` degrees of freedom in `worlds` worlds.
    pub fn idle(dofs: usize, worlds: usize) -> Self {
        let zeros = || vec![0.0; dofs * worlds];
        Self {
            target: zeros(),
            stiffness: zeros(),
            damping: zeros(),
            feed_forward: zeros(),
            torque_min: zeros(),
            torque_max: zeros(),
            friction: zeros(),
        }
    }
}

/// Joint state after the last step, structures of arrays.
#[derive(Clone, Debug, PartialEq)]
pub struct JointState {
    /// Positions, rad or m.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Torque the drive applied in the last step (after the clamp, without dry friction), N m or N.
    pub torque: Vec<f64>,
}

/// State of a world's base after the last step, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseState {
    /// Position of the base link's frame, m.
    pub position: Vector3<f64>,
    /// Orientation of the base link.
    pub orientation: UnitQuaternion<f64>,
    /// Velocity of the base link's origin, m/s.
    pub linear_velocity: Vector3<f64>,
    /// Angular velocity, rad/s.
    pub angular_velocity: Vector3<f64>,
}

/// Time spent in a phase of the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// What it does.
    pub name: &'static str,
    /// Wall time since the clock was started, s.
    pub seconds: f64,
}

/// A batch of worlds of one robot.
///
/// An engine is deterministic: the same calls give the same bits, and a world's trajectory does not depend on
/// the other worlds of the batch. A world that has gone non-finite stays in its lane: it is reported by
/// [`Engine::is_finite`] until it is reset and never disturbs the others.
pub trait Engine: Send {
    /// Number of worlds in the batch.
    fn worlds(&self) -> usize;

    /// Starts a new episode in `world` at `start` with the parameters `model`; pushes are cleared and nothing of the
    /// world's past remains.
    fn reset(&mut self, world: usize, start: &Start, model: &World);

    /// Advances every world by one physics step under `drive`.
    fn step(&mut self, drive: &Drive);

    /// Joint positions, velocities and torques after the last step or reset.
    fn joints(&self) -> &JointState;

    /// Base state of `world` after the last step or reset; the fixed pose at rest for a fixed base.
    fn base(&self, world: usize) -> BaseState;

    /// Ground force on foot `foot` of `world` averaged over the last physics step, world frame, N.
    fn foot_force(&self, world: usize, foot: usize) -> Vector3<f64>;

    /// Vertical ground force on every foot averaged over the last physics step, N: entry `foot * worlds() + w`.
    fn foot_loads(&self) -> &[f64];

    /// World poses of the links `links` (indices into `Robot::links`) after the last step or reset: entry
    /// `k * worlds() + w` of `poses` is link `links[k]` of world `w`.
    fn link_poses(&mut self, links: &[usize], poses: &mut [IsometryMatrix3<f64>]);

    /// Starts, or stops, a clock that splits steps into phases, from zero. Engines without phases do nothing.
    fn time_phases(&mut self, running: bool) {
        let _ = running;
    }

    /// Time by phase since [`Engine::time_phases`]; empty for engines without phases.
    fn phases(&self) -> Vec<Phase> {
        Vec::new()
    }

    /// Sets the external force on the base link's origin, world frame, N; it acts until it is set again or the world is reset.
    fn push(&mut self, world: usize, force: Vector3<f64>);

    /// False once any coordinate of `world` is not finite or anything is faster than [`MAX_SPEED`].
    fn is_finite(&self, world: usize) -> bool;

    /// Appends everything that determines the future of `world` (state, parameters, warm starts) to `bytes`.
    fn save(&self, world: usize, bytes: &mut Vec<u8>);

    /// Restores what [`Engine::save`] wrote, so that the world goes on with the same bits.
    ///
    /// # Errors
    /// A message when the bytes are not from this engine and robot.
    fn load(&mut self, world: usize, bytes: &[u8]) -> Result<(), String>;
}

/// An engine of the configured kind with `worlds` worlds of `robot` on `ground`.
///
/// # Errors
/// [`EngineError`] when the engine does not take the robot, or this processor lacks the SIMD level.
pub fn build(
    robot: &Robot,
    ground: &Ground,
    config: &EnvConfig,
    worlds: usize,
) -> Result<Box<dyn Engine>, EngineError> {
    let dt = config.physics_dt();
    match config.engine.kind {
        EngineKind::Rapier => Ok(Box::new(rapier::Rapier::on(ground, robot, dt, worlds)?)),
        EngineKind::Lanes => {
            let level = config.engine.simd.level();
            Ok(Box::new(lanes::Lanes::on(ground, robot, dt, worlds, level)?))
        }
    }
}

/// Makes the engines of a batch: those of the configuration, or others from outside this crate.
pub trait Maker: Sync {
    /// Worlds that one engine object should hold in a batch of `environments`: what a thread steps at a time.
    fn width(&self, config: &EnvConfig, environments: usize) -> usize;

    /// An engine with `worlds` worlds of `robot` on `ground`, stepped as `config` says.
    ///
    /// # Errors
    /// [`EngineError`] when the engine cannot be had, or does not take the robot.
    fn make(
        &self,
        robot: &Robot,
        ground: &Ground,
        config: &EnvConfig,
        worlds: usize,
    ) -> Result<Box<dyn Engine>, EngineError>;
}

/// Makes the engines that the configuration names.
pub struct Configured;

impl Maker for Configured {
    fn width(&self, config: &EnvConfig, environments: usize) -> usize {
        group_width(config).min(environments.max(1))
    }

    fn make(
        &self,
        robot: &Robot,
        ground: &Ground,
        config: &EnvConfig,
        worlds: usize,
    ) -> Result<Box<dyn Engine>, EngineError> {
        build(robot, ground, config, worlds)
    }
}

/// Worlds that one engine object should hold: what a thread steps at a time.
pub fn group_width(config: &EnvConfig) -> usize {
    match config.engine.kind {
        EngineKind::Rapier => 1,
        EngineKind::Lanes => config.engine.simd.level().width(),
    }
}
