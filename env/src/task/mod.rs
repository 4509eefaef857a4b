//! The walking task (thesis 7.3): commands, reward, termination, and the measures by which a gait is judged.

pub mod command;
pub mod environment;
pub mod gait;
pub mod overlap;
pub mod reward;
pub mod shared;
pub mod tracking;
