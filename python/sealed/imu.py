"""An inertial measurement unit in the trunk: attitude filter and gyroscope, a little off and noisy."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

TILT_BIAS, TILT_NOISE = 3e-3, 1e-3
"""Of the attitude filter, rad: how far off it is throughout a log, and how far each reading is off that."""

TURN_BIAS, TURN_NOISE = 3e-3, 0.01
"""Of the gyroscope, rad/s."""

FORCE_NOISE = 0.05
"""Of the accelerometer, m/s^2."""


@dataclass
class Imu:
    """Reads the base at about `rate` Hz."""

    rng: np.random.Generator
    rate: float = 200.0
    times: list[float] = field(default_factory=list)
    orientations: list[np.ndarray] = field(default_factory=list)
    """Of the base in the world (w, x, y, z)."""
    turnings: list[np.ndarray] = field(default_factory=list)
    """Angular velocities in the base's frame, rad/s."""
    forces: list[np.ndarray] = field(default_factory=list)
    """Specific forces in the base's frame, m/s^2."""
    next: float = 0.0

    def __post_init__(self) -> None:
        self.tilt = self.rng.normal(0.0, TILT_BIAS, 3)
        self.bias = self.rng.normal(0.0, TURN_BIAS, 3)

    def due(self, time: float) -> bool:
        return time >= self.next

    def read(self, time: float, orientation: np.ndarray, turning: np.ndarray, force: np.ndarray) -> None:
        """Takes a reading of what is true now."""
        self.next = time + max(1.0 / self.rate + float(self.rng.normal(0.0, 3e-4)), 5e-4)
        seen = orientation.copy()
        mujoco.mju_quatIntegrate(seen, self.tilt + self.rng.normal(0.0, TILT_NOISE, 3), 1.0)
        self.times.append(time + float(self.rng.normal(0.0, 1e-4)))
        self.orientations.append(seen)
        self.turnings.append(turning + self.bias + self.rng.normal(0.0, TURN_NOISE, 3))
        self.forces.append(force + self.rng.normal(0.0, FORCE_NOISE, 3))

    def attitude(self) -> np.ndarray:
        """Fused roll and pitch of the base by the last reading, rad."""
        return fused(self.orientations[-1])


def fused(orientation: np.ndarray) -> np.ndarray:
    """Fused roll and pitch against gravity, rad, of an orientation (w, x, y, z)."""
    w, x, y, z = orientation
    up_x, up_y = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
    return np.arcsin(np.clip([up_y, -up_x], -1.0, 1.0))
