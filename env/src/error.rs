//! What can go wrong when a batch of environments is made.

use crate::engine::EngineError;

/// Robot and configuration do not fit together.
#[derive(Clone, Debug, PartialEq, thiserror::Error, miette::Diagnostic)]
pub enum EnvError {
    /// The robot has no joint for a policy.
    #[error("robot `{robot}` has no joint the policy could move; name some under `policy` in its robot.toml")]
    NoPolicyJoints {
        /// The robot.
        robot: String,
    },
    /// The robot is bolted to the world.
    #[error("robot `{robot}` has a fixed base and cannot walk; walking needs a floating base")]
    FixedBase {
        /// The robot.
        robot: String,
    },
    /// The robot has nothing to walk on.
    #[error("robot `{robot}` has no feet and cannot walk; describe its soles under `[[foot]]` in its robot.toml")]
    NoFeet {
        /// The robot.
        robot: String,
    },
    /// A configured joint is not among the policy's.
    #[error("{key}: no policy joint matches `{name}`; the robot has {known}")]
    UnknownJoint {
        /// The configuration key.
        key: &'static str,
        /// What was given.
        name: String,
        /// What there is.
        known: String,
    },
    /// Mirroring is switched on for a robot without a mirror map.
    #[error(
        "train.mirror: robot `{robot}` has no left-right mirror map; give it one in its robot.toml, or set train.mirror = false"
    )]
    NoMirror {
        /// The robot.
        robot: String,
    },
    /// The engine does not take this robot.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The layout of observation and action is not one the controller can run.
    #[error("robot and configuration give the controller an impossible layout: {0}")]
    Layout(String),
    /// A saved state does not fit.
    #[error("the saved environments do not fit: {0}")]
    State(String),
}
