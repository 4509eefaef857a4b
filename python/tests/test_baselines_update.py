"""One update of our PPO, Gaussian head, beside that of Stable-Baselines3 on the same batch from the same weights. Theirs is run by its own
`PPO.train`, its own advantages and its own loss; the batch is what it collected in our environment.

Needs PyTorch: `./test --torch`.
"""

import json
import subprocess

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="./test --torch has it")
pytest.importorskip("stable_baselines3", reason="./test --torch has it")

from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecNormalize

import omniwalk
from programs import ROOT, program

STEPS, ROBOTS, HIDDEN, EPOCHS = 256, 64, [64, 64], 4
GAMMA, LAMBDA, CLIP, ENTROPY, VALUE, RATE, EPSILON = 0.99, 0.95, 0.2, 0.01, 1.0, 2e-3, 1e-8
BOUND = 1e-4
"""Theirs divides advantages by a deviation over n - 1 samples, ours over n: with 16,384 samples that is 3e-5. The rest is single
precision over a sum of that many."""


class Ours(ActorCriticPolicy):
    """Our Gaussian head in their policy: the network gives mean and deviation, `0.01 + softplus(x)`."""

    def _build(self, lr_schedule) -> None:
        super()._build(lr_schedule)
        self.action_net = torch.nn.Linear(self.mlp_extractor.latent_dim_pi, 2 * self.action_space.shape[0])
        torch.nn.init.normal_(self.action_net.weight, std=0.02)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def _get_action_dist_from_latent(self, latent):
        mean, spread = self.action_net(latent).chunk(2, dim=-1)
        deviation = 0.01 + torch.nn.functional.softplus(spread)
        return self.action_dist.proba_distribution(mean, deviation.log())



def networks(policy: Ours) -> dict[str, list[torch.nn.Linear]]:
    """The layers of actor and critic."""
    linear = lambda net: [layer for layer in net if isinstance(layer, torch.nn.Linear)]
    return {
        "actor": [*linear(policy.mlp_extractor.policy_net), policy.action_net],
        "critic": [*linear(policy.mlp_extractor.value_net), policy.value_net],
    }


def layers(policy: Ours) -> dict[str, list[dict]]:
    """Weights as our side reads them."""
    entry = lambda layer: {"weight": layer.weight.flatten().tolist(), "bias": layer.bias.tolist()}
    return {name: [entry(layer) for layer in found] for name, found in networks(policy).items()}


@pytest.fixture(scope="module")
def collected() -> tuple[PPO, dict]:
    """Their learner with a batch from our environment, and the same as our side reads it."""
    torch.set_num_threads(1)
    changes = {"robot.path": ROOT / "robots/nimbro_op2x"}
    envs = VecNormalize(omniwalk.VecEnv(ROBOTS, ROOT / "configs/forward.toml", changes), norm_reward=False)
    model = PPO(
        Ours, envs, n_steps=STEPS, batch_size=STEPS * ROBOTS, n_epochs=1, learning_rate=RATE, gamma=GAMMA, gae_lambda=LAMBDA,
        clip_range=CLIP, ent_coef=ENTROPY, vf_coef=0.5 * VALUE, max_grad_norm=1e9, seed=1, device="cpu",
        policy_kwargs={"net_arch": HIDDEN, "optimizer_kwargs": {"eps": EPSILON}},
    )
    model._setup_learn(STEPS * ROBOTS)
    callback = model._init_callback(None)
    assert model.collect_rollouts(model.env, callback, model.rollout_buffer, STEPS)
    buffer = model.rollout_buffer
    with torch.no_grad():
        last = model.policy.predict_values(torch.as_tensor(model._last_obs)).flatten().tolist()
    # A step ended an episode if the next one begins one. What a time-out would have brought is in their rewards already.
    ends = np.vstack([buffer.episode_starts[1:], model._last_episode_starts[None]]).astype(int)
    assert ends.any()
    width = buffer.observations.shape[-1]
    case = {
        "config": {
            "hidden": HIDDEN, "activation": "tanh", "policy": "gaussian", "learning_rate": RATE, "schedule": {"type": "fixed"},
            "gamma": GAMMA, "lambda": LAMBDA, "clip": CLIP, "dual_clip": 0.0, "epochs": 1, "minibatch": STEPS * ROBOTS,
            "entropy_weight": ENTROPY, "value_weight": VALUE, "max_gradient_norm": 1e9, "normalise_observations": False,
            "observation_clip": 1e6,
        },
        "steps": STEPS,
        "environments": ROBOTS,
        "rollout": {
            "observations": buffer.observations.flatten().tolist(),
            "actions": (0.5 * (1.0 + buffer.actions.astype(float))).flatten().tolist(),
            "values": buffer.values.flatten().tolist(),
            "rewards": buffer.rewards.flatten().tolist(),
            "ends": ends.flatten().tolist(),
            "bootstrap_values": [0.0] * (STEPS * ROBOTS),
            "last_values": last,
        },
        "normaliser": {"count": 0, "mean": [0.0] * width, "squares": [0.0] * width},
        **layers(model.policy),
    }
    return model, case


def ours(case: dict, epochs: int) -> dict:
    """What our update makes of it."""
    case["config"]["epochs"] = epochs
    result = subprocess.run(program("update"), input=json.dumps(case), cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    found = json.loads(result.stdout)
    assert found["steps"] == epochs
    return found


def theirs(model: PPO, case: dict, epochs: int) -> dict[str, float]:
    """Their update from the weights in `case`; its losses."""
    for name, found in networks(model.policy).items():
        for layer, entry in zip(found, case[name]):
            with torch.no_grad():
                layer.weight.copy_(torch.tensor(entry["weight"]).reshape(layer.weight.shape))
                layer.bias.copy_(torch.tensor(entry["bias"]))
    model.policy.optimizer.state.clear()
    model.n_epochs = epochs
    model.train()
    logged = model.logger.name_to_value
    return {
        "policy_loss": logged["train/policy_gradient_loss"],
        # Their loss is the whole square.
        "value_loss": 0.5 * logged["train/value_loss"],
        "entropy": -logged["train/entropy_loss"],
        "clip_fraction": logged["train/clip_fraction"],
    }


def difference(found: list[np.ndarray], expected: list[np.ndarray]) -> float:
    """Of all entries together, relative to their norm."""
    one, other = (np.concatenate([np.ravel(part) for part in parts]).astype(float) for parts in (found, expected))
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


def test_losses_and_gradients_of_an_update_are_those_of_stable_baselines(collected):
    model, case = collected
    expected, found = theirs(model, case, 1), ours(case, 1)
    for name in ("policy_loss", "value_loss", "entropy"):
        # Without a step the surrogate is the mean of normalised advantages, zero but for rounding.
        assert abs(found[name] - expected[name]) < BOUND * max(abs(expected[name]), 0.01), name
    for name, found_layers in networks(model.policy).items():
        for part in ("weight", "bias"):
            gradients = [getattr(layer, part).grad.numpy() for layer in found_layers]
            # Adam's first mean is a tenth of the gradient.
            moments = [10.0 * np.array(found["arrays"][f"{name}.{i}.{part}.first_moment"]) for i in range(len(gradients))]
            error = difference(moments, gradients)
            assert error < BOUND, f"{part} of the {name}: {error}"


def test_an_update_of_several_passes_is_that_of_stable_baselines(collected):
    model, case = collected
    before = [np.array(entry["weight"]) for entry in case["actor"]]
    expected, found = theirs(model, case, EPOCHS), ours(case, EPOCHS)
    assert expected["clip_fraction"] > 0.001, "the clip is at work"
    for name, share in (("policy_loss", 0.01), ("value_loss", 0.0), ("entropy", 0.0)):
        assert abs(found[name] - expected[name]) < BOUND * max(abs(expected[name]), share), name
    for name, found_layers in networks(model.policy).items():
        weights = [layer.weight.detach().numpy() for layer in found_layers]
        arrays = [np.array(found["arrays"][f"{name}.{i}.weight"]) for i in range(len(weights))]
        assert difference(arrays, weights) < BOUND, name
        if name == "actor":
            assert difference(before, weights) > 10.0 * BOUND, "the passes moved the weights"
