//! Proximal policy optimisation (Schulman et al. 2017) for continuous actions on the CPU. Knows nothing of robots.
//!
//! An [`Agent`] holds an actor and a critic, two multi-layer perceptrons of the same shape. It [acts](Agent::act) on
//! batches of observations; the caller fills a [`Rollout`] with what came of it; the agent [learns](Agent::update) from
//! it. All buffers are flat, row-major `f32`; a row is a sample.
//!
//! Given the same calls, the same bits come out with any number of threads, and from an agent that was
//! [saved](Agent::save) and [loaded](Agent::load) in between. The bits differ between instruction sets.

mod adam;
mod agent;
mod bench;
mod config;
mod distribution;
mod elementwise;
#[cfg(test)]
mod finite_differences;
mod floats;
mod gae;
mod matrix;
mod network;
mod normaliser;
mod rollout;
mod simd;
mod special;
mod state;
mod update;

pub use agent::{Agent, Inference, Layer, Policy};
pub use bench::{BenchResult, bench, peak_gflops};
pub use config::{Activation, Config, Head, InvalidConfig, Schedule};
pub use distribution::{Beta, Differentiated, Gaussian};
pub use rollout::{End, Mirror, Rollout};
pub use simd::instruction_set;
pub use state::{StateError, Tensor, TensorData};
pub use update::UpdateStats;
