"""The reward of the forward task in NumPy: thesis 7.3.3, with the weights of the configuration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass
class Truth:
    """A robot at the end of a control step: rotation, position and velocity (world frame) of its base, its turning in its own frame,
    its joints' positions in the policy's order, and of each foot the sole's centre and its y axis in the world."""

    rotation: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    turning: np.ndarray
    joints: np.ndarray
    soles: np.ndarray
    sideways: np.ndarray


class Judge:
    """The rewards of one robot, step after step."""

    def __init__(self, config: dict, nominal: np.ndarray, height: float) -> None:
        self.reward, task = config["reward"], config["task"]
        self.nominal, self.dt = nominal, 1.0 / config["engine"]["control_hz"]
        self.lowest = task["min_height"] * height
        self.tilt = math.sin(task["max_roll"]), math.sin(task["max_pitch"])
        needed = {"action_rate_weight": 0.0, "tap_weight": 0.0, "clock_swing": True, "commanded_heading": True, "pose_joints": ["*"]}
        others = {key: self.reward[key] for key, value in needed.items() if self.reward[key] != value}
        if others:
            raise ValueError(f"the reward is written for {needed}, not for {others}")
        self.gain = self.dt / (self.reward["velocity_filter"] + self.dt)
        self.reset(np.array([1.0, 0.0]))

    def reset(self, heading: np.ndarray) -> None:
        """Starts an episode; `heading` is the direction of the base's x axis on the ground."""
        self.heading, self.motion = heading, np.zeros(5)

    def stands(self, truth: Truth) -> bool:
        """Whether the robot has not fallen."""
        up = truth.rotation[2]
        return bool(
            truth.position[2] > self.lowest and up[2] > 0.0 and abs(up[1]) < self.tilt[0] and abs(up[0]) < self.tilt[1]
        )

    def terms(self, truth: Truth, commanded: np.ndarray, frame_was_set: bool, phase: float, slip: float) -> dict[str, float]:
        """The terms of the reward. `commanded` is what the policy was told when it acted; `frame_was_set` and `phase` are those
        of the observation after the step; `slip` is the sum of the squared speeds of loaded soles, (m/s)^2."""
        reward, dt = self.reward, self.dt
        error = self._velocity_error(truth, commanded, frame_was_set)
        pose = float(np.linalg.norm(truth.joints - self.nominal))
        return {
            "velocity": reward["velocity_weight"] * _kernel(error, reward["velocity_kernel"]) * dt,
            "pose": reward["pose_weight"] * _kernel(pose, reward["pose_kernel"]) * dt,
            "alive": reward["alive_weight"] * self.stands(truth) * dt,
            "foot": reward["foot_weight"] * _kernel(self._foot_error(truth, phase), reward["foot_kernel"]) * dt,
            "slip": -reward["slip_weight"] * slip * dt,
        }

    def _velocity_error(self, truth: Truth, commanded: np.ndarray, frame_was_set: bool) -> float:
        """Against the command: velocity in the base frame, along the commanded heading, and turn rate, behind a low-pass."""
        if frame_was_set:
            self.heading = heading(truth.rotation)
        else:
            cos, sin = math.cos(commanded[2] * self.dt), math.sin(commanded[2] * self.dt)
            self.heading = np.array([[cos, -sin], [sin, cos]]) @ self.heading
        base, (x, y), (a, b) = truth.rotation.T @ truth.velocity, truth.velocity[:2], self.heading
        motion = np.array([base[0], base[1], a * x + b * y, a * y - b * x, truth.turning[2]])
        self.motion = self.motion + self.gain * (motion - self.motion)
        return float(np.linalg.norm(commanded[[0, 1, 0, 1, 2]] - self.motion))

    def _foot_error(self, truth: Truth, phase: float) -> float:
        """The left foot swings in the first half of the cycle: heights of both soles, m, and their tilt, rad."""
        swing, stance = (0, 1) if phase < 0.5 else (1, 0)
        clearance = self.reward["clearance"] * math.sin(2.0 * math.pi * phase) ** 2
        weight = self.reward["foot_height_weight"]
        rolls = np.arcsin(np.clip(truth.sideways[:, 2], -1.0, 1.0))
        height, contact = weight * (clearance - truth.soles[swing, 2]), weight * truth.soles[stance, 2]
        return math.sqrt(height**2 + contact**2 + rolls @ rolls)


def heading(rotation: np.ndarray) -> np.ndarray:
    """The direction of the x axis on the ground, a unit vector."""
    return rotation[:2, 0] / np.linalg.norm(rotation[:2, 0])


def _kernel(x: float, l: float) -> float:
    return 1.0 / math.cosh(min(l * x, 700.0))
