//! Training: one run in memory, what is measured of it, and how it becomes a checkpoint.

pub mod checkpoint;
mod collect;
pub mod conclusion;
pub mod health;
pub mod metrics;
pub mod origin;
pub mod progress;
pub mod shape;
pub mod trainer;
pub mod transfer;
pub mod window;
