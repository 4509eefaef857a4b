//! From a run to what a robot runs: the policy file, and the same for C and as ONNX.

pub mod c;
pub mod onnx;

use std::path::Path;

use miette::{IntoDiagnostic, WrapErr};
use omniwalk_controller::{Activation, Actor, Block, Bounds, Curriculum, Dense, Head, Identity, Policy, Spec, Weights};
use omniwalk_env::task::shared::spec;
use omniwalk_ppo as ppo;
use sha2::{Digest, Sha256};

use crate::command::load;
use crate::run::RunFolder;
use crate::run::checkpoint::Checkpoint;
use crate::settings::Settings;
use crate::train::checkpoint;
use crate::train::trainer::region;

/// The policy of the run in `folder`: of the checkpoint at `file`, or the newest.
///
/// # Errors
/// When there is none, or it does not fit the run's configuration and robot.
pub fn policy(folder: &Path, file: Option<&Path>) -> miette::Result<Policy> {
    let run = RunFolder::open(folder)?;
    let (settings, _) = load::settings(Some(&run.config()), &[])?;
    let text = std::fs::read(run.config())
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", run.config().display()))?;
    let robot = load::robot(&run.robot())?;
    let (checkpoint, path) = match file {
        Some(file) => (Checkpoint::read(file)?, file.to_owned()),
        None => load::latest(&run).map(|latest| (latest.checkpoint, latest.path))?,
    };
    let spec = spec(&robot, &settings.env);
    let (inputs, joints) = (spec.observation_len(), spec.action_len());
    let network = checkpoint::agent(&checkpoint, &settings, inputs, joints)
        .wrap_err_with(|| format!("{} does not fit robot and configuration", path.display()))?
        .policy();
    let identity = Identity {
        config_hash: Sha256::digest(&text).into(),
        ..identity(&settings, &checkpoint)?
    };
    let mut bounds = bounds(&network);
    widen(
        &mut bounds,
        &spec,
        [identity.curriculum.lower, identity.curriculum.upper],
    );
    Policy::new(spec, actor(&network), bounds, identity)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot export {}", folder.display()))
}

fn identity(settings: &Settings, checkpoint: &Checkpoint) -> miette::Result<Identity> {
    let progress = checkpoint::progress(checkpoint)?;
    let (lower, upper) = trained(settings, region(settings, &progress));
    let latency = &settings.env.latency;
    let program = checkpoint.metadata.get("program").and_then(|value| value.as_str());
    Ok(Identity {
        config_hash: [0; 32],
        seed: settings.train.seed,
        steps: checkpoint.step,
        program: program.unwrap_or("omniwalk").to_owned(),
        latency: [if latency.enabled { latency.lower } else { 0.0 }, latency.longest()].map(|x| x as f32),
        curriculum: Curriculum {
            lower: lower.map(|x| x as f32),
            upper: upper.map(|x| x as f32),
            velocity_factor: progress.curriculum.velocity_factor() as f32,
            foot_factor: progress.curriculum.foot_factor() as f32,
        },
    })
}

/// Smallest and largest desired velocity that was drawn from a region: also zero, where draws are zero at times.
fn trained(settings: &Settings, (lower, upper): ([f64; 3], [f64; 3])) -> ([f64; 3], [f64; 3]) {
    let command = &settings.env.command;
    if command.zero_share > 0.0 || command.axis_share > 0.0 {
        (lower.map(|x| x.min(0.0)), upper.map(|x| x.max(0.0)))
    } else {
        (lower, upper)
    }
}

/// The network of the controller with the numbers of the learner's.
pub fn actor(policy: &ppo::Policy) -> Actor {
    let dense = |layer: &ppo::Layer| Dense {
        inputs: layer.inputs,
        weights: Weights::F32(layer.weights.clone()),
        bias: layer.bias.clone(),
    };
    Actor {
        mean: policy.mean.clone(),
        deviation: policy.deviation.clone(),
        clip: policy.clip,
        layers: policy.layers.iter().map(dense).collect(),
        activation: match policy.activation {
            ppo::Activation::Tanh => Activation::Tanh,
            ppo::Activation::Elu => Activation::Elu,
            ppo::Activation::Relu => Activation::Relu,
        },
        head: match policy.head {
            ppo::Head::Beta => Head::Beta,
            ppo::Head::Gaussian => Head::Gaussian,
        },
    }
}

/// What training saw of each entry of the observation, as far as the network could tell it: beyond the clip of the
/// normaliser every value is the same to it.
fn bounds(policy: &ppo::Policy) -> Bounds {
    let [smallest, largest] = &policy.range;
    let reach = |i: usize| policy.clip * policy.deviation[i];
    let entry = |i: usize| {
        let (least, most) = (policy.mean[i] - reach(i), policy.mean[i] + reach(i));
        let (lower, upper) = (smallest[i].clamp(least, most), largest[i].clamp(least, most));
        // Nothing was seen before the first update.
        if smallest[i] <= largest[i] {
            (lower, upper)
        } else {
            (least, most)
        }
    };
    let (lower, upper) = (0..policy.mean.len()).map(entry).unzip();
    Bounds { lower, upper }
}

/// Commands that training drew from are no news, if those at the very edge did not happen to be drawn.
fn widen(bounds: &mut Bounds, spec: &Spec, [lower, upper]: [[f32; 3]; 2]) {
    let mut first = 0;
    for &block in &spec.observation {
        if matches!(block, Block::DesiredVelocity | Block::CommandedVelocity) {
            for axis in 0..3 {
                // A symmetric policy sees what goes left and right mirrored too.
                let mirrored = spec.symmetry.is_some() && axis > 0;
                let (least, most) = (lower[axis], upper[axis]);
                let least = if mirrored { least.min(-most) } else { least };
                let most = if mirrored { most.max(-lower[axis]) } else { most };
                let entry = first + axis;
                bounds.lower[entry] = bounds.lower[entry].min(least);
                bounds.upper[entry] = bounds.upper[entry].max(most);
            }
        }
        first += spec.block_len(block);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network(range: [f32; 2]) -> ppo::Policy {
        ppo::Policy {
            mean: vec![1.0],
            deviation: vec![0.5],
            clip: 4.0,
            range: range.map(|x| vec![x]),
            layers: Vec::new(),
            activation: ppo::Activation::Tanh,
            head: ppo::Head::Beta,
        }
    }

    #[test]
    fn bounds_are_what_was_seen_within_what_the_network_can_tell_apart() {
        let infinite = f32::INFINITY;
        let cases = [
            ([0.0, 2.0], [0.0, 2.0]),
            ([-5.0, 2.0], [-1.0, 2.0]),
            ([-infinite, infinite], [-1.0, 3.0]),
            ([infinite, -infinite], [-1.0, 3.0]),
        ];
        for (seen, expected) in cases {
            let bounds = bounds(&network(seen));
            assert_eq!(
                (bounds.lower[0], bounds.upper[0]),
                (expected[0], expected[1]),
                "{seen:?}"
            );
        }
    }

    #[test]
    fn bounds_of_commands_reach_as_far_as_the_curriculum_did() {
        let (settings, _) = load::settings(None, &[]).unwrap();
        let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x");
        let mut spec = spec(&load::robot(&robot).unwrap(), &settings.env);
        let named = |name: &str| (0..).find(|&i| spec.entry_name(i).as_deref() == Some(name)).unwrap();
        let commands = ["desired_velocity[x]", "commanded_velocity[x]"].map(named);
        let seen = |spec: &Spec| Bounds {
            lower: vec![-0.1; spec.observation_len()],
            upper: vec![0.1; spec.observation_len()],
        };
        let region = [[0.0, -0.2, -0.3], [0.5, 0.4, 0.0]];
        let (mut plain, mut mirrored) = (seen(&spec), seen(&spec));
        spec.symmetry = None;
        widen(&mut plain, &spec, region);
        spec.symmetry = Some(Vec::new());
        widen(&mut mirrored, &spec, region);
        for entry in commands {
            assert_eq!(plain.lower[entry..][..3], [-0.1, -0.2, -0.3]);
            assert_eq!(plain.upper[entry..][..3], [0.5, 0.4, 0.1]);
            assert_eq!(mirrored.lower[entry..][..3], [-0.1, -0.4, -0.3]);
            assert_eq!(mirrored.upper[entry..][..3], [0.5, 0.4, 0.3]);
        }
        assert_eq!((plain.lower[0], plain.upper[0]), (-0.1, 0.1));
    }
}
