//! Messages as other programs take them: what describes them, and their bytes.

use serde_json::json;

use super::Message;
use super::cdr::{self, Field};

/// What describes the messages of a topic to a program that has not met them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// Name of the message's type, such as `sensor_msgs/msg/Imu`.
    pub name: String,
    /// How the text is written: `ros2msg` or `jsonschema`.
    pub encoding: &'static str,
    /// The definition.
    pub text: String,
    /// How messages are written: `cdr` or `json`.
    pub message_encoding: &'static str,
}

impl Message {
    /// The schema of its topic.
    pub fn schema(&self) -> Schema {
        match self {
            Message::JointStates(message) | Message::JointCommands(message) | Message::Enabled(message) => ros(message),
            Message::Battery(message) => ros(message.as_ref()),
            Message::Imu(message) => ros(message),
            Message::CmdVel(message) => ros(message),
            Message::Odom(message) => ros(message.as_ref()),
            Message::Transforms(message) => ros(message),
            Message::Description(message) => ros(message),
            Message::Policy(_) => Schema {
                name: "omniwalk.PolicyStep".to_owned(),
                encoding: "jsonschema",
                text: policy(),
                message_encoding: "json",
            },
        }
    }

    /// Its bytes, in the encoding that its schema names.
    ///
    /// # Errors
    /// None for messages with numbers and texts; what JSON cannot hold.
    pub fn bytes(&self) -> Result<Vec<u8>, serde_json::Error> {
        Ok(match self {
            Message::JointStates(message) | Message::JointCommands(message) | Message::Enabled(message) => {
                cdr::encode(message)
            }
            Message::Battery(message) => cdr::encode(message.as_ref()),
            Message::Imu(message) => cdr::encode(message),
            Message::CmdVel(message) => cdr::encode(message),
            Message::Odom(message) => cdr::encode(message.as_ref()),
            Message::Transforms(message) => cdr::encode(message),
            Message::Description(message) => cdr::encode(message),
            Message::Policy(step) => serde_json::to_vec(step)?,
        })
    }
}

fn ros<T: Field>(_: &T) -> Schema {
    Schema {
        name: T::type_name().replace('/', "/msg/"),
        encoding: "ros2msg",
        text: cdr::schema::<T>(),
        message_encoding: "cdr",
    }
}

fn policy() -> String {
    let numbers = json!({ "type": "array", "items": { "type": "number" } });
    json!({
        "title": "omniwalk.PolicyStep",
        "type": "object",
        "properties": {
            "observation": numbers,
            "action": numbers,
            "reward": { "type": "object", "additionalProperties": { "type": "number" } },
        },
    })
    .to_string()
}
