//! Logs of robots and rollouts, and what they say about the simulation.
//!
//! ```text
//! MCAP, CSV, JSON --recording--> Recording: what each joint was told and did, each quantity on its own clock
//!                                   \--check--> figures, remarks, and why no answer may be had from it
//! Recordings, robot --identify--> which effect the simulation lacks, the robot with it, errors before and after
//! robot --excite--> motions to record, as MCAP and CSV
//! ```

pub mod check;
pub mod excite;
pub mod identify;
pub mod log;
pub mod recording;
