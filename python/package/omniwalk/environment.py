"""One robot as an environment of Gymnasium."""

from typing import Any

import gymnasium
import numpy as np

from omniwalk import common
from omniwalk._native import wrong


class Env(gymnasium.Env[np.ndarray, np.ndarray]):
    """A robot that learns to walk at a desired velocity.

    Observations and actions are those of the controller, which is also what runs on the robot: the entries are named by
    `observation_names` and `joints`. Actions are in [-1, 1]. The reward is the sum of the configuration's terms, which `info`
    holds one by one; `info["episode_end"]` describes an episode that ended.

    Also `gymnasium.make("omniwalk.gym:omniwalk/Walk-v0")`. Many robots are faster together: `omniwalk.make_vec`.
    """

    metadata = {"render_modes": []}

    def __init__(self, config: common.Config = None, changes: common.Changes = None, render_mode: None = None) -> None:
        if render_mode is not None:
            right = "None (omniwalk draws no pictures while it steps; `omniwalk report` does afterwards)"
            raise wrong("render_mode", right, render_mode)
        # A single environment has nobody to be out of step with.
        self._batch = common.batch(config, changes, 1, 1, under={"task.random_first_length": False})
        self.observation_space = common.observation_space(self._batch)
        self.action_space = common.action_space(self._batch)
        self.observation_names: list[str] = self._batch.observation_names
        self.joints: list[str] = self._batch.joints
        self._observations = self._batch.observations
        self._final = self._batch.final_observations
        self._rewards, self._terms = self._batch.rewards, self._batch.terms
        self._terminated, self._truncated = self._batch.terminated, self._batch.truncated
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Starts an episode; with a `seed`, the first one of that seed."""
        seed = common.checked(seed)
        super().reset(seed=seed)
        first = seed is not None or not self._seeded
        self._batch.reset(common.seed_of(seed, self.np_random) if first else None)
        self._seeded = True
        return self._observations[0].copy(), {"desired_velocity": np.array(self._batch.desired(0))}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control step."""
        self._batch.step(common.actions_of(action, self.action_space.shape, "action")[None])
        terminated, truncated = bool(self._terminated[0]), bool(self._truncated[0])
        info: dict[str, Any] = dict(zip(self._batch.term_names, self._terms[0].tolist()))
        row = self._observations[0]
        if terminated or truncated:
            row = self._final[0]
            info["episode_end"] = common.summary(common.episodes(self._batch)[0])
        info["desired_velocity"] = np.array(self._batch.desired(0))
        return row.copy(), float(self._rewards[0]), terminated, truncated, info

    def set_desired(self, velocity: tuple[float, float, float]) -> None:
        """Sets the desired velocity (forward m/s, left m/s, turn rad/s), from the next observation on and in later episodes."""
        self._batch.set_desired(0, velocity)
