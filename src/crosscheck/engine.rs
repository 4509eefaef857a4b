//! MuJoCo as an engine: worlds in Python processes, each of which steps its share of a batch.
//!
//! Actuators, sensors, randomisation, disturbances and judgement are those of every engine, drawn by the same random numbers;
//! bodies, joints, contacts and integration are MuJoCo's, of a model that Python makes from the robot's files.
//! Worlds are not saved: what steps in MuJoCo is measured from its beginning to its end.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Isometry3, IsometryMatrix3, Quaternion, UnitQuaternion, Vector3};
use omniwalk_env::EnvConfig;
use omniwalk_env::engine::{BaseState, Drive, Engine, EngineError, JointState, Maker, Start, World};
use omniwalk_env::ground::Ground;
use omniwalk_env::robot::{Base, Foot, Inertial, Kinematics, Robot};
use serde_json::{Value, json};

use super::process::{Process, numbers};
use super::python::Python;

/// Numbers of a base: position, orientation, linear and angular velocity.
const BASE: usize = 13;

/// Makes worlds in MuJoCo of the robot whose files are at a path.
pub struct Workshop {
    shared: Arc<Shared>,
    path: PathBuf,
    processes: usize,
}

/// What the workshop and its engines share.
struct Shared {
    python: Python,
    /// The robot as this side has read it.
    robot: Arc<Robot>,
    /// Processes that wait for work: starting one takes as long as some thousand steps.
    idle: Mutex<Vec<Process>>,
    /// What went wrong first.
    failure: Mutex<Option<String>>,
}

impl Shared {
    fn process(&self) -> Result<Process, String> {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.map_or_else(|| Process::start(&self.python), Ok)
    }

    fn put_back(&self, process: Process) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(process);
    }

    fn fail(&self, why: String) {
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert(why);
    }
}

/// How worlds differ from those of an evaluation, where the robot that is given differs so from its files.
#[derive(Clone, Copy, Debug, Default)]
pub struct Special {
    /// The base is bolted to the world there, m.
    pub stand: Option<[f64; 3]>,
    /// What is left out: `couplings` (joints that follow others are free), `limits` of joints, `legs` that
    /// collide with each other.
    pub without: &'static [&'static str],
}

impl Workshop {
    /// Worlds of `robot`, whose files are at `path`, with at most `processes` processes at a time.
    pub fn new(python: Python, robot: Arc<Robot>, path: &Path, processes: usize) -> Self {
        Self {
            shared: Arc::new(Shared {
                python,
                robot,
                idle: Mutex::default(),
                failure: Mutex::default(),
            }),
            path: path.to_owned(),
            processes: processes.max(1),
        }
    }

    /// `worlds` worlds of `robot`, stepped by `dt` s.
    ///
    /// # Errors
    /// When Python does not understand the robot, or understands another one.
    pub fn worlds(&self, robot: &Robot, dt: f64, worlds: usize, special: Special) -> Result<Mujoco, String> {
        let process = self.shared.process()?;
        Mujoco::new(self.shared.clone(), process, &self.path, robot, dt, worlds, special)
    }

    /// Lets `work` ask a process.
    ///
    /// # Errors
    /// What `work` says.
    pub fn with_process<T>(&self, work: impl FnOnce(&mut Process) -> Result<T, String>) -> Result<T, String> {
        let mut process = self.shared.process()?;
        let result = work(&mut process)?;
        self.shared.put_back(process);
        Ok(result)
    }

    /// Whether every step was answered. Worlds whose process is gone only report that they are lost.
    ///
    /// # Errors
    /// What went wrong first.
    pub fn check(&self) -> miette::Result<()> {
        let failure = self.shared.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.as_ref().map_or(Ok(()), |why| Err(miette::miette!("{why}")))
    }
}

impl Maker for Workshop {
    fn width(&self, _: &EnvConfig, environments: usize) -> usize {
        environments.div_ceil(self.processes)
    }

    fn make(
        &self,
        robot: &Robot,
        ground: &Ground,
        config: &EnvConfig,
        worlds: usize,
    ) -> Result<Box<dyn Engine>, EngineError> {
        if *ground != Ground::Plane {
            return Err(EngineError::Made(
                "MuJoCo's ground is a level plane; set ground.kind = \"plane\"".into(),
            ));
        }
        let engine = self.worlds(robot, config.physics_dt(), worlds, Special::default());
        Ok(Box::new(engine.map_err(EngineError::Made)?))
    }
}

/// Worlds in one process.
pub struct Mujoco {
    shared: Arc<Shared>,
    process: Option<Process>,
    robot: Robot,
    kinematics: Kinematics,
    worlds: usize,
    joints: JointState,
    bases: Vec<BaseState>,
    /// Entry `world * feet + foot`, N.
    forces: Vec<Vector3<f64>>,
    /// Entry `foot * worlds + world`, N.
    loads: Vec<f64>,
    pushes: Vec<Vector3<f64>>,
    finite: Vec<bool>,
    /// Scratch: a request.
    request: Vec<u8>,
    /// Scratch: positions of one world's degrees of freedom.
    positions: Vec<f64>,
}

impl Mujoco {
    fn new(
        shared: Arc<Shared>,
        mut process: Process,
        path: &Path,
        robot: &Robot,
        dt: f64,
        worlds: usize,
        special: Special,
    ) -> Result<Self, String> {
        let path = path
            .canonicalize()
            .map_err(|error| format!("{}: {error}", path.display()))?;
        let head = json!({
            "robot": path,
            "physics_hz": 1.0 / dt,
            "worlds": worlds,
            "stand": special.stand,
            "without": special.without,
            "dofs": (0..robot.dofs.len()).map(|d| &robot.dof(d).name).collect::<Vec<_>>(),
            "soles": robot.feet.iter().map(|foot| sole(robot, foot)).collect::<Vec<_>>(),
            "links": robot.links.iter().map(|link| &link.name).collect::<Vec<_>>(),
            "joints": robot.joints.iter().map(|joint| &joint.name).collect::<Vec<_>>(),
        });
        let reply = process.ask_with_head(b'm', &head, &[])?;
        let described: Value = serde_json::from_slice(reply).map_err(|error| error.to_string())?;
        let (dofs, feet) = (robot.dofs.len(), robot.feet.len());
        let width = 1 + BASE + 3 * dofs + 3 * feet;
        if described["width"] != width {
            return Err(format!(
                "MuJoCo's states have {} numbers instead of {width}",
                described["width"]
            ));
        }
        let zeros = || vec![0.0; dofs * worlds];
        Ok(Self {
            shared,
            process: Some(process),
            kinematics: Kinematics::new(robot),
            robot: robot.clone(),
            worlds,
            joints: JointState {
                position: zeros(),
                velocity: zeros(),
                torque: zeros(),
            },
            bases: vec![at_rest(robot); worlds],
            forces: vec![Vector3::zeros(); feet * worlds],
            loads: vec![0.0; feet * worlds],
            pushes: vec![Vector3::zeros(); worlds],
            finite: vec![true; worlds],
            request: Vec::new(),
            positions: robot.nominal(),
        })
    }

    /// Asks the process about the first world.
    ///
    /// # Errors
    /// What it says is wrong.
    pub fn ask(&mut self, letter: u8, payload: &[u8]) -> Result<&[u8], String> {
        let process = self.process.as_mut().ok_or("MuJoCo's process is gone")?;
        process.ask(letter, payload)
    }

    /// Asks the process with a head of JSON.
    ///
    /// # Errors
    /// What it says is wrong.
    pub fn ask_with_head(&mut self, letter: u8, head: &Value, rest: &[u8]) -> Result<&[u8], String> {
        let process = self.process.as_mut().ok_or("MuJoCo's process is gone")?;
        process.ask_with_head(letter, head, rest)
    }

    /// Sends the request; takes in the states of the worlds from `first` on. A process that fails leaves them lost.
    fn exchange(&mut self, letter: u8, first: usize) {
        let Some(mut process) = self.process.take() else {
            return;
        };
        match process.ask(letter, &self.request) {
            Ok(reply) => {
                let width = 1 + BASE + 3 * self.robot.dofs.len() + 3 * self.robot.feet.len();
                let mut row = Vec::with_capacity(width);
                for (world, bytes) in (first..self.worlds).zip(reply.chunks_exact(8 * width)) {
                    row.clear();
                    row.extend(numbers(bytes));
                    self.take_in(world, &row);
                }
                self.process = Some(process);
            }
            Err(why) => {
                self.shared.fail(why);
                self.finite.fill(false);
            }
        }
    }

    fn take_in(&mut self, world: usize, row: &[f64]) {
        let dofs = self.robot.dofs.len();
        let vector = |at: usize| Vector3::new(row[at], row[at + 1], row[at + 2]);
        self.finite[world] = row[0] != 0.0;
        self.bases[world] = BaseState {
            position: vector(1),
            orientation: UnitQuaternion::from_quaternion(Quaternion::new(row[4], row[5], row[6], row[7])),
            linear_velocity: vector(8),
            angular_velocity: vector(11),
        };
        let rest = &row[1 + BASE..];
        for d in 0..dofs {
            let k = d * self.worlds + world;
            self.joints.position[k] = rest[d];
            self.joints.velocity[k] = rest[dofs + d];
            self.joints.torque[k] = rest[2 * dofs + d];
        }
        let feet = self.robot.feet.len();
        for foot in 0..feet {
            let force = vector(1 + BASE + 3 * (dofs + foot));
            self.forces[world * feet + foot] = force;
            self.loads[foot * self.worlds + world] = force.z;
        }
    }

    fn put(&mut self, numbers: impl IntoIterator<Item = f64>) {
        self.request.extend(numbers.into_iter().flat_map(f64::to_le_bytes));
    }
}

/// A sole for Python, which guesses none where the robot's files give none.
fn sole(robot: &Robot, foot: &Foot) -> Value {
    let turn = foot.sole.rotation.to_rotation_matrix();
    json!({
        "name": foot.name,
        "link": robot.links[foot.link].name,
        "translation": foot.sole.translation.vector.as_slice(),
        "rotation": turn.matrix().row_iter().map(|row| row.iter().copied().collect()).collect::<Vec<Vec<f64>>>(),
        "half_extents": foot.half_extents,
    })
}

fn at_rest(robot: &Robot) -> BaseState {
    BaseState {
        position: robot.base_pose.translation.vector,
        orientation: robot.base_pose.rotation,
        linear_velocity: Vector3::zeros(),
        angular_velocity: Vector3::zeros(),
    }
}

/// A base as the process takes it.
pub fn base_numbers(base: &BaseState) -> [f64; BASE] {
    let (p, q, v, w) = (
        base.position,
        base.orientation,
        base.linear_velocity,
        base.angular_velocity,
    );
    [p.x, p.y, p.z, q.w, q.i, q.j, q.k, v.x, v.y, v.z, w.x, w.y, w.z]
}

fn link_numbers(link: &Inertial) -> [f64; 10] {
    let (c, i) = (&link.com, &link.inertia);
    let i = [i.m11, i.m22, i.m33, i.m12, i.m13, i.m23];
    [link.mass, c.x, c.y, c.z, i[0], i[1], i[2], i[3], i[4], i[5]]
}

/// Mass properties where they are not those of the robot's files, which Python reads for itself: not numbers elsewhere.
fn link_changes(robot: &Robot, model: &World) -> impl Iterator<Item = f64> {
    let links = robot.links.iter().zip(&model.links);
    links.flat_map(|(link, now)| match link.inertial == *now {
        true => [f64::NAN; 10],
        false => link_numbers(now),
    })
}

/// Armature and viscous friction of every joint, likewise.
fn joint_changes(robot: &Robot, model: &World) -> impl Iterator<Item = f64> {
    let changed = |own: f64, now: f64| if own == now { f64::NAN } else { now };
    let joints = robot.joints.iter().zip(&model.joints);
    joints.flat_map(move |(joint, now)| {
        let own = joint.passive;
        [changed(own.armature, now.armature), changed(own.damping, now.damping)]
    })
}

impl Drop for Mujoco {
    fn drop(&mut self) {
        if let Some(process) = self.process.take() {
            self.shared.put_back(process);
        }
    }
}

impl Engine for Mujoco {
    fn worlds(&self) -> usize {
        self.worlds
    }

    fn reset(&mut self, world: usize, start: &Start, model: &World) {
        let base = match self.robot.base {
            Base::Floating => BaseState {
                position: start.position,
                orientation: start.orientation,
                linear_velocity: start.linear_velocity,
                angular_velocity: start.angular_velocity,
            },
            Base::Fixed => at_rest(&self.robot),
        };
        self.pushes[world] = Vector3::zeros();
        self.request.clear();
        self.put([world as f64]);
        self.put(base_numbers(&base));
        self.put(start.joints.iter().chain(&start.joint_velocities).copied());
        self.put([
            model.friction.tangential,
            model.friction.torsional,
            model.friction.rolling,
        ]);
        self.put(model.gravity.iter().copied());
        let shared = self.shared.clone();
        self.put(link_changes(&shared.robot, model));
        self.put(joint_changes(&shared.robot, model));
        self.exchange(b'r', world);
    }

    fn step(&mut self, drive: &Drive) {
        self.request.clear();
        let rows = [
            &drive.target,
            &drive.stiffness,
            &drive.damping,
            &drive.feed_forward,
            &drive.torque_min,
            &drive.torque_max,
            &drive.friction,
        ];
        rows.into_iter().for_each(|row| self.put(row.iter().copied()));
        for world in 0..self.worlds {
            let push = self.pushes[world];
            self.put([push.x, push.y, push.z]);
        }
        self.exchange(b's', 0);
    }

    fn joints(&self) -> &JointState {
        &self.joints
    }

    fn base(&self, world: usize) -> BaseState {
        self.bases[world]
    }

    fn foot_force(&self, world: usize, foot: usize) -> Vector3<f64> {
        self.forces[world * self.robot.feet.len() + foot]
    }

    fn foot_loads(&self) -> &[f64] {
        &self.loads
    }

    /// By the kinematics of the degrees of freedom.
    fn link_poses(&mut self, links: &[usize], poses: &mut [IsometryMatrix3<f64>]) {
        for world in 0..self.worlds {
            let base = self.bases[world];
            for (d, position) in self.positions.iter_mut().enumerate() {
                *position = self.joints.position[d * self.worlds + world];
            }
            let base = Isometry3::from_parts(base.position.into(), base.orientation);
            self.kinematics.set_pose(&self.robot, &base, &self.positions);
            for (k, &link) in links.iter().enumerate() {
                let pose = self.kinematics.pose(link);
                poses[k * self.worlds + world] =
                    IsometryMatrix3::from_parts(pose.translation, pose.rotation.to_rotation_matrix());
            }
        }
    }

    fn push(&mut self, world: usize, force: Vector3<f64>) {
        self.pushes[world] = force;
    }

    fn is_finite(&self, world: usize) -> bool {
        self.finite[world]
    }

    fn save(&self, _: usize, _: &mut Vec<u8>) {}

    fn load(&mut self, _: usize, _: &[u8]) -> Result<(), String> {
        Err("a world in MuJoCo cannot be restored".into())
    }
}
