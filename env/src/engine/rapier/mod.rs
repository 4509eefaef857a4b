//! The engine of record: one rapier world per robot, joints as reduced coordinates ([rapier's multibodies](https://rapier.rs)).
//!
//! - **Integration** is rapier's semi-implicit Euler with one substep: velocities from the mass matrix at the start of
//!   the step with springs, damping and Coriolis terms implicit, then contacts, limits, couplings and dry friction
//!   by a few Gauss-Seidel sweeps, then positions.
//! - **Drives** are implicit springs and dampers inside the mass matrix, or a constant torque while saturated (`drive.rs`).
//! - **Mimic joints** are joints of their own, tied by a velocity row with position feedback. Armature, drive and viscous
//!   friction of the joint they follow are shared among them (a part `s` of a gain `k` acts on a follower with
//!   multiplier m as `s k / m^2`), which leaves the energy and so the motion as it is.
//! - **Contacts** are rigid, of each shape with the ground only, with Coulomb friction in a circular cone at each contact
//!   point. Torsional and rolling friction are torques on the touching link (`contact.rs`).
//! - **Joint limits** act once passed: a joint that reaches one at speed v passes it by at most `v dt` and is put back in the next step.
//!   Those of a mimic joint are kept by the joint that it follows.
//! - A link without mass gets 1e-6 kg and 1e-8 kg m^2, because rapier stores inverses.
//!
//! A world [is finite](Engine::is_finite) while every position is finite and nothing moves or turns faster than 1e4 m/s or rad/s. Beyond, it
//! stands still until it is reset.

mod contact;
mod convert;
mod drive;
mod inertia;
mod lane;
mod scene;
mod shapes;
mod snapshot;

use nalgebra::{Isometry3, IsometryMatrix3, Vector3};

use self::drive::Command;
use self::lane::Lane;
use self::scene::Scene;
pub use self::scene::weighed;
use super::{BaseState, Drive, Engine, EngineError, JointState, Start, World};
use crate::ground::Ground;
use crate::robot::{Kinematics, Robot};

/// A batch of rapier worlds, stepped one after the other by the calling thread.
pub struct Rapier {
    scene: Scene,
    lanes: Vec<Lane>,
    joints: JointState,
    /// Entry `foot * worlds + w`, N.
    loads: Vec<f64>,
    robot: Robot,
    kinematics: Kinematics,
    /// Scratch: positions of one world's degrees of freedom.
    positions: Vec<f64>,
    dt: f64,
}

impl Rapier {
    /// Worlds of `robot` on a level plane stepped by `dt` seconds. Each has to be reset before it moves.
    ///
    /// # Errors
    /// When `dt` is not a positive number or the robot has no joint that moves.
    pub fn new(robot: &Robot, dt: f64, worlds: usize) -> Result<Self, EngineError> {
        Self::on(&Ground::Plane, robot, dt, worlds)
    }

    /// The same on any ground.
    ///
    /// # Errors
    /// As [`Rapier::new`].
    pub fn on(ground: &Ground, robot: &Robot, dt: f64, worlds: usize) -> Result<Self, EngineError> {
        if !(dt.is_finite() && dt > 0.0) {
            return Err(EngineError::TimeStep { dt });
        }
        let scene = Scene::new(ground, robot)?;
        let zeros = || vec![0.0; scene.freedoms.len() * worlds];
        Ok(Self {
            lanes: (0..worlds).map(|_| Lane::new(&scene)).collect(),
            joints: JointState {
                position: zeros(),
                velocity: zeros(),
                torque: zeros(),
            },
            loads: vec![0.0; robot.feet.len() * worlds],
            robot: robot.clone(),
            kinematics: Kinematics::new(robot),
            positions: robot.nominal(),
            scene,
            dt,
        })
    }

    /// World pose of link `link` (an index into `Robot::links`) of `world` after the last step or reset.
    pub fn link_pose(&self, world: usize, link: usize) -> Isometry3<f64> {
        self.lanes[world].link_pose(&self.scene, link)
    }

    fn publish(&mut self, world: usize) {
        let worlds = self.lanes.len();
        for (d, joint) in self.lanes[world].joints.iter().enumerate() {
            let i = d * worlds + world;
            self.joints.position[i] = joint.position;
            self.joints.velocity[i] = joint.velocity;
            self.joints.torque[i] = joint.torque;
        }
        for foot in 0..self.scene.feet.len() {
            self.loads[foot * worlds + world] = self.foot_force(world, foot).z;
        }
    }
}

impl Engine for Rapier {
    fn worlds(&self) -> usize {
        self.lanes.len()
    }

    fn reset(&mut self, world: usize, start: &Start, model: &World) {
        self.lanes[world].reset(&self.scene, start, model);
        self.publish(world);
    }

    fn step(&mut self, drive: &Drive) {
        let worlds = self.lanes.len();
        for world in 0..worlds {
            self.lanes[world].step(&self.scene, self.dt, |d| {
                let i = d * worlds + world;
                let command = Command {
                    target: drive.target[i],
                    stiffness: drive.stiffness[i],
                    damping: drive.damping[i],
                    feed_forward: drive.feed_forward[i],
                    torque_min: drive.torque_min[i],
                    torque_max: drive.torque_max[i],
                };
                (command, drive.friction[i])
            });
            self.publish(world);
        }
    }

    fn joints(&self) -> &JointState {
        &self.joints
    }

    fn base(&self, world: usize) -> BaseState {
        self.lanes[world].base(&self.scene)
    }

    fn foot_force(&self, world: usize, foot: usize) -> Vector3<f64> {
        self.scene.feet[foot].map_or(Vector3::zeros(), |toucher| self.lanes[world].forces[toucher].0)
    }

    fn foot_loads(&self) -> &[f64] {
        &self.loads
    }

    /// By the kinematics of the degrees of freedom: followers are where they belong, not where the solver left them.
    fn link_poses(&mut self, links: &[usize], poses: &mut [IsometryMatrix3<f64>]) {
        let worlds = self.lanes.len();
        for (world, lane) in self.lanes.iter().enumerate() {
            let base = lane.link_pose(&self.scene, 0);
            for (position, joint) in self.positions.iter_mut().zip(&lane.joints) {
                *position = joint.position;
            }
            self.kinematics.set_pose(&self.robot, &base, &self.positions);
            for (k, &link) in links.iter().enumerate() {
                let pose = self.kinematics.pose(link);
                poses[k * worlds + world] =
                    IsometryMatrix3::from_parts(pose.translation, pose.rotation.to_rotation_matrix());
            }
        }
    }

    fn push(&mut self, world: usize, force: Vector3<f64>) {
        self.lanes[world].push = force;
    }

    fn is_finite(&self, world: usize) -> bool {
        self.lanes[world].alive
    }

    fn save(&self, world: usize, bytes: &mut Vec<u8>) {
        snapshot::save(&self.lanes[world], &self.scene, bytes);
    }

    fn load(&mut self, world: usize, bytes: &[u8]) -> Result<(), String> {
        snapshot::load(&mut self.lanes[world], &self.scene, bytes)?;
        self.publish(world);
        Ok(())
    }
}
