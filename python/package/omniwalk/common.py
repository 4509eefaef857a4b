"""What the environments have in common: how they are configured, their spaces, their random seeds."""

import json
import operator
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
from gymnasium import spaces

from omniwalk._native import Batch, wrong

Config = str | PathLike[str] | None
"""A TOML file that is laid over the defaults, or none."""

Changes = Mapping[str, Any] | None
"""Single settings by their dotted key, such as {"engine.kind": "rapier", "robot.path": "my_robot"}, laid over that."""


def batch(config: Config, changes: Changes, num_envs: int | None, threads: int | None, under: Changes = None) -> Batch:
    """Environments as arrays; the changes `under` lie under `changes`."""
    if not isinstance(changes, Mapping | None):
        raise wrong("changes", "a mapping of settings by their dotted key, or None", changes)
    words = [f"{key}={toml(value)}" for key, value in {**(under or {}), **(changes or {})}.items()]
    return Batch(config, words, num_envs, threads)


def toml(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, PathLike):
        value = value.__fspath__()
    return json.dumps(value.tolist() if isinstance(value, np.ndarray | np.generic) else value)


def observation_space(given: Batch) -> spaces.Box:
    """One robot's observation; `Batch.observation_names` says what its entries are."""
    return spaces.Box(-np.inf, np.inf, (given.observation_len,), np.float32)


def action_space(given: Batch) -> spaces.Box:
    """One robot's action, an entry for each of `Batch.joints`: 0 is the middle of a joint's range."""
    return spaces.Box(-1.0, 1.0, (given.action_len,), np.float32)


def checked(seed: Any) -> int | None:
    """A seed as Gymnasium and Stable-Baselines3 take it."""
    if seed is None:
        return None
    try:
        whole = operator.index(seed)
    except TypeError:
        whole = -1
    if whole < 0:
        raise wrong("seed", "a whole number from 0 on, or None", seed)
    return whole


def seed_of(given: int | None, generator: np.random.Generator) -> int:
    """The seed of a batch: the given one, or one from the generator."""
    return int(generator.integers(1 << 63)) if given is None else given % (1 << 64)


def actions_of(given: Any, shape: tuple[int, ...], argument: str) -> np.ndarray:
    """Actions as the batch reads them; nothing is copied if they already are such an array."""
    try:
        actions = np.asarray(given, np.float32, order="C")
    except (TypeError, ValueError):
        actions = None
    if actions is None or actions.shape != shape:
        raise wrong(argument, f"numbers with shape {shape}", actions if actions is not None and actions.shape else given)
    return actions


def episodes(given: Batch) -> dict[int, dict]:
    """The records of the episodes that ended in the last step, by environment."""
    return {record["environment"]: record for record in json.loads(given.take_episodes())}


def summary(record: dict) -> dict[str, Any]:
    """What a user wants to know of a finished episode. The velocity errors (m/s, rad/s) are those of averages over a second while the
    command was held; not a number where it never was for so long."""
    tracking = record["tracking"] or {}
    return {
        "end": END[record["end"]],
        "steps": record["steps"],
        "return": sum(record["terms"].values()),
        "terms": record["terms"],
        "desired_velocity": np.array(record["desired"]),
        "drift": record["drift"],
        "error_xy_mps": tracking.get("error_xy_mps", np.nan),
        "error_yaw_radps": tracking.get("error_yaw_radps", np.nan),
        "touchdowns_per_second": np.array(record["touchdowns_per_second"]),
    }


END = {"Fallen": "fallen", "Overlap": "leg_overlap", "TimeOut": "time_out", "Lost": "lost"}
"""How episodes end: the robot fell, its legs passed through each other, the time was over, the physics went non-finite."""
