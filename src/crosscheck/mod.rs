//! Believe nothing from one simulator: a policy, the engines and the observation against MuJoCo and a second reading of every
//! file. docs/crosscheck.md says what is compared and how the bounds come about.

pub mod check;
pub mod closed_loop;
pub mod dynamics;
pub mod engine;
pub mod momentum;
pub mod motions;
pub mod network;
pub mod observation;
pub mod page;
pub mod process;
pub mod python;
pub mod subject;
