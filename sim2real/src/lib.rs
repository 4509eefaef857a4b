//! Logs of robots and rollouts, and what they say about the simulation.
//!
//! ```text
//! MCAP, CSV, JSON --recording--> Recording: what each joint was told and did, each quantity on its own clock
//! ```

pub mod log;
pub mod recording;
