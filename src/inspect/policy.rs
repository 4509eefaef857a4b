//! Describes a policy file.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use omniwalk_controller::file::MAX_LEN;
use omniwalk_controller::{ActionSpec, FilterSpec, Policy, Spec};

use super::InspectError;

pub(super) fn describe(path: &Path) -> Result<String, InspectError> {
    let io = |why| InspectError::Io {
        path: path.to_owned(),
        why,
    };
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_LEN as u64 + 1).read_to_end(&mut bytes))
        .map_err(io)?;
    let policy = Policy::from_bytes(&bytes).map_err(|error| InspectError::Damaged {
        path: path.to_owned(),
        why: error.to_string(),
    })?;
    let (identity, actor, golden) = (policy.identity(), policy.actor(), policy.golden());
    let mut text = format!(
        "policy of {} policy steps, seed {}, by {}\n",
        identity.steps, identity.seed, identity.program
    );
    let hash: String = identity.config_hash.iter().map(|byte| format!("{byte:02x}")).collect();
    text += &format!("  configuration {hash}\n");
    let [least, most] = identity.latency;
    text += &format!("  trained with a latency from {least} to {most} s\n");
    text += &spec(policy.spec());
    let widths: Vec<_> = actor.layers.iter().map(|layer| layer.bias.len().to_string()).collect();
    let (inputs, widths) = (actor.observation_len(), widths.join(" - "));
    text += &format!(
        "  network {inputs} - {widths}, {:?}, head {:?}\n",
        actor.activation, actor.head
    );
    text += &format!(
        "  reproduces its golden vectors: {} actions, {} steps\n",
        golden.actions.len(),
        golden.steps.len()
    );
    Ok(text)
}

fn spec(spec: &Spec) -> String {
    let mut text = format!(
        "  {} Hz, observation of {} numbers:",
        spec.control_hz,
        spec.observation_len()
    );
    for &block in &spec.observation {
        text += &format!(" {block:?} {}", spec.block_len(block));
    }
    text += &format!("\n  action: {}\n", action(&spec.action));
    if let Some(clock) = &spec.clock {
        let symmetric = if spec.symmetry.is_some() {
            ", symmetric: the second half mirrors the first"
        } else {
            ""
        };
        text += &format!("  clock with a period of {} s{symmetric}\n", clock.period);
    }
    let command = &spec.command;
    text += &format!(
        "  commands from {:?} to {:?} m/s, m/s, rad/s\n",
        command.lower, command.upper
    );
    text += &format!("  {} joints\n", spec.joints.len());
    let width = spec
        .joints
        .iter()
        .map(|joint| joint.name.chars().count())
        .max()
        .unwrap_or(0);
    for joint in &spec.joints {
        text += &format!(
            "    {:<width$}  nominal {:.4}, limits {:.4} to {:.4}, scale {:.4}, kp {}, kd {}, torque limit {}\n",
            joint.name,
            joint.nominal,
            joint.lower,
            joint.upper,
            joint.action_scale,
            joint.kp,
            joint.kd,
            joint.torque_limit
        );
    }
    text
}

fn action(action: &ActionSpec) -> String {
    let filter = match action.filter {
        None => "no filter".to_owned(),
        Some(FilterSpec::Exponential { gain }) => format!("exponential filter with gain {gain}"),
        Some(FilterSpec::Butterworth { cutoff_hz }) => format!("second-order Butterworth at {cutoff_hz} Hz"),
    };
    let clamp = if action.torque_clamp {
        ", clamped to the torque limit"
    } else {
        ""
    };
    format!("{:?}, {filter}{clamp}", action.law)
}
