//! `omniwalk eval`: what a policy's mode does at given commands, as table, JSON and rollouts.

pub mod rollout;
pub mod suite;
pub mod table;
