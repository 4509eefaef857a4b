"""Many robots as a vector environment of Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

try:
    from stable_baselines3.common.vec_env import base_vec_env as base
except ImportError as error:
    raise ImportError("omniwalk.VecEnv needs Stable-Baselines3: pip install stable-baselines3") from error

from omniwalk import common


class VecEnv(base.VecEnv):
    """Robots side by side, stepped by all cores with Python's lock released; see `omniwalk.Env` for what they do.

        model = PPO("MlpPolicy", omniwalk.VecEnv(num_envs=64, config="configs/forward.toml"))

    `infos` of an episode that ended hold what Stable-Baselines3 reads (`terminal_observation`, `TimeLimit.truncated`, `episode`) and
    `episode_end`.
    """

    def __init__(
        self,
        num_envs: int | None = None,
        config: common.Config = None,
        changes: common.Changes = None,
        *,
        threads: int | None = None,
    ) -> None:
        self._batch = common.batch(config, changes, num_envs, threads)
        self.observation_names: list[str] = self._batch.observation_names
        self.joints: list[str] = self._batch.joints
        self._observations, self._final = self._batch.observations, self._batch.final_observations
        self._rewards = self._batch.rewards
        self._terminated, self._truncated = self._batch.terminated, self._batch.truncated
        self._seeded = False
        self._actions: np.ndarray | None = None
        # Asked for by the base class.
        self.render_mode = None
        self.num_envs = self._batch.environments
        super().__init__(self.num_envs, common.observation_space(self._batch), common.action_space(self._batch))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Notes the seed of the next reset."""
        return super().seed(common.checked(seed))

    def reset(self) -> np.ndarray:
        """Starts an episode everywhere; after `seed`, the first ones of that seed."""
        seed = self._seeds[0]
        first = seed is not None or not self._seeded
        self._batch.reset(common.seed_of(seed, np.random.default_rng()) if first else None)
        self._seeded = True
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self._observations.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Notes the actions of the next step."""
        self._actions = common.actions_of(actions, (self.num_envs, *self.action_space.shape), "actions")

    def step_wait(self) -> base.VecEnvStepReturn:
        """One control step of every robot."""
        if self._actions is None:
            raise RuntimeError("step_wait comes after step_async")
        self._batch.step(self._actions)
        self._actions = None
        dones = self._terminated | self._truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            self._endings(infos)
        return self._observations.copy(), self._rewards.copy(), dones, infos

    def _endings(self, infos: list[dict[str, Any]]) -> None:
        for environment, record in common.episodes(self._batch).items():
            end = common.summary(record)
            infos[environment] = {
                "terminal_observation": self._final[environment].copy(),
                "TimeLimit.truncated": bool(self._truncated[environment]),
                "episode": {"r": end["return"], "l": end["steps"]},
                "episode_end": end,
            }

    def close(self) -> None:
        """Nothing is left to be closed."""

    def set_desired(self, environment: int, velocity: tuple[float, float, float]) -> None:
        """Sets the desired velocity of a robot (m/s, m/s, rad/s), from its next observation on and in later episodes."""
        self._batch.set_desired(environment, velocity)

    def set_command_range(self, lower: tuple[float, float, float], upper: tuple[float, float, float]) -> None:
        """Sets where every robot draws desired velocities from, from its next draw on."""
        self._batch.set_command_range(lower, upper)

    def set_factors(self, velocity: float, foot: float, push: float = 1.0) -> None:
        """Sets the curriculum's factors on the velocity and the foot term of the reward, and on the largest force of pushes."""
        self._batch.set_factors(velocity, foot, push)

    # The robots are one object: what is asked of each of them is answered by it.

    def get_attr(self, attr_name: str, indices: base.VecEnvIndices = None) -> list[Any]:
        """An attribute of this object, for each robot."""
        return [getattr(self, attr_name)] * len(self._places(indices))

    def set_attr(self, attr_name: str, value: Any, indices: base.VecEnvIndices = None) -> None:
        """Refused: single robots have no attributes."""
        raise AttributeError(f"the robots of omniwalk.VecEnv are one object; {attr_name} cannot be set for some of them")

    def env_method(self, method_name: str, *args: Any, indices: base.VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Calls `method_name(robot, ...)` of this object for each robot, such as `set_desired`."""
        method = getattr(self, method_name)
        return [method(environment, *args, **kwargs) for environment in self._places(indices)]

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: base.VecEnvIndices = None) -> list[bool]:
        """No robot has a wrapper of its own."""
        return [False] * len(self._places(indices))

    def _places(self, indices: base.VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))
