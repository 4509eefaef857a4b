//! The parts the command line is made of: configuration, the run folder, logs and what `inspect` says of a file.

pub mod config;
pub mod inspect;
pub mod log;
pub mod run;
