//! What a robot tells of itself, as the messages of a log: readings, commands, poses of its links, its description.

use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, Vector3 as Vector};
use omniwalk_env::engine::BaseState;
use omniwalk_env::robot::Robot;
use omniwalk_env::sensors::Reading;
use omniwalk_sim2real::log::Message;
use omniwalk_sim2real::log::messages::{
    Header, Imu, JointState, Odometry, Point, Pose, PoseWithCovariance, Quaternion, Text, Transform, TransformStamped,
    Transforms, Twist, TwistWithCovariance, Vector3,
};

/// The frame that odometry is given in.
pub const ODOM: &str = "odom";
/// The frame of the base link, of the IMU and of the base's twist.
pub const BASE: &str = "base";

/// Makes the messages of one robot.
pub struct Telemetry {
    robot: Arc<Robot>,
    names: Vec<String>,
    drivers: Vec<(usize, f64, f64)>,
}

impl Telemetry {
    /// For `robot`.
    pub fn new(robot: &Arc<Robot>) -> Self {
        let names = (0..robot.policy.len()).map(|i| robot.policy_joint(i).name.clone());
        Self {
            names: names.collect(),
            drivers: robot.drivers(),
            robot: robot.clone(),
        }
    }

    /// Positions (rad or m), velocities and efforts of the policy's joints, at `time`, ns.
    pub fn joints(&self, time: u64, position: Vec<f64>, velocity: Vec<f64>, effort: Vec<f64>) -> JointState {
        JointState {
            header: Header::new(time, ""),
            name: self.names.clone(),
            position,
            velocity,
            effort,
        }
    }

    /// What the sensors say at `time` (ns), with the orientation an IMU would give, and what is desired (m/s, m/s, rad/s).
    pub fn reading(
        &self,
        time: u64,
        reading: &Reading,
        effort: Vec<f64>,
        base: &BaseState,
        desired: [f32; 3],
    ) -> [Message; 3] {
        let joints = self.joints(time, wide(&reading.position), wide(&reading.velocity), effort);
        let [x, y, z] = reading.gyro.map(f64::from);
        let imu = Imu {
            header: Header::new(time, BASE),
            orientation: quaternion(&base.orientation),
            angular_velocity: Vector3 { x, y, z },
            ..Imu::default()
        };
        [
            Message::JointStates(joints),
            Message::Imu(imu),
            command(desired.map(f64::from)),
        ]
    }

    /// Targets of the policy's joints, rad or m.
    pub fn targets(&self, time: u64, targets: &[f32]) -> Message {
        Message::JointCommands(self.joints(time, wide(targets), Vec::new(), Vec::new()))
    }

    /// Poses of the links with the base in `base` and the degrees of freedom at `positions` (rad or m): one tree from
    /// [`ODOM`] over [`BASE`] to the frames of the URDF.
    pub fn transforms(&self, time: u64, base: &BaseState, positions: &[f64]) -> Message {
        let root = self.robot.links[0].name.as_str();
        let pose = Isometry3::from_parts(Translation3::from(base.position), base.orientation);
        let mut transforms = vec![transform(time, ODOM, BASE, &pose)];
        if root != BASE {
            transforms.push(transform(time, BASE, root, &Isometry3::identity()));
        }
        let joints = self.robot.joints.iter().zip(&self.drivers).enumerate();
        transforms.extend(joints.map(|(i, (joint, &(dof, multiplier, offset)))| {
            let links = &self.robot.links;
            let pose = joint.pose(multiplier * positions[dof] + offset);
            transform(time, &links[joint.parent].name, &links[i + 1].name, &pose)
        }));
        Message::Transforms(Transforms { transforms })
    }

    /// The URDF.
    pub fn description(&self) -> Message {
        Message::Description(Text {
            data: self.robot.urdf.clone(),
        })
    }
}

/// A desired velocity, m/s, m/s, rad/s.
pub fn command([x, y, turn]: [f64; 3]) -> Message {
    Message::CmdVel(Twist {
        linear: Vector3 { x, y, z: 0.0 },
        angular: Vector3 {
            x: 0.0,
            y: 0.0,
            z: turn,
        },
    })
}

/// The true motion of the base at `time`, ns.
pub fn odometry(time: u64, base: &BaseState) -> Message {
    let [x, y, z] = base.position.into();
    let pose = Pose {
        position: Point { x, y, z },
        orientation: quaternion(&base.orientation),
    };
    let own = |v: Vector<f64>| vector(base.orientation.inverse() * v);
    let twist = Twist {
        linear: own(base.linear_velocity),
        angular: own(base.angular_velocity),
    };
    Message::Odom(Box::new(Odometry {
        header: Header::new(time, ODOM),
        child_frame_id: BASE.to_owned(),
        pose: PoseWithCovariance {
            pose,
            ..PoseWithCovariance::default()
        },
        twist: TwistWithCovariance {
            twist,
            ..TwistWithCovariance::default()
        },
    }))
}

/// A rotation as messages have it.
pub fn quaternion(q: &nalgebra::UnitQuaternion<f64>) -> Quaternion {
    Quaternion {
        x: q.i,
        y: q.j,
        z: q.k,
        w: q.w,
    }
}

/// A vector as messages have it.
pub fn vector(v: Vector<f64>) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

/// Numbers as messages have them.
pub fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x)).collect()
}

fn transform(time: u64, parent: &str, child: &str, pose: &Isometry3<f64>) -> TransformStamped {
    TransformStamped {
        header: Header::new(time, parent),
        child_frame_id: child.to_owned(),
        transform: Transform {
            translation: vector(pose.translation.vector),
            rotation: quaternion(&pose.rotation),
        },
    }
}
