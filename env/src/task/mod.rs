//! The walking task (thesis 7.3): commands, reward, termination, and the measures by which a gait is judged.

pub mod command;
mod draws;
pub mod environment;
pub mod episode;
pub mod gait;
mod judge;
pub mod overlap;
pub mod poses;
pub mod reward;
mod saved;
pub mod shared;
pub mod sole;
pub mod tracking;

#[cfg(test)]
mod tests;
