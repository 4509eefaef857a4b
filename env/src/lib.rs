//! Robot, engines, sensors, actuators and the walking task: a batch of environments.

pub mod engine;
pub mod robot;
