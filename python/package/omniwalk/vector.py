"""Many robots as a vector environment of Gymnasium."""

from typing import Any

import numpy as np
from gymnasium import vector
from gymnasium.vector.utils import batch_space

from omniwalk import common


class VectorEnv(vector.VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Robots side by side, stepped by all cores with Python's lock released; see `omniwalk.Env` for what they do.

    An episode that ends starts anew in the same step: its last observation is in `infos["final_obs"]`, what became of it in
    `infos["final_info"]`. With `copy=False` the arrays that are returned are read-only views of the engine's memory, which every
    step writes over; by default they are the caller's to keep. Actions are read where they lie if they are float32.
    """

    metadata = {"render_modes": [], "autoreset_mode": vector.AutoresetMode.SAME_STEP}

    def __init__(
        self,
        num_envs: int | None = None,
        config: common.Config = None,
        changes: common.Changes = None,
        *,
        threads: int | None = None,
        copy: bool = True,
    ) -> None:
        self._batch = common.batch(config, changes, num_envs, threads)
        self.num_envs = self._batch.environments
        self.single_observation_space = common.observation_space(self._batch)
        self.single_action_space = common.action_space(self._batch)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_names: list[str] = self._batch.observation_names
        self.joints: list[str] = self._batch.joints
        self._observations, self._final = self._batch.observations, self._batch.final_observations
        self._rewards = self._batch.rewards
        self._terminated, self._truncated = self._batch.terminated, self._batch.truncated
        self._give = np.copy if copy else np.asarray
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Starts an episode everywhere; with a `seed`, the first ones of that seed."""
        seed = common.checked(seed)
        super().reset(seed=seed)
        first = seed is not None or not self._seeded
        self._batch.reset(common.seed_of(seed, self.np_random) if first else None)
        self._seeded = True
        return self._give(self._observations), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control step of every robot."""
        self._batch.step(common.actions_of(actions, self.action_space.shape, "actions"))
        infos: dict[str, Any] = {}
        if self._terminated.any() or self._truncated.any():
            infos = self._endings()
        give = self._give
        return give(self._observations), give(self._rewards), give(self._terminated), give(self._truncated), infos

    def _endings(self) -> dict[str, Any]:
        """Last observations and records of the episodes that ended."""
        infos: dict[str, Any] = {}
        for environment, record in common.episodes(self._batch).items():
            found = {"final_obs": self._final[environment].copy(), "final_info": common.summary(record)}
            infos = self._add_info(infos, found, environment)
        return infos

    def set_desired(self, environment: int, velocity: tuple[float, float, float]) -> None:
        """Sets the desired velocity of a robot (m/s, m/s, rad/s), from its next observation on and in later episodes."""
        self._batch.set_desired(environment, velocity)

    def set_command_range(self, lower: tuple[float, float, float], upper: tuple[float, float, float]) -> None:
        """Sets where every robot draws desired velocities from, from its next draw on."""
        self._batch.set_command_range(lower, upper)

    def set_factors(self, velocity: float, foot: float, push: float = 1.0) -> None:
        """Sets the curriculum's factors on the velocity and the foot term of the reward, and on the largest force of pushes."""
        self._batch.set_factors(velocity, foot, push)


def make_vec(
    num_envs: int | None = None,
    config: common.Config = None,
    changes: common.Changes = None,
    *,
    threads: int | None = None,
    copy: bool = True,
) -> VectorEnv:
    """Robots side by side under `config` (a TOML file over the defaults) and `changes` (settings by dotted key over that):
    `num_envs` of them or as many as it says (`train.environments`), stepped by `threads` or by all cores."""
    return VectorEnv(num_envs, config, changes, threads=threads, copy=copy)
