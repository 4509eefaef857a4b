//! What must hold for every file from outside, whatever is in it: it is read or refused, and what is read can be used.
//!
//! Each module has one `check(bytes)`. The fuzzer's targets call it, and so does an ordinary test of the project
//! (`tests/hostile_files.rs`) with everything in `fuzz/corpus` and with mutations of it, under bounds on time and memory.

pub mod checkpoint;
pub mod columns;
pub mod config;
pub mod log;
pub mod policy_file;
pub mod robot_toml;
mod scratch;
pub mod urdf;
