//! Everything between the sensors and the joint targets, the same code in training, evaluation and on the robot.
//!
//! ```text
//! encoders, gyro, attitude, v_des --observe--> observation --normalise, network--> action --decode--> joint targets
//! ```
//!
//! [`Spec`] says what a policy's observation and action mean, [`Pipeline`] holds what one robot's loop remembers
//! between steps (estimator, command ramp, clock, filter, previous target). Nothing allocates after construction.

#![no_std]

extern crate alloc;
#[cfg(test)]
extern crate std;

pub mod attitude;
pub mod estimator;
mod filter;
pub mod kinematics;
mod math;
mod mirror;
mod pipeline;
mod spec;
#[cfg(test)]
mod testing;
mod validate;

pub use pipeline::{Pipeline, Sensors};
pub use spec::*;
pub use validate::SpecError;
