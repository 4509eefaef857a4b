"""Teaches a humanoid robot to walk in any direction: the controller of the robot, and the environments it learns in.

    controller = omniwalk.Controller("walk.omni")      # the loop on a robot
    env = omniwalk.Env("configs/forward.toml")         # Gymnasium, one robot
    envs = omniwalk.make_vec(64)                       # Gymnasium, many robots, stepped by all cores
    envs = omniwalk.VecEnv(num_envs=64)                # Stable-Baselines3, many robots

What goes wrong raises `omniwalk.Error`, with the message the command line gives.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from omniwalk._native import Controller, Error, OutOfRange, Robot, Status, __version__

if TYPE_CHECKING:
    from omniwalk.environment import Env
    from omniwalk.stable_baselines import VecEnv
    from omniwalk.vector import VectorEnv, make_vec

__all__ = [
    "Controller", "Env", "Error", "OutOfRange", "Robot", "Status", "VecEnv", "VectorEnv", "__version__", "make_vec",
]

# A robot needs neither Gymnasium nor PyTorch to run its controller.
_LATER = {
    "Env": "omniwalk.environment",
    "VectorEnv": "omniwalk.vector",
    "make_vec": "omniwalk.vector",
    "VecEnv": "omniwalk.stable_baselines",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'omniwalk' has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)


def __dir__() -> list[str]:
    return __all__
