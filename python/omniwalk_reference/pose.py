"""Rigid poses as (rotation, translation), the little of it that reading a robot needs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Pose:
    """Maps points of a child frame to its parent frame: `rotation @ point + translation` (m)."""

    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.point(other.translation))

    def point(self, point: np.ndarray) -> np.ndarray:
        """A point (m) of the child frame in the parent frame."""
        return self.rotation @ point + self.translation


def from_rpy(xyz: np.ndarray, rpy: np.ndarray) -> Pose:
    """URDF `origin`: translation (m), then roll, pitch, yaw (rad) about the fixed axes x, y, z."""
    x, y, z = (axis_angle(axis, angle) for axis, angle in zip(np.eye(3), rpy))
    return Pose(z @ y @ x, np.asarray(xyz, float))


def axis_angle(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix about a unit axis (Rodrigues)."""
    cross = skew(axis)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def skew(v: np.ndarray) -> np.ndarray:
    """The matrix of `v x`."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
