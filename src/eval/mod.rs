//! `omniwalk eval`: what a policy's mode does, as tables, JSON, pictures and rollouts.
//!
//! By itself it plays the commands of a run's configuration ([`forward`]). The suites of the thesis's evaluation (7.5;
//! [`suites`]) are made of [`trial`]s side by side, each with a [`meter`], and give figures with confidence intervals
//! ([`stats`]).

pub mod changes;
pub mod falls;
pub mod firsts;
pub mod forward;
pub mod hold;
pub mod meter;
pub mod pictures;
pub mod player;
pub mod push;
pub mod pushing;
pub mod rollout;
pub mod stats;
pub mod suites;
pub mod summary;
pub mod table;
pub mod tour;
pub mod tracking;
pub mod trial;
