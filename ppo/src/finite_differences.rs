//! The gradient of the whole loss against central differences of a plain loss in `f64`.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{
    Activation, Agent, Beta, Config, End, Gaussian, Head, Mirror, Rollout, Schedule,
    network::{Network, Tile},
};

const OBSERVATIONS: usize = 5;
const ACTIONS: usize = 3;

pub(crate) fn config(policy: Head, activation: Activation) -> Config {
    Config {
        hidden: vec![9, 7],
        activation,
        policy,
        learning_rate: 1e-3,
        schedule: Schedule::Fixed {},
        gamma: 0.9,
        lambda: 0.8,
        clip: 0.15,
        dual_clip: 1.3,
        epochs: 1,
        minibatch: 100,
        entropy_weight: 0.02,
        mode_weight: 0.3,
        value_weight: 0.6,
        max_gradient_norm: 1.0,
        normalise_observations: false,
        observation_clip: 5.0,
    }
}

/// A network's parameters, layer by layer: weights (`outputs x inputs`), then biases.
fn parameters(network: &Network, part: fn(&Tile) -> &[f32]) -> Vec<f64> {
    let plain = |tile: &Tile| {
        let (weights, bias) = tile.plain(part(tile));
        [weights, bias].concat()
    };
    network.tiles.iter().flat_map(plain).map(f64::from).collect()
}

fn outputs(network: &Network, parameters: &[f64], input: &[f64]) -> Vec<f64> {
    let mut values = input.to_vec();
    let mut rest = parameters;
    for (layer, pair) in network.widths.windows(2).enumerate() {
        let (weights, others) = rest.split_at(pair[0] * pair[1]);
        let (bias, others) = others.split_at(pair[1]);
        rest = others;
        let last = layer + 2 == network.widths.len();
        values = (weights.chunks(pair[0]).zip(bias))
            .map(|(weights, bias)| {
                let x = bias + weights.iter().zip(&values).map(|(w, x)| w * x).sum::<f64>();
                match network.activation {
                    _ if last => x,
                    Activation::Tanh => x.tanh(),
                    Activation::Elu => {
                        if x > 0.0 {
                            x
                        } else {
                            x.exp_m1()
                        }
                    }
                    Activation::Relu => x.max(0.0),
                }
            })
            .collect();
    }
    values
}

/// Log-probability of an action, entropy, and squared distance of mode and mean.
fn judge(head: Head, outputs: &[f64], action: &[f64]) -> (f64, f64, f64) {
    let softplus = |z: f64| z.exp().ln_1p();
    let (mut log_probability, mut entropy, mut distance) = (0.0, 0.0, 0.0);
    for i in 0..ACTIONS {
        let (first, second) = (outputs[i], outputs[ACTIONS + i]);
        let (l, e) = match head {
            Head::Beta => {
                let this = Beta {
                    alpha: 1.0 + softplus(first),
                    beta: 1.0 + softplus(second),
                };
                distance += (this.mode() - this.alpha / (this.alpha + this.beta)).powi(2);
                (this.log_probability(action[i]).value, this.entropy().value)
            }
            Head::Gaussian => {
                let this = Gaussian {
                    mean: first,
                    deviation: 0.01 + softplus(second),
                };
                (this.log_probability(2.0 * action[i] - 1.0).value, this.entropy().value)
            }
        };
        log_probability += l;
        entropy += e;
    }
    (log_probability, entropy, distance)
}

fn rollout(random: &mut ChaCha8Rng) -> Rollout {
    let mut rollout = Rollout::new(6, 4, OBSERVATIONS, ACTIONS);
    let mut fill =
        |values: &mut [f32], from: f32, to: f32| values.iter_mut().for_each(|x| *x = random.random_range(from..to));
    fill(&mut rollout.observations, -2.0, 2.0);
    fill(&mut rollout.actions, 0.05, 0.95);
    fill(&mut rollout.values, -1.0, 1.0);
    fill(&mut rollout.rewards, -1.0, 1.0);
    rollout.ends[7] = End::Terminated;
    rollout.ends[13] = End::TimeOut;
    rollout
}

fn check(head: Head, activation: Activation) {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut agent = Agent::new(config(head, activation), OBSERVATIONS, ACTIONS, 3).unwrap();
    let rollout = rollout(&mut random);
    let mirror = Mirror {
        observation: vec![(1, -1.0), (0, -1.0), (2, 1.0), (3, -1.0), (4, 1.0)],
        action: vec![(0, -1.0), (2, 1.0), (1, 1.0)],
    };
    let (learner, learned) = agent.split();
    learner.prepare(&learned, &rollout, Some(&mirror));
    let before = parameters(learned.actor, |tile| &tile.parameters);
    // Away from the old policy, so that ratios differ from 1 and some are clipped.
    for tile in learned.actor.tiles.iter_mut() {
        let weights = (0..tile.outputs).flat_map(|o| (0..tile.inputs).map(move |i| (o, i)));
        let weights: Vec<usize> = weights.map(|(output, input)| tile.index(output, input)).collect();
        let biases = tile.parameters.len() - tile.outputs..tile.parameters.len();
        for index in weights.into_iter().chain(biases) {
            tile.parameters[index] += random.random_range(-0.1..0.1);
        }
        tile.pack();
    }
    let count = 2 * rollout.samples();
    learner.gradient(learned.config, learned.actor, learned.critic, 0..count);
    let samples = learner.samples();
    let config = learned.config;

    let policy_loss = |now: &[f64]| -> f64 {
        let of = |(observation, action, advantage, _): &(Vec<f64>, Vec<f64>, f64, f64)| {
            let (old, ..) = judge(head, &outputs(learned.actor, &before, observation), action);
            let (new, entropy, distance) = judge(head, &outputs(learned.actor, now, observation), action);
            let ratio = (new - old).exp();
            let bounded = ratio.clamp(1.0 - config.clip, 1.0 + config.clip);
            let surrogate = (ratio * advantage).min(bounded * advantage);
            let surrogate = if *advantage < 0.0 {
                surrogate.max(config.dual_clip * advantage)
            } else {
                surrogate
            };
            -surrogate - config.entropy_weight * entropy + config.mode_weight * distance
        };
        samples.iter().map(of).sum::<f64>() / count as f64
    };
    let value_loss = |now: &[f64]| -> f64 {
        let of = |(observation, _, _, target): &(Vec<f64>, Vec<f64>, f64, f64)| {
            0.5 * config.value_weight * (outputs(learned.critic, now, observation)[0] - target).powi(2)
        };
        samples.iter().map(of).sum::<f64>() / count as f64
    };
    compare(learned.actor, policy_loss);
    compare(learned.critic, value_loss);
}

fn compare(network: &Network, loss: impl Fn(&[f64]) -> f64) {
    let now = parameters(network, |tile| &tile.parameters);
    let found = parameters(network, |tile| &tile.gradient);
    let norm = found.iter().map(|g| g * g).sum::<f64>().sqrt();
    assert!(norm > 1e-3);
    for i in 0..now.len() {
        let at = |shift: f64| {
            let mut moved = now.clone();
            moved[i] += shift;
            loss(&moved)
        };
        let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
        let error = (found[i] - expected).abs();
        assert!(
            error < 2e-6 * norm.max(1.0) + 1e-5 * expected.abs(),
            "{i}: {} for {expected}, norm {norm}",
            found[i]
        );
    }
}

#[test]
fn gradients_agree_with_finite_differences() {
    for activation in [Activation::Tanh, Activation::Elu, Activation::Relu] {
        check(Head::Beta, activation);
        check(Head::Gaussian, activation);
    }
}
