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

mod spec;

pub use spec::*;
