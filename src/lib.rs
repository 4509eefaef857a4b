//! The parts the command line is made of: configuration, training, evaluation, the run folder, pictures.

pub mod command;
pub mod complaint;
pub mod config;
pub mod crosscheck;
pub mod deployed;
pub mod eval;
pub mod export;
pub mod files;
pub mod init;
pub mod inspect;
#[cfg(unix)]
pub mod rehearse;
pub mod report;
pub mod run;
pub mod settings;
pub mod telemetry;
pub mod terminal;
pub mod train;
pub mod view;
