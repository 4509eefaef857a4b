"""Writes the numbers that the tests of the crate `ppo` compare with: ppo/tests/golden/*.json.

beta.json    log-probability, entropy and divergence of Beta distributions with their gradients, by mpmath
update.json  whole PPO updates of small networks, by PyTorch in double precision

Needs: pip install torch numpy mpmath. Run from anywhere: python python/golden_ppo.py
"""

import json
from pathlib import Path

import mpmath
import numpy as np
import torch

OUT = Path(__file__).resolve().parent.parent / "ppo" / "tests" / "golden"


def beta_cases():
    mpmath.mp.dps = 50
    shapes = [1 + 1e-6, 1.01, 1.3, 1.6931471805599454, 2.0, 2.5, 7.25, 31.0, 150.5, 1200.0, 20000.0]
    rng = np.random.default_rng(1)
    for alpha in shapes:
        for beta in shapes:
            mode = float(np.clip(alpha / (alpha + beta) + 0.3 * rng.uniform(-1, 1) / np.sqrt(alpha + beta), 1e-5, 1 - 1e-5))
            for x in [mode, 1e-6, 0.75]:
                old = [float(1 + (alpha - 1) * rng.uniform(0.5, 2)), float(1 + (beta - 1) * rng.uniform(0.5, 2))]
                yield beta_case(alpha, beta, float(x), old)


def beta_case(alpha, beta, x, old):
    mpf, psi, log = mpmath.mpf, mpmath.psi, mpmath.log
    a, b, x_, a0, b0 = mpf(alpha), mpf(beta), mpf(x), mpf(old[0]), mpf(old[1])
    log_beta = lambda p, q: mpmath.loggamma(p) + mpmath.loggamma(q) - mpmath.loggamma(p + q)
    triple = lambda *values: [float(v) for v in values]
    s, s0 = a + b, a0 + b0
    return {
        "alpha": alpha,
        "beta": beta,
        "x": x,
        "old": old,
        "log_probability": triple(
            (a - 1) * log(x_) + (b - 1) * log(1 - x_) - log_beta(a, b),
            log(x_) - psi(0, a) + psi(0, s),
            log(1 - x_) - psi(0, b) + psi(0, s),
        ),
        "entropy": triple(
            log_beta(a, b) - (a - 1) * psi(0, a) - (b - 1) * psi(0, b) + (s - 2) * psi(0, s),
            (s - 2) * psi(1, s) - (a - 1) * psi(1, a),
            (s - 2) * psi(1, s) - (b - 1) * psi(1, b),
        ),
        "kl": triple(
            log_beta(a, b) - log_beta(a0, b0) + (a0 - a) * psi(0, a0) + (b0 - b) * psi(0, b0) + (s - s0) * psi(0, s0),
            psi(0, a) - psi(0, s) - psi(0, a0) + psi(0, s0),
            psi(0, b) - psi(0, s) - psi(0, b0) + psi(0, s0),
        ),
    }


def f32(array):
    """Values that are exact in single precision, so that both sides start from the same numbers."""
    return np.asarray(array, dtype=np.float32).astype(np.float64)


ACTIVATIONS = {"tanh": torch.nn.Tanh, "elu": torch.nn.ELU, "relu": torch.nn.ReLU}


def network(widths, activation, rng):
    layers = []
    for i, (inputs, outputs) in enumerate(zip(widths, widths[1:])):
        linear = torch.nn.Linear(inputs, outputs, dtype=torch.float64)
        with torch.no_grad():
            linear.weight.copy_(torch.from_numpy(f32(rng.normal(size=(outputs, inputs)) / np.sqrt(inputs))))
            linear.bias.copy_(torch.from_numpy(f32(0.1 * rng.normal(size=outputs))))
        layers += [linear] + ([ACTIVATIONS[activation]()] if i + 2 < len(widths) else [])
    return torch.nn.Sequential(*layers)


def distribution(head, outputs):
    first, second = outputs.chunk(2, dim=-1)
    soft = torch.nn.functional.softplus
    if head == "beta":
        return torch.distributions.Beta(1 + soft(first), 1 + soft(second))
    return torch.distributions.Normal(first, 0.01 + soft(second))


def log_probability(head, dist, actions):
    return dist.log_prob(actions if head == "beta" else 2 * actions - 1).sum(-1)


def parameters(net):
    linears = [layer for layer in net if isinstance(layer, torch.nn.Linear)]
    return [{"weight": l.weight.detach().flatten().tolist(), "bias": l.bias.detach().tolist()} for l in linears]


def gradients(net):
    linears = [layer for layer in net if isinstance(layer, torch.nn.Linear)]
    return [{"weight": l.weight.grad.flatten().tolist(), "bias": l.bias.grad.tolist()} for l in linears]


def advantages_of(rollout, gamma, lam):
    """By the definition: a sum over all later steps of the episode."""
    steps, environments = rollout["rewards"].shape
    result = np.zeros((steps, environments))
    for e in range(environments):
        for t in range(steps):
            total, weight = 0.0, 1.0
            for k in range(t, steps):
                end = rollout["ends"][k, e]
                following = rollout["values"][k + 1, e] if k + 1 < steps else rollout["last_values"][e]
                following = [following, 0.0, rollout["bootstrap_values"][k, e]][end]
                total += weight * (rollout["rewards"][k, e] + gamma * following - rollout["values"][k, e])
                weight *= gamma * lam
                if end:
                    break
            result[t, e] = total
    return result


def update_case(name, config, mirror=None, seed=0):
    rng = np.random.default_rng(seed)
    observation_len, action_len, steps, environments = 5, 3, 9, 4
    head = config["policy"]
    actor = network([observation_len, *config["hidden"], 2 * action_len], config["activation"], rng)
    critic = network([observation_len, *config["hidden"], 1], config["activation"], rng)
    count = 50
    normaliser = {"count": count, "mean": rng.normal(size=observation_len), "squares": count * rng.uniform(0.5, 2, observation_len)}
    rollout = {
        "observations": f32(1.5 * rng.normal(size=(steps, environments, observation_len))),
        "actions": f32(rng.uniform(0.05, 0.95, size=(steps, environments, action_len))),
        "values": f32(rng.normal(size=(steps, environments))),
        "rewards": f32(rng.normal(size=(steps, environments))),
        "ends": rng.choice(3, p=[0.7, 0.15, 0.15], size=(steps, environments)),
        "bootstrap_values": f32(rng.normal(size=(steps, environments))),
        "last_values": f32(rng.normal(size=environments)),
    }
    case = {"name": name, "config": config, "mirror": mirror, "steps": steps, "environments": environments,
            "rollout": {k: v.flatten().tolist() for k, v in rollout.items()},
            "normaliser": {"count": count, "mean": normaliser["mean"].tolist(), "squares": normaliser["squares"].tolist()},
            "actor": parameters(actor), "critic": parameters(critic)}

    observations = rollout["observations"].reshape(-1, observation_len)
    actions = rollout["actions"].reshape(-1, action_len)
    advantages = advantages_of(rollout, config["gamma"], config["lambda"]).flatten()
    returns = advantages + rollout["values"].flatten()
    case["explained_variance"] = float(1 - np.var(returns - rollout["values"].flatten()) / np.var(returns))
    advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    if mirror:
        flip = lambda array, table: np.stack([sign * array[:, index] for index, sign in table], axis=1)
        observations = np.concatenate([observations, flip(observations, mirror["observation"])])
        actions = np.concatenate([actions, 0.5 + flip(actions - 0.5, mirror["action"])])
        advantages, returns = np.tile(advantages, 2), np.tile(returns, 2)
    if config["normalise_observations"]:
        deviation = np.sqrt(normaliser["squares"] / count)
        observations = (observations - normaliser["mean"]) / deviation
    observations = torch.from_numpy(np.clip(observations, -config["observation_clip"], config["observation_clip"]))
    actions, advantages, returns = (torch.from_numpy(x) for x in (actions, advantages, returns))

    with torch.no_grad():
        old = distribution(head, actor(observations))
        old_log_probability = log_probability(head, old, actions)
    optimisers = [torch.optim.Adam(net.parameters(), lr=config["learning_rate"]) for net in (actor, critic)]
    case["epochs"] = []
    for _ in range(config["epochs"]):
        new = distribution(head, actor(observations))
        ratio = torch.exp(log_probability(head, new, actions) - old_log_probability)
        clipped = ratio.clamp(1 - config["clip"], 1 + config["clip"])
        surrogate = torch.min(ratio * advantages, clipped * advantages)
        # Dual clip (Ye et al. 2020): with a negative advantage the surrogate ends at a multiple of it.
        surrogate = torch.where(advantages < 0, torch.max(surrogate, config["dual_clip"] * advantages), surrogate)
        policy_loss = -surrogate.mean()
        entropy = new.entropy().sum(-1).mean()
        value_loss = 0.5 * ((critic(observations).squeeze(-1) - returns) ** 2).mean()
        kl = torch.distributions.kl_divergence(old, new).sum(-1).mean()
        loss = policy_loss - config["entropy_weight"] * entropy + config["value_weight"] * value_loss
        for optimiser in optimisers:
            optimiser.zero_grad()
        loss.backward()
        epoch = {"policy_loss": policy_loss.item(), "value_loss": value_loss.item(), "entropy": entropy.item(),
                 "kl": kl.item(), "clip_fraction": (ratio != clipped).double().mean().item(),
                 "actor_gradient": gradients(actor), "critic_gradient": gradients(critic)}
        for key, net, optimiser in zip(("policy", "value"), (actor, critic), optimisers):
            norm = torch.nn.utils.clip_grad_norm_(net.parameters(), config["max_gradient_norm"])
            epoch[key + "_gradient_norm"] = norm.item()
            optimiser.step()
        epoch["actor"], epoch["critic"] = parameters(actor), parameters(critic)
        case["epochs"].append(epoch)
    return case


def update_cases():
    base = {"hidden": [8, 6], "activation": "tanh", "policy": "beta", "learning_rate": 0.03, "schedule": {"type": "fixed"},
            "gamma": 0.97, "lambda": 0.9, "clip": 0.1, "dual_clip": 3.0, "epochs": 4, "minibatch": 1000, "entropy_weight": 0.05,
            "value_weight": 0.7, "max_gradient_norm": 1000.0, "normalise_observations": True, "observation_clip": 2.0}
    mirror = {"observation": [[0, 1.0], [2, -1.0], [1, -1.0], [3, -1.0], [4, 1.0]], "action": [[1, 1.0], [0, 1.0], [2, -1.0]]}
    yield update_case("beta tanh", base, seed=1)
    yield update_case("beta tanh clipped", {**base, "max_gradient_norm": 0.2}, seed=2)
    yield update_case("beta tanh mirrored", {**base, "hidden": [40]}, mirror, seed=3)
    yield update_case("beta relu raw", {**base, "activation": "relu", "normalise_observations": False}, seed=4)
    yield update_case("gaussian elu mirrored", {**base, "policy": "gaussian", "activation": "elu"}, mirror, seed=5)


def write(name, cases):
    lines = ",\n".join(json.dumps(case, separators=(",", ":")) for case in cases)
    (OUT / name).write_text("[\n" + lines + "\n]\n")


OUT.mkdir(parents=True, exist_ok=True)
write("beta.json", beta_cases())
write("update.json", update_cases())
