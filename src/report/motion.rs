//! A rollout as pictures need it: poses from the log by forward kinematics, sole heights, velocities, gait cycles.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use omniwalk_env::robot::{Base, Kinematics, Robot};

use super::ReportError;
use omniwalk_sim2real::log::messages::{self, Imu, JointState, Odometry, Twist};
use omniwalk_sim2real::log::{LogReader, Message};

/// A foot whose lowest sole corner is below this counts as on the ground, m.
pub const CONTACT_HEIGHT: f64 = 0.01;
/// Frames that are read of a log; ten minutes at 100 Hz.
const MAX_FRAMES: usize = 60_000;
/// Durations a gait cycle can have, s.
const CYCLE: std::ops::Range<f64> = 0.3..2.5;

/// A recorded episode.
pub struct Motion {
    /// The log.
    pub path: PathBuf,
    /// Its moments in time order; at least two.
    pub frames: Vec<Frame>,
}

/// A moment of an episode.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Since the beginning of the log, s.
    pub time: f64,
    /// Pose of the base link in the world.
    pub base: Isometry3<f64>,
    /// Measured positions of the degrees of freedom, rad or m; nominal where the log has none.
    pub positions: Vec<f64>,
    /// Measured velocities of the degrees of freedom, rad/s or m/s; not a number where the log has none.
    pub velocities: Vec<f64>,
    /// Measured efforts, N m or N; not a number where the log has none.
    pub efforts: Vec<f64>,
    /// Targets, rad or m; not a number before the first and where the log has none.
    pub targets: Vec<f64>,
    /// Desired velocity: forward and left, m/s, turning, rad/s.
    pub command: [f64; 3],
    /// Velocity of the base along and across its heading, m/s, and of the heading, rad/s.
    pub velocity: [f64; 3],
    /// Height of each foot's lowest sole corner, m.
    pub soles: Vec<f64>,
}

impl Motion {
    /// Reads the log at `path` of an episode of `robot`. Of a log without `/odom` there is a frame for each message of
    /// `/joint_states`, with the base turned as the IMU says and the lowest sole on the ground.
    ///
    /// # Errors
    /// [`omniwalk_sim2real::log::LogError`] for a damaged log, [`ReportError::Rollout`] for one that holds too little or values that are no
    /// pose of this robot.
    pub fn read(path: &Path, robot: &Robot) -> miette::Result<Self> {
        let wrong = |why: String| ReportError::Rollout {
            path: path.to_owned(),
            why,
        };
        let mut pose = Pose::new(robot);
        let (mut frames, mut still) = (Vec::new(), Vec::new());
        for entry in LogReader::open(path)? {
            let entry = entry?;
            match &entry.message {
                Some(Message::JointStates(joints)) => {
                    pose.joints(joints);
                    if frames.is_empty() && still.len() < MAX_FRAMES {
                        still.extend(pose.still(entry.time));
                    }
                }
                Some(Message::JointCommands(joints)) => pose.targets(joints),
                Some(Message::Imu(imu)) => pose.imu(imu),
                Some(Message::CmdVel(twist)) => pose.command(twist),
                Some(Message::Odom(odometry)) => {
                    let frame = pose.frame(entry.time, odometry);
                    frames.push(frame.ok_or_else(|| wrong(format!("the pose at {} ns is not finite", entry.time)))?);
                }
                _ => {}
            }
            if frames.len() == MAX_FRAMES {
                break;
            }
        }
        if frames.is_empty() {
            frames = still;
        }
        if frames.len() < 2 {
            return Err(
                wrong("it holds no motion: fewer than two messages of /odom or /joint_states".to_owned()).into(),
            );
        }
        if !pose.known {
            return Err(wrong(format!("none of its joints is one of robot {}", robot.name)).into());
        }
        let start = frames[0].time;
        frames.iter_mut().for_each(|frame| frame.time -= start);
        Ok(Self {
            path: path.to_owned(),
            frames,
        })
    }

    /// Duration, s.
    pub fn seconds(&self) -> f64 {
        self.frames[self.frames.len() - 1].time
    }

    /// Desired speed in the middle of the log, from where the pictures are, m/s.
    pub fn speed(&self) -> f64 {
        let [x, y, _] = self.at(self.seconds() / 2.0).command;
        x.hypot(y)
    }

    /// The first frame at or after `time`, or the last.
    pub fn at(&self, time: f64) -> &Frame {
        let index = self.frames.partition_point(|frame| frame.time < time - 1e-6);
        &self.frames[index.min(self.frames.len() - 1)]
    }

    /// Whether `foot` is on the ground in each frame.
    pub fn contacts(&self, foot: usize) -> impl Iterator<Item = bool> + '_ {
        self.frames.iter().map(move |frame| frame.soles[foot] < CONTACT_HEIGHT)
    }

    /// Times between which a foot is on the ground.
    pub fn stances(&self, foot: usize) -> Vec<(f64, f64)> {
        let mut stances: Vec<(f64, f64)> = Vec::new();
        let mut before = false;
        for (contact, frame) in self.contacts(foot).zip(&self.frames) {
            match stances.last_mut() {
                Some(stance) if before => stance.1 = frame.time,
                _ if contact => stances.push((frame.time, frame.time)),
                _ => {}
            }
            before = contact;
        }
        stances
    }

    /// Begin and end of a gait cycle of the first foot from the middle of the episode on; none where the robot takes no such steps.
    pub fn cycle(&self, robot: &Robot) -> Option<(f64, f64)> {
        let middle = self.seconds() / 2.0;
        let stances = if robot.feet.is_empty() {
            Vec::new()
        } else {
            self.stances(0)
        };
        let touchdowns: Vec<f64> = stances.iter().map(|s| s.0).filter(|&t| t >= middle).collect();
        let cycle = touchdowns.windows(2).find(|pair| CYCLE.contains(&(pair[1] - pair[0])));
        cycle.map(|pair| (pair[0], pair[1]))
    }

    /// A second from the middle of the episode on, for what has no gait cycle.
    pub fn second(&self) -> (f64, f64) {
        let middle = self.seconds() / 2.0;
        (middle, self.seconds().min(middle + 1.0))
    }
}

/// What the messages so far say of the robot.
struct Pose<'a> {
    robot: &'a Robot,
    kinematics: Kinematics,
    positions: Vec<f64>,
    velocities: Vec<f64>,
    efforts: Vec<f64>,
    targets: Vec<f64>,
    command: [f64; 3],
    orientation: UnitQuaternion<f64>,
    /// Whether a joint of the robot was named.
    known: bool,
}

impl<'a> Pose<'a> {
    fn new(robot: &'a Robot) -> Self {
        Self {
            robot,
            kinematics: Kinematics::new(robot),
            positions: robot.nominal(),
            velocities: vec![f64::NAN; robot.dofs.len()],
            efforts: vec![f64::NAN; robot.dofs.len()],
            targets: vec![f64::NAN; robot.dofs.len()],
            command: [0.0; 3],
            orientation: robot.base_pose.rotation,
            known: false,
        }
    }

    fn dof(&self, name: &str) -> Option<usize> {
        (0..self.positions.len()).find(|&d| self.robot.dof(d).name == *name)
    }

    fn joints(&mut self, joints: &JointState) {
        for (i, name) in joints.name.iter().enumerate() {
            let Some(dof) = self.dof(name) else { continue };
            self.known = true;
            let rows = [
                (&mut self.positions, &joints.position),
                (&mut self.velocities, &joints.velocity),
                (&mut self.efforts, &joints.effort),
            ];
            for (own, values) in rows {
                own[dof] = values.get(i).copied().unwrap_or(own[dof]);
            }
        }
    }

    fn targets(&mut self, joints: &JointState) {
        for (name, &target) in joints.name.iter().zip(&joints.position) {
            if let Some(dof) = self.dof(name) {
                self.targets[dof] = target;
            }
        }
    }

    fn imu(&mut self, imu: &Imu) {
        // -1 says that the unit gives no orientation.
        if imu.orientation_covariance.0[0] >= 0.0 {
            self.orientation = rotation(&imu.orientation).unwrap_or(self.orientation);
        }
    }

    /// What joints and IMU say without odometry.
    fn still(&mut self, nanoseconds: u64) -> Option<Frame> {
        let mut base = self.robot.base_pose;
        if self.robot.base == Base::Floating {
            base.rotation = self.orientation;
            self.kinematics.set_pose(self.robot, &base, &self.positions);
            let lowest = (0..self.robot.feet.len())
                .map(|foot| self.sole(foot))
                .fold(f64::INFINITY, f64::min);
            base.translation.z -= if lowest.is_finite() { lowest } else { 0.0 };
        }
        self.at(nanoseconds, base, [0.0; 3])
    }

    fn command(&mut self, twist: &Twist) {
        self.command = [twist.linear.x, twist.linear.y, twist.angular.z];
    }

    fn frame(&mut self, nanoseconds: u64, odometry: &Odometry) -> Option<Frame> {
        let (pose, twist) = (&odometry.pose.pose, &odometry.twist.twist);
        let orientation = rotation(&pose.orientation)?;
        let base = Isometry3::from_parts(
            Translation3::new(pose.position.x, pose.position.y, pose.position.z),
            orientation,
        );
        let world = |v: &messages::Vector3| orientation * Vector3::new(v.x, v.y, v.z);
        let (linear, angular) = (world(&twist.linear), world(&twist.angular));
        let forward = heading(&base);
        let velocity = [
            linear.dot(&forward),
            linear.dot(&Vector3::z().cross(&forward)),
            angular.z,
        ];
        self.at(nanoseconds, base, velocity)
    }

    fn at(&mut self, nanoseconds: u64, base: Isometry3<f64>, velocity: [f64; 3]) -> Option<Frame> {
        self.kinematics.set_pose(self.robot, &base, &self.positions);
        let frame = Frame {
            time: nanoseconds as f64 * 1e-9,
            base,
            positions: self.positions.clone(),
            velocities: self.velocities.clone(),
            efforts: self.efforts.clone(),
            targets: self.targets.clone(),
            command: self.command,
            velocity,
            soles: (0..self.robot.feet.len()).map(|foot| self.sole(foot)).collect(),
        };
        frame.is_finite().then_some(frame)
    }

    /// Height of the lowest corner, m.
    fn sole(&self, foot: usize) -> f64 {
        let foot = &self.robot.feet[foot];
        let pose = self.kinematics.pose(foot.link);
        foot.corners()
            .iter()
            .map(|corner| (pose * corner).z)
            .fold(f64::INFINITY, f64::min)
    }
}

fn rotation(q: &messages::Quaternion) -> Option<UnitQuaternion<f64>> {
    UnitQuaternion::try_new(Quaternion::new(q.w, q.x, q.y, q.z), 1e-6)
}

impl Frame {
    fn is_finite(&self) -> bool {
        let numbers = self
            .command
            .iter()
            .chain(&self.velocity)
            .chain(&self.positions)
            .chain(&self.soles);
        let position = &self.base.translation.vector;
        numbers.chain(position.iter()).all(|x| x.is_finite() && x.abs() < 1e6)
    }
}

/// Horizontal direction of the base's x axis in the world; the world's own where the base looks straight up or down.
pub fn heading(base: &Isometry3<f64>) -> Vector3<f64> {
    let forward = base.rotation * Vector3::x();
    Vector3::new(forward.x, forward.y, 0.0)
        .try_normalize(1e-6)
        .unwrap_or_else(Vector3::x)
}

/// Degrees of freedom of the leg that ends at the first foot, from the base down; empty for a robot without feet.
pub fn leg(robot: &Robot) -> Vec<usize> {
    let mut link = robot.feet.first().map_or(0, |foot| foot.link);
    let mut chain = Vec::new();
    while link > 0 {
        chain.extend(robot.dofs.iter().position(|&joint| joint == link - 1));
        link = robot.joints[link - 1].parent;
    }
    chain.reverse();
    chain
}

/// Those of `dofs` that turn about the base's left-right axis when all positions are zero: hip pitch, knee, ankle pitch.
pub fn pitch(robot: &Robot, dofs: &[usize]) -> Vec<usize> {
    let mut kinematics = Kinematics::new(robot);
    kinematics.set_pose(robot, &Isometry3::identity(), &vec![0.0; robot.dofs.len()]);
    let about_y = |&&dof: &&usize| {
        let axis = kinematics.pose(robot.dofs[dof] + 1) * robot.dof(dof).axis.into_inner();
        axis.y.abs() > 0.7
    };
    dofs.iter().filter(about_y).copied().collect()
}
