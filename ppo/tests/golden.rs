//! Distributions against mpmath, whole updates against PyTorch: numbers made by `python/golden_ppo.py`.

#[path = "support/case.rs"]
mod case;

use case::{Case, Layer};
use omniwalk_ppo::{Beta, Differentiated, Mirror, Tensor, TensorData};
use serde::Deserialize;

#[derive(Deserialize)]
struct BetaCase {
    alpha: f64,
    beta: f64,
    x: f64,
    old: [f64; 2],
    log_probability: [f64; 3],
    entropy: [f64; 3],
    kl: [f64; 3],
}

/// 1e-9 relative; where terms cancel, a few roundings of the largest of them: `scales` of the value and its derivatives.
fn assert_agrees(what: &str, case: &BetaCase, found: Differentiated, expected: [f64; 3], scales: [f64; 2]) {
    let found = [found.value, found.by_first, found.by_second];
    for (i, (found, expected)) in found.into_iter().zip(expected).enumerate() {
        let tolerance = 1e-9 * expected.abs() + 4.0 * f64::EPSILON * scales[i.min(1)];
        let error = (found - expected).abs();
        let BetaCase {
            alpha, beta, x, old, ..
        } = case;
        assert!(
            error <= tolerance,
            "{what} {i}: {found} for {expected} at {alpha}, {beta}, x {x}, old {old:?}"
        );
    }
}

#[test]
fn beta_distribution_agrees_with_mpmath() {
    let cases: Vec<BetaCase> = serde_json::from_str(include_str!("golden/beta.json")).unwrap();
    assert!(cases.len() > 300);
    for case in &cases {
        let this = Beta {
            alpha: case.alpha,
            beta: case.beta,
        };
        let old = Beta {
            alpha: case.old[0],
            beta: case.old[1],
        };
        // The logarithm of Gamma(s) comes from that of Gamma(s + 8), about (s + 8) ln(s + 8), its derivative ln(s + 8).
        let sum = 8.0 + (case.alpha + case.beta).max(case.old[0] + case.old[1]);
        let plain = [sum * sum.ln(), sum.ln()];
        let with_x = plain.map(|scale| scale - case.x.ln() * scale / sum.ln());
        assert_agrees(
            "log-probability",
            case,
            this.log_probability(case.x),
            case.log_probability,
            with_x,
        );
        assert_agrees("entropy", case, this.entropy(), case.entropy, plain);
        assert_agrees("divergence", case, this.kl_from(&old), case.kl, plain);
    }
}

#[derive(Deserialize)]
struct Maps {
    observation: Vec<(u32, f32)>,
    action: Vec<(u32, f32)>,
}

#[derive(Deserialize)]
struct Epoch {
    policy_loss: f64,
    value_loss: f64,
    entropy: f64,
    kl: f64,
    clip_fraction: f64,
    policy_gradient_norm: f64,
    value_gradient_norm: f64,
    actor_gradient: Vec<Layer>,
    critic_gradient: Vec<Layer>,
    actor: Vec<Layer>,
    critic: Vec<Layer>,
}

#[derive(Deserialize)]
struct UpdateCase {
    name: String,
    mirror: Option<Maps>,
    explained_variance: f64,
    epochs: Vec<Epoch>,
    #[serde(flatten)]
    case: Case,
}

fn get(tensors: &[Tensor], name: &str) -> Vec<f64> {
    match &tensors.iter().find(|tensor| tensor.name == name).unwrap().data {
        TensorData::F32(values) => values.iter().map(|&x| f64::from(x)).collect(),
        _ => panic!("{name} is f32"),
    }
}

/// The largest difference between arrays of a network and `layers`, relative to the largest element.
fn difference(tensors: &[Tensor], network: &str, suffix: &str, layers: &[Layer], scale: f64) -> f64 {
    let (mut error, mut largest) = (0.0_f64, 0.0_f64);
    for (i, layer) in layers.iter().enumerate() {
        for (kind, expected) in [("weight", &layer.weight), ("bias", &layer.bias)] {
            let found = get(tensors, &format!("{network}.{i}.{kind}{suffix}"));
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(expected) {
                error = error.max((found * scale - expected).abs());
                largest = largest.max(expected.abs());
            }
        }
    }
    error / largest
}

#[test]
fn gradients_of_the_first_step_agree_with_pytorch() {
    for case in &cases() {
        let mut agent = case.case.agent(1);
        let stats = agent.update(&case.case.rollout(), case.mirror().as_ref(), 1);
        let (tensors, epoch) = (agent.save(), &case.epochs[0]);
        for (network, norm, layers) in [
            ("actor", stats.policy_gradient_norm, &epoch.actor_gradient),
            ("critic", stats.value_gradient_norm, &epoch.critic_gradient),
        ] {
            // The first mean of the gradient is a tenth of it, shortened to the largest norm.
            let scale = 10.0 / (case.case.config.max_gradient_norm / norm).min(1.0);
            let error = difference(&tensors, network, ".first_moment", layers, scale);
            assert!(
                error < 1e-5,
                "{}: gradient of the {network} differs by {error}",
                case.name
            );
        }
    }
}

#[test]
fn updates_of_several_steps_agree_with_pytorch() {
    for case in &cases() {
        for epochs in 1..=case.epochs.len() {
            let mut agent = case.case.agent(epochs);
            let stats = agent.update(&case.case.rollout(), case.mirror().as_ref(), 1);
            assert_eq!((stats.steps, stats.skipped), (epochs, 0));
            let (tensors, done) = (agent.save(), &case.epochs[..epochs]);
            let last = &done[epochs - 1];
            for (network, layers) in [("actor", &last.actor), ("critic", &last.critic)] {
                let error = difference(&tensors, network, "", layers, 1.0);
                assert!(
                    error < 2e-4,
                    "{}: the {network} differs by {error} after {epochs} steps",
                    case.name
                );
            }
            let mean = |of: fn(&Epoch) -> f64| done.iter().map(of).sum::<f64>() / epochs as f64;
            for (what, found, expected) in [
                ("policy loss", stats.policy_loss, mean(|e| e.policy_loss)),
                ("value loss", stats.value_loss, mean(|e| e.value_loss)),
                ("entropy", stats.entropy, mean(|e| e.entropy)),
                ("divergence", stats.kl, mean(|e| e.kl)),
                ("clip fraction", stats.clip_fraction, mean(|e| e.clip_fraction)),
                (
                    "policy gradient norm",
                    stats.policy_gradient_norm,
                    mean(|e| e.policy_gradient_norm),
                ),
                (
                    "value gradient norm",
                    stats.value_gradient_norm,
                    mean(|e| e.value_gradient_norm),
                ),
                ("explained variance", stats.explained_variance, case.explained_variance),
            ] {
                let error = (found - expected).abs();
                assert!(
                    error < 1e-4 * expected.abs() + 1e-6,
                    "{}: {what} is {found} for {expected}",
                    case.name
                );
            }
        }
        assert!(
            case.epochs.iter().any(|epoch| epoch.clip_fraction > 0.1),
            "{}: the clip is at work",
            case.name
        );
    }
}

fn cases() -> Vec<UpdateCase> {
    serde_json::from_str(include_str!("golden/update.json")).unwrap()
}

impl UpdateCase {
    fn mirror(&self) -> Option<Mirror> {
        self.mirror.as_ref().map(|maps| Mirror {
            observation: maps.observation.clone(),
            action: maps.action.clone(),
        })
    }
}
