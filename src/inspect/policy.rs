//! Describes a policy file.

use std::path::Path;

use miette::Report;
use omniwalk_controller::{ActionSpec, FilterSpec, Identity, Leg, Policy, Spec};

use crate::command::load;

pub(super) fn describe(path: &Path) -> Result<String, Report> {
    let policy = load::policy(path)?;
    let (identity, actor, golden) = (policy.identity(), policy.actor(), policy.golden());
    let mut text = format!(
        "policy of {} policy steps, seed {}, by {}\n",
        identity.steps, identity.seed, identity.program
    );
    let hash: String = identity.config_hash.iter().map(|byte| format!("{byte:02x}")).collect();
    text += &format!("  configuration {hash}\n");
    text += &training(identity);
    text += &spec(policy.spec());
    text += &bounds(&policy);
    text += &normaliser(&policy);
    let widths: Vec<_> = actor.layers.iter().map(|layer| layer.bias.len().to_string()).collect();
    let (inputs, widths) = (actor.observation_len(), widths.join(" - "));
    text += &format!(
        "  network {inputs} - {widths}, {}, head {}, weights in {}\n",
        actor.activation.name(),
        actor.head.name(),
        policy.precision()
    );
    text += &format!(
        "  reproduces its golden vectors: {} actions, {} steps\n",
        golden.actions.len(),
        golden.steps.len()
    );
    Ok(text)
}

fn training(identity: &Identity) -> String {
    let ([least, most], curriculum) = (identity.latency, &identity.curriculum);
    format!(
        "  trained with a latency from {least} to {most} s\n  \
         the curriculum had reached {:?} to {:?} m/s, m/s, rad/s, C_v {:.2}, C_foot {:.2}\n",
        curriculum.lower, curriculum.upper, curriculum.velocity_factor, curriculum.foot_factor
    )
}

/// The entries that training saw in the narrowest and the widest range.
fn bounds(policy: &Policy) -> String {
    let bounds = policy.bounds();
    let sizes = bounds
        .lower
        .iter()
        .zip(&bounds.upper)
        .map(|(lower, upper)| upper - lower);
    let sizes: Vec<f32> = sizes.collect();
    let order = |a: &usize, b: &usize| sizes[*a].total_cmp(&sizes[*b]);
    let entry = |index: Option<usize>| {
        let index = index.unwrap_or(0);
        let name = policy.spec().entry_name(index).unwrap_or_default();
        format!("{name} from {:.4} to {:.4}", bounds.lower[index], bounds.upper[index])
    };
    let (narrowest, widest) = ((0..sizes.len()).min_by(order), (0..sizes.len()).max_by(order));
    format!(
        "  observations are clipped: {} ... {}\n",
        entry(narrowest),
        entry(widest)
    )
}

/// The entries with the smallest and the largest deviation.
fn normaliser(policy: &Policy) -> String {
    let actor = policy.actor();
    let order = |a: &usize, b: &usize| actor.deviation[*a].total_cmp(&actor.deviation[*b]);
    let entry = |index: Option<usize>| {
        let index = index.unwrap_or(0);
        let name = policy.spec().entry_name(index).unwrap_or_default();
        format!("{name} {:.4} +- {:.4}", actor.mean[index], actor.deviation[index])
    };
    let entries = 0..actor.deviation.len();
    let (smallest, largest) = (entries.clone().min_by(order), entries.max_by(order));
    format!(
        "  normalised by mean and deviation, then clipped to +-{}: {} ... {}\n",
        actor.clip,
        entry(smallest),
        entry(largest)
    )
}

/// The chains by which the velocity of the base is estimated.
fn legs(spec: &Spec) -> String {
    let leg = |leg: &Leg| {
        let joints = leg.segments.iter().filter_map(|segment| segment.joint);
        let mut names: Vec<_> = joints
            .map(|joint| spec.joints[usize::from(joint)].name.as_str())
            .collect();
        // A coupling has two joints of one name.
        names.dedup();
        format!("    {}: {}\n", leg.name, names.join(", "))
    };
    let chains: String = spec.legs.iter().map(leg).collect();
    match spec.legs.len() {
        0 => "  no legs: the velocity of the base must be given\n".to_owned(),
        n => format!("  {n} legs, from the base outward, by which the velocity of the base is estimated\n{chains}"),
    }
}

fn spec(spec: &Spec) -> String {
    let mut text = format!(
        "  {} Hz, observation of {} numbers:\n",
        spec.control_hz,
        spec.observation_len()
    );
    for block in spec.layout() {
        text += &format!(
            "    {:<18} {:>3}  {}; {}\n",
            block.name, block.len, block.unit, block.frame
        );
    }
    text += &format!("  action: {}\n", action(&spec.action));
    let [roll, pitch] = spec.upright;
    text += &format!("  fallen beyond {roll} rad of roll or {pitch} rad of pitch\n");
    if let Some(clock) = &spec.clock {
        let symmetric = if spec.symmetry.is_some() {
            ", symmetric: the second half mirrors the first"
        } else {
            ""
        };
        text += &format!(
            "  clock with a period of {} s, from phase {}{symmetric}\n",
            clock.period, clock.reset_phase
        );
    }
    let command = &spec.command;
    text += &format!(
        "  commands from {:?} to {:?} m/s, m/s, rad/s, followed at most at {:?} m/s^2, m/s^2, rad/s^2\n",
        command.lower, command.upper, command.rate
    );
    text += &format!(
        "  inertial frame set to the heading every {} s\n",
        spec.inertial_frame_period
    );
    text += &legs(spec);
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
    format!("{}, {filter}{clamp}", action.law.name())
}
