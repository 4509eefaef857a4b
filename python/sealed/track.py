"""How well a walking robot holds a commanded velocity, as `omniwalk eval` defines it (thesis 7.5): the norm of command minus
velocity averaged over a second, mean over the time after the command's ramp plus a second; the turn rate alike."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Track:
    """Velocities of one walk, a row a control step: forward, left (m/s, along the heading) and turn about the vertical (rad/s)."""

    window: int
    """Control steps in a second."""
    velocities: list[np.ndarray] = field(default_factory=list)
    errors: list[tuple[float, float]] = field(default_factory=list)
    steady: int = 0
    commanded: np.ndarray | None = None

    def add(self, velocity: np.ndarray, commanded: np.ndarray, desired: np.ndarray) -> None:
        """Takes in a step; `commanded` is the ramp towards `desired`."""
        self.velocities.append(velocity)
        held = self.commanded is not None and np.array_equal(commanded, self.commanded)
        self.steady = self.steady + 1 if held and np.abs(commanded - desired).max() < 1e-4 else 0
        self.commanded = commanded.copy()
        if self.steady >= self.window:
            error = commanded - np.mean(self.velocities[-self.window :], axis=0)
            self.errors.append((math.hypot(error[0], error[1]), abs(float(error[2]))))

    def error(self) -> tuple[float, float] | None:
        """Mean error of velocity, m/s, and turn rate, rad/s; none where no command was held for long enough."""
        return tuple(float(x) for x in np.mean(self.errors, axis=0)) if self.errors else None


def velocity(orientation: np.ndarray, linear: np.ndarray, turning: np.ndarray) -> np.ndarray:
    """Forward, left and turn rate of a base of `orientation` (w, x, y, z), whose origin moves by `linear` (m/s, world) and that
    turns by `turning` (rad/s, its own frame)."""
    w, x, y, z = orientation
    cos, sin = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
    length = math.hypot(cos, sin)
    cos, sin = cos / length, sin / length
    up = np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])
    return np.array([cos * linear[0] + sin * linear[1], cos * linear[1] - sin * linear[0], float(up @ turning)])
