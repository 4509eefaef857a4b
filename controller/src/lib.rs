//! Everything between the sensors and the joint targets, the same code in training, evaluation and on the robot.
//!
//! ```text
//! encoders, gyro, attitude, v_des --observe--> observation --normalise, network--> action --decode--> joint targets
//! ```
//!
//! [`Spec`] says what a policy's observation and action mean, [`Pipeline`] holds what one robot's loop remembers
//! between steps (estimator, command ramp, clock, filter, previous target), [`Inference`] runs the network. A [`Policy`] is
//! all of this in one file, and [`Controller`] its loop on a robot, with what to do when readings are stale, absurd or
//! those of a fallen robot. Nothing allocates after construction.

#![no_std]

extern crate alloc;
#[cfg(any(test, feature = "std"))]
extern crate std;

mod actor;
pub mod attitude;
mod controller;
pub mod estimator;
pub mod file;
mod filter;
mod golden;
mod kernel;
pub mod kinematics;
mod layout;
mod math;
mod mirror;
mod number;
mod pipeline;
mod policy;
mod row;
mod spec;
#[cfg(test)]
mod testing;
mod validate;
mod walker;
mod weights;
mod wiring;

pub use actor::{Activation, Actor, ActorError, Dense, Head, Inference};
pub use controller::*;
pub use file::FileError;
pub use golden::{GOLDEN_TOLERANCE, Golden, GoldenAction, GoldenError, GoldenStep};
pub use layout::BlockLayout;
pub use pipeline::{Pipeline, Sensors};
pub use policy::{Bounds, Curriculum, Identity, Policy, PolicyError};
pub use row::{ROW, RowObserver, Turn};
pub use spec::*;
pub use validate::{MAX_JOINTS, SpecError};
pub use walker::OutOfRange;
pub use weights::{Precision, Weights};
pub use wiring::Misfit;
