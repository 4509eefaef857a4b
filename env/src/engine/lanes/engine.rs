//! A batch of worlds of one lane type behind [`Engine`].

use nalgebra::{IsometryMatrix3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::contact::Give;
use super::group::Group;
use super::lane::{Kernel, MAX_WIDTH};
use super::model::Model;
use super::reset::{get_vector, idle, reset_lane, resting, set_vector};
use super::work::{LinkWork, PHASES, Timer, Work};
use crate::engine::{BaseState, Drive, Engine, JointState, Phase, Start, World};
use crate::ground::Ground;
use crate::robot::Robot;

/// Worlds in groups of `L::WIDTH`; the lanes left over in the last group hold a robot at rest without weight.
pub struct Batch<L: Kernel> {
    pub(super) model: Model<L>,
    pub(super) groups: Vec<Group<L>>,
    pub(super) work: Work<L>,
    worlds: usize,
    joints: JointState,
    /// Vertical ground force, entry `foot * worlds + w`, N.
    loads: Vec<f64>,
    /// Per joint of the robot, the degree of freedom it moves with and its ratio.
    followers: Vec<(usize, f64)>,
    /// Per foot, its contact body.
    feet: Vec<Option<usize>>,
    timer: Timer,
}

impl<L: Kernel> Batch<L> {
    pub fn new(ground: &Ground, robot: &Robot, dt: f64, worlds: usize) -> Self {
        let model = Model::<L>::new(ground, robot, dt);
        let mut groups: Vec<_> = (0..worlds.div_ceil(L::WIDTH)).map(|_| Group::new(&model)).collect();
        let follower = |j: usize| {
            let (leader, ratio) = robot.joints[j].mimic.map_or((j, 1.0), |m| (m.joint, m.multiplier));
            (robot.dofs.iter().position(|&d| d == leader).unwrap_or(0), ratio)
        };
        let followers: Vec<_> = (0..robot.joints.len()).map(follower).collect();
        let (start, idle) = (resting(robot), idle(robot));
        for group in &mut groups {
            for lane in 0..L::WIDTH {
                reset_lane(&model, group, lane, &start, &idle, &followers);
            }
        }
        let zeros = || vec![0.0; robot.dofs.len() * worlds];
        let foot_body = |link| model.bodies.iter().position(|b| b.link == link);
        let feet = robot.feet.iter().map(|foot| foot_body(foot.link)).collect();
        let joints = JointState {
            position: zeros(),
            velocity: zeros(),
            torque: zeros(),
        };
        let work = Work::new(&model);
        let mut batch = Self {
            model,
            groups,
            work,
            worlds,
            joints,
            loads: vec![0.0; robot.feet.len() * worlds],
            followers,
            feet,
            timer: Timer::new(),
        };
        batch.store_joints();
        batch
    }

    /// See [`super::Lanes::harden`].
    pub fn harden(&mut self, hardness: f64) {
        self.model.give = Give::new(self.model.dt, hardness);
    }

    /// Operations of the step under `drive` by phase; all zero where the lanes do not count.
    pub fn operations(&mut self, drive: &Drive) -> [u64; PHASES.len()] {
        self.timer = Timer::new();
        self.step(drive);
        self.timer.operations
    }

    fn store_joints(&mut self) {
        for (g, group) in self.groups.iter().enumerate() {
            let first = g * L::WIDTH;
            let count = L::WIDTH.min(self.worlds - first);
            let mut numbers = [0.0; MAX_WIDTH];
            for d in 0..self.model.limits.len() {
                let at = d * self.worlds + first;
                let state = &group.state;
                let outputs = [
                    (&state.joint_position, &mut self.joints.position),
                    (&state.joint_velocity, &mut self.joints.velocity),
                    (&state.torque, &mut self.joints.torque),
                ];
                for (from, to) in outputs {
                    from[d].store(&mut numbers);
                    to[at..at + count].copy_from_slice(&numbers[..count]);
                }
            }
            for (foot, body) in self.feet.iter().enumerate() {
                let Some(body) = *body else { continue };
                let at = foot * self.worlds + first;
                group.state.ground_force[body].z.store(&mut numbers);
                self.loads[at..at + count].copy_from_slice(&numbers[..count]);
            }
        }
    }

    /// See [`super::Lanes::link_velocities`].
    pub fn link_velocities(&mut self, world: usize) -> Vec<[Vector3<f64>; 2]> {
        let (g, lane) = (world / L::WIDTH, world % L::WIDTH);
        L::place(&self.model, &self.groups[g].state, &mut self.work);
        let links = self.work.links.iter().map(|link| {
            let position = get_vector(&link.position, lane);
            let [linear, angular] = [&link.velocity.linear, &link.velocity.angular].map(|v| get_vector(v, lane));
            [linear + angular.cross(&position), angular]
        });
        links.collect()
    }

    /// Copies one world's joints to the exchanged arrays.
    fn store_world(&mut self, world: usize) {
        let (g, lane) = (world / L::WIDTH, world % L::WIDTH);
        let state = &self.groups[g].state;
        for d in 0..self.model.limits.len() {
            let at = d * self.worlds + world;
            self.joints.position[at] = state.joint_position[d].get(lane);
            self.joints.velocity[at] = state.joint_velocity[d].get(lane);
            self.joints.torque[at] = state.torque[d].get(lane);
        }
        for (foot, body) in self.feet.iter().enumerate() {
            let load = body.map_or(0.0, |body| state.ground_force[body].z.get(lane));
            self.loads[foot * self.worlds + world] = load;
        }
    }
}

/// Reads degree of freedom `d` of the group's worlds, zero in idle lanes.
#[inline(always)]
fn load<L: Kernel>(numbers: &[f64], at: usize, count: usize) -> L {
    if count == L::WIDTH {
        return L::load(&numbers[at..]);
    }
    let mut padded = [0.0; MAX_WIDTH];
    padded[..count].copy_from_slice(&numbers[at..at + count]);
    L::load(&padded)
}

impl<L: Kernel> Engine for Batch<L> {
    fn worlds(&self) -> usize {
        self.worlds
    }

    fn reset(&mut self, world: usize, start: &Start, model: &World) {
        let group = &mut self.groups[world / L::WIDTH];
        reset_lane(&self.model, group, world % L::WIDTH, start, model, &self.followers);
        self.store_world(world);
    }

    fn step(&mut self, drive: &Drive) {
        for (g, group) in self.groups.iter_mut().enumerate() {
            let first = g * L::WIDTH;
            let count = L::WIDTH.min(self.worlds - first);
            for (d, joint) in group.drive.iter_mut().enumerate() {
                let at = d * self.worlds + first;
                // Field by field: a whole one would be built elsewhere and copied.
                joint.target = load(&drive.target, at, count);
                joint.stiffness = load(&drive.stiffness, at, count);
                joint.damping = load(&drive.damping, at, count);
                joint.feed_forward = load(&drive.feed_forward, at, count);
                joint.torque_min = load(&drive.torque_min, at, count);
                joint.torque_max = load(&drive.torque_max, at, count);
                joint.friction = load(&drive.friction, at, count);
            }
            L::step(&self.model, group, &mut self.work, &mut self.timer);
        }
        self.store_joints();
    }

    fn joints(&self) -> &JointState {
        &self.joints
    }

    fn base(&self, world: usize) -> BaseState {
        let lane = world % L::WIDTH;
        let state = &self.groups[world / L::WIDTH].state;
        let q = &state.orientation;
        let quaternion = Quaternion::new(q.w.get(lane), q.x.get(lane), q.y.get(lane), q.z.get(lane));
        BaseState {
            position: Vector3::from(state.position.map(|axis| axis[lane])),
            orientation: UnitQuaternion::from_quaternion(quaternion),
            linear_velocity: get_vector(&state.velocity.linear, lane),
            angular_velocity: get_vector(&state.velocity.angular, lane),
        }
    }

    fn foot_force(&self, world: usize, foot: usize) -> Vector3<f64> {
        let state = &self.groups[world / L::WIDTH].state;
        let force = |body: usize| get_vector(&state.ground_force[body], world % L::WIDTH);
        self.feet[foot].map_or_else(Vector3::zeros, force)
    }

    fn foot_loads(&self) -> &[f64] {
        &self.loads
    }

    fn link_poses(&mut self, links: &[usize], poses: &mut [IsometryMatrix3<f64>]) {
        for (g, group) in self.groups.iter().enumerate() {
            L::place(&self.model, &group.state, &mut self.work);
            let first = g * L::WIDTH;
            let count = L::WIDTH.min(self.worlds - first);
            for (k, &link) in links.iter().enumerate() {
                let LinkWork { rotation, position, .. } = &self.work.links[link];
                let [a, b, c] = &rotation.0;
                let mut numbers = [[0.0; MAX_WIDTH]; 12];
                let lanes = [a, b, c, position].map(|v| [v.x, v.y, v.z]);
                for (numbers, lanes) in numbers.iter_mut().zip(lanes.as_flattened()) {
                    lanes.store(numbers);
                }
                let at = k * self.worlds + first;
                for (lane, pose) in poses[at..at + count].iter_mut().enumerate() {
                    let n = |i: usize| numbers[i][lane];
                    let rotation = Matrix3::new(n(0), n(1), n(2), n(3), n(4), n(5), n(6), n(7), n(8));
                    let base = group.state.position.map(|axis| axis[lane]);
                    let position = Translation3::new(base[0] + n(9), base[1] + n(10), base[2] + n(11));
                    *pose = IsometryMatrix3::from_parts(position, Rotation3::from_matrix_unchecked(rotation));
                }
            }
        }
    }

    fn time_phases(&mut self, running: bool) {
        self.timer.clock.run(running);
    }

    fn phases(&self) -> Vec<Phase> {
        PHASES
            .into_iter()
            .zip(self.timer.clock.seconds())
            .map(|(name, seconds)| Phase { name, seconds })
            .collect()
    }

    fn push(&mut self, world: usize, force: Vector3<f64>) {
        set_vector(
            &mut self.groups[world / L::WIDTH].parameters.push,
            world % L::WIDTH,
            force,
        );
    }

    fn is_finite(&self, world: usize) -> bool {
        let lane = world % L::WIDTH;
        let state = &self.groups[world / L::WIDTH].state;
        let q = &state.orientation;
        state.broken.get(lane) == 0.0
            && state.position.iter().all(|axis| axis[lane].is_finite())
            && [q.w, q.x, q.y, q.z]
                .iter()
                .chain(&state.joint_position)
                .all(|x| x.get(lane).is_finite())
    }

    fn save(&self, world: usize, bytes: &mut Vec<u8>) {
        let lane = world % L::WIDTH;
        let group = &self.groups[world / L::WIDTH];
        bytes.extend(self.tag());
        for axis in &group.state.position {
            bytes.extend(axis[lane].to_le_bytes());
        }
        for number in group.lanes() {
            bytes.extend(number.get(lane).to_le_bytes());
        }
    }

    fn load(&mut self, world: usize, bytes: &[u8]) -> Result<(), String> {
        let tag = self.tag();
        let lane = world % L::WIDTH;
        let group = &mut self.groups[world / L::WIDTH];
        let numbers = 3 + group.lanes().count();
        let Some(body) = bytes.strip_prefix(&tag).filter(|body| body.len() == 8 * numbers) else {
            return Err(format!(
                "not a world of this robot in lanes of {}: {} bytes instead of {}, or another header",
                if L::DOUBLE { "f64" } else { "f32" },
                bytes.len(),
                tag.len() + 8 * numbers
            ));
        };
        let mut values = body
            .chunks_exact(8)
            .map(|chunk| f64::from_le_bytes(chunk.try_into().unwrap_or_default()));
        for (axis, value) in group.state.position.iter_mut().zip(&mut values) {
            axis[lane] = value;
        }
        for (number, value) in group.lanes_mut().zip(values) {
            number.set(lane, value);
        }
        self.store_world(world);
        Ok(())
    }
}

impl<L: Kernel> Batch<L> {
    /// Marks saved worlds: engine and version, scalar, and the robot's size.
    fn tag(&self) -> [u8; 8] {
        let scalar = if L::DOUBLE { 8 } else { 4 };
        let size = |n: usize| (n % 256) as u8;
        [
            b'l',
            b'n',
            b's',
            2,
            scalar,
            size(self.model.links()),
            size(self.model.dofs()),
            size(self.model.points),
        ]
    }
}
