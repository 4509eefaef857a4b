"""The task and the hyper-parameters, read from the project's own configuration files."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "configs/forward.toml"
RESULTS = ROOT / "docs/measured/baselines"
"""Where results are kept: a curve (CSV) and a summary (JSON) a run."""

STEPS = 2_000_000
SEEDS = (1, 2, 3)

EQUAL = {
    "ppo.policy": "gaussian",
    "ppo.schedule": {"type": "fixed"},
    "ppo.dual_clip": 0.0,
    "ppo.mode_weight": 0.0,
    "curriculum.scheduler": False,
    "curriculum.velocity_start": 1.0,
    "curriculum.foot_start": 1.0,
}
"""What takes from our learner all that Stable-Baselines3's does not have: Beta policy, adaptive learning rate, dual clip, curriculum."""


@dataclass(frozen=True)
class Variant:
    """A way to learn the task: `learner` is `omniwalk` or `sb3`, `world` what it learns in, `settings` whose they are."""

    name: str
    learner: str
    world: str
    settings: str
    title: str


VARIANTS = [
    Variant("omniwalk", "omniwalk", "lanes", "shipped", "omniwalk, as shipped"),
    Variant("omniwalk-equal", "omniwalk", "lanes", "equal", "omniwalk, settings both have"),
    Variant("sb3-lanes-ours", "sb3", "lanes", "ours", "SB3 in our environment, our hyper-parameters"),
    Variant("sb3-lanes-recommended", "sb3", "lanes", "recommended", "SB3 in our environment, its recommendation"),
    Variant("sb3-mujoco-ours", "sb3", "mujoco", "ours", "SB3 in MuJoCo, our hyper-parameters"),
    Variant("sb3-mujoco-recommended", "sb3", "mujoco", "recommended", "SB3 in MuJoCo, its recommendation"),
]
"""Those that take the least time first."""


def task(config: Path = CONFIG) -> dict:
    """The whole configuration: `config` over the defaults."""
    return _over(tomllib.loads((ROOT / "configs/default.toml").read_text()), tomllib.loads(config.read_text()))


def _over(defaults: dict, changes: dict) -> dict:
    merged = dict(defaults)
    for key, value in changes.items():
        merged[key] = _over(merged[key], value) if isinstance(value, dict) else value
    return merged


def sb3(name: str) -> dict:
    """Settings of Stable-Baselines3's PPO: how many robots, the factor on rewards (none: they are divided by their running spread), the
    bound of normalised observations, and the arguments of PPO.

    `recommended`: PPO's defaults, which its documentation gives as those for continuous control of the paper, around eight
    environments, with observations and rewards normalised ("Reinforcement Learning Tips and Tricks": "normalization is critical"
    for PPO). `ours`: the hyper-parameters of configs/forward.toml. Our value loss has a factor of one half which theirs has not.
    """
    if name == "recommended":
        return {"robots": 8, "scale": None, "clip": 10.0, "ppo": {}}
    config = task()
    ppo, train = config["ppo"], config["train"]
    arguments = {
        "n_steps": train["steps_per_update"],
        "batch_size": ppo["minibatch"],
        "n_epochs": ppo["epochs"],
        "learning_rate": ppo["learning_rate"],
        "gamma": ppo["gamma"],
        "gae_lambda": ppo["lambda"],
        "clip_range": ppo["clip"],
        "ent_coef": ppo["entropy_weight"],
        "vf_coef": 0.5 * ppo["value_weight"],
        "max_grad_norm": ppo["max_gradient_norm"],
        "policy_kwargs": {"net_arch": ppo["hidden"], "activation_fn": _activation(ppo["activation"])},
    }
    scale, clip = train["reward_scale"], ppo["observation_clip"]
    return {"robots": train["environments"], "scale": scale, "clip": clip, "ppo": arguments}


def _activation(name: str) -> type:
    import torch

    return {"tanh": torch.nn.Tanh, "elu": torch.nn.ELU, "relu": torch.nn.ReLU}[name]
