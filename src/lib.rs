//! The parts the command line is made of: configuration, training, evaluation, the run folder, pictures.

pub mod command;
pub mod complaint;
pub mod config;
pub mod eval;
pub mod inspect;
pub mod report;
pub mod run;
pub mod settings;
pub mod train;
