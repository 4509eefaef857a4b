//! Rollouts and robot logs: MCAP files that ROS 2 tools, Foxglove and PlotJuggler open as they are.
//!
//! | topic | message | meaning |
//! |---|---|---|
//! | `/joint_states` | `sensor_msgs/msg/JointState` | measured position (rad or m), velocity, effort (N m or N) |
//! | `/joint_commands` | `sensor_msgs/msg/JointState` | position targets; a command holds until the next |
//! | `/imu` | `sensor_msgs/msg/Imu` | orientation of the base, angular velocity, linear acceleration |
//! | `/cmd_vel` | `geometry_msgs/msg/Twist` | desired velocity |
//! | `/odom` | `nav_msgs/msg/Odometry` | base pose and twist |
//! | `/battery` | `sensor_msgs/msg/BatteryState` | supply voltage |
//! | `/actuator_enabled` | `sensor_msgs/msg/JointState` or `std_msgs/msg/Bool` | whether motors are on: position 0 or 1 per joint, or one value for all |
//! | `/policy` | JSON | observation, action, reward terms |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | poses of the links; written for other programs, not read |
//! | `/robot_description` | `std_msgs/msg/String` | the URDF; written for other programs, not read |
//!
//! Messages are written in CDR with `ros2msg` schemas under the profile `ros2`; JSON with the same field names is
//! read as well.

mod cdr;
mod lengths;
pub mod messages;
mod reader;
mod wire;
mod writer;

use std::path::PathBuf;

use miette::Diagnostic;
use thiserror::Error;

use messages::{BatteryState, Imu, JointState, Odometry, PolicyStep, Text, Transforms, Twist};

pub use cdr::{Decoder, Encoder, Field};
pub use reader::{Entry, LogReader};
pub use wire::Schema;
pub use writer::LogWriter;

/// Why a log cannot be written or read.
#[derive(Debug, Error, Diagnostic)]
pub enum LogError {
    /// The file system said no.
    #[error("cannot use {}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file is not an MCAP file, or is damaged.
    #[error("{} is not a whole MCAP file: {why}", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// A message is not what its topic should carry.
    #[error("{}: message {index} of {topic}: {why}", .path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Number of the message in the file, from 0.
        index: u64,
        /// What is wrong with it.
        why: String,
    },
}

/// A message of one of the topics.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// `/joint_states`
    JointStates(JointState),
    /// `/joint_commands`
    JointCommands(JointState),
    /// `/imu`
    Imu(Imu),
    /// `/cmd_vel`
    CmdVel(Twist),
    /// `/odom`
    Odom(Box<Odometry>),
    /// `/battery`
    Battery(Box<BatteryState>),
    /// `/actuator_enabled`: position 0 or 1 per joint; one position without a name holds for all joints.
    Enabled(JointState),
    /// `/policy`
    Policy(PolicyStep),
    /// `/tf`
    Transforms(Transforms),
    /// `/robot_description`
    Description(Text),
}

impl Message {
    /// The topic it belongs to.
    pub fn topic(&self) -> &'static str {
        match self {
            Message::JointStates(_) => "/joint_states",
            Message::JointCommands(_) => "/joint_commands",
            Message::Imu(_) => "/imu",
            Message::CmdVel(_) => "/cmd_vel",
            Message::Odom(_) => "/odom",
            Message::Battery(_) => "/battery",
            Message::Enabled(_) => "/actuator_enabled",
            Message::Policy(_) => "/policy",
            Message::Transforms(_) => "/tf",
            Message::Description(_) => "/robot_description",
        }
    }

    /// The time in its header, ns; `None` for a message without a header or with an empty one.
    pub fn stamp(&self) -> Option<u64> {
        let header = match self {
            Message::JointStates(message) | Message::JointCommands(message) | Message::Enabled(message) => {
                &message.header
            }
            Message::Imu(message) => &message.header,
            Message::Odom(message) => &message.header,
            Message::Battery(message) => &message.header,
            Message::CmdVel(_) | Message::Policy(_) | Message::Transforms(_) | Message::Description(_) => return None,
        };
        Some(header.stamp.nanoseconds()).filter(|stamp| *stamp > 0)
    }
}

#[cfg(test)]
mod tests;
