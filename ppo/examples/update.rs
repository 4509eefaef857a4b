//! One update, for the comparison with another implementation: `cargo run --release -p omniwalk-ppo --example update < CASE`.
//!
//! Reads configuration, weights and rollout as JSON (see tests/support/case.rs) and writes losses, and every array of the networks and of
//! Adam after the update by its name.

#[path = "../tests/support/case.rs"]
mod case;

use std::collections::BTreeMap;
use std::io::{BufReader, stdin};

use case::Case;
use omniwalk_ppo::TensorData;
use serde_json::json;

fn main() -> serde_json::Result<()> {
    let case: Case = serde_json::from_reader(BufReader::new(stdin()))?;
    let mut agent = case.agent(case.config.epochs);
    let stats = agent.update(&case.rollout(), None, 1);
    let arrays: BTreeMap<String, Vec<f32>> = agent
        .save()
        .into_iter()
        .filter_map(|tensor| match tensor.data {
            TensorData::F32(values) => Some((tensor.name, values)),
            _ => None,
        })
        .collect();
    let found = json!({
        "policy_loss": stats.policy_loss,
        "value_loss": stats.value_loss,
        "entropy": stats.entropy,
        "clip_fraction": stats.clip_fraction,
        "steps": stats.steps,
        "arrays": arrays,
    });
    println!("{found}");
    Ok(())
}
