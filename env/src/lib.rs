//! Robot, engines, sensors, actuators and the walking task: a batch of environments.
//!
//! ```text
//! actions --Pipeline::decode--> targets --Actuators--> Drive --Engine--> state --sensors--> Pipeline::observe--> observations
//!                                                                          \--truth--> reward, end
//! ```

pub mod actuators;
pub mod batch;
mod clock;
pub mod config;
pub mod effect;
pub mod engine;
mod error;
pub mod ground;
pub mod plant;
pub mod probe;
pub mod random;
pub mod robot;
pub mod sensors;
pub mod task;
pub mod truth;

pub use batch::Batch;
pub use config::EnvConfig;
pub use error::EnvError;
