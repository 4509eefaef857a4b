"""How what happened becomes what is logged: reading times that jitter, counts, noise, readings that come twice."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

COUNTS = 4096
"""Of a turn of the encoder."""

QUANTUM = 2 * np.pi / COUNTS


@dataclass
class Reader:
    """Reads a joint at about `rate` Hz."""

    rng: np.random.Generator
    rate: float = 200.0
    noise: float = 4e-4
    repeat: float = 0.03
    """Chance that a row shows the reading before again."""
    times: list[float] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)
    velocities: list[list[float]] = field(default_factory=list)
    errors: list[np.ndarray] = field(default_factory=list)
    """What fresh readings are off a perfect sensor's, rad."""
    next: float = 0.0
    _filtered: np.ndarray | None = None
    _last: tuple[float, np.ndarray] | None = None

    def due(self, time: float) -> bool:
        return time >= self.next

    def read(self, time: float, position: np.ndarray) -> None:
        """Takes a reading of `position`, what the encoder is at, now."""
        self.next = time + max(1.0 / self.rate + float(self.rng.normal(0.0, 3e-4)), 5e-4)
        noisy = position + self.rng.normal(0.0, self.noise, position.shape)
        counted = np.round(noisy / QUANTUM) * QUANTUM
        velocity = np.zeros_like(counted)
        if self._last is not None:
            # The servo's own estimate: differences, smoothed.
            velocity = (counted - self._last[1]) / max(time - self._last[0], 1e-4)
            velocity = self._filtered + 0.4 * (velocity - self._filtered)
        self._filtered = velocity
        self._last = (time, counted)
        if self.positions and self.rng.random() < self.repeat:
            counted, velocity = np.array(self.positions[-1]), np.array(self.velocities[-1])
        else:
            self.errors.append(counted - position)
        self.times.append(time + float(self.rng.normal(0.0, 1e-4)))
        self.positions.append([float(x) for x in counted])
        self.velocities.append([float(x) for x in velocity])

    def floor(self) -> list[float]:
        """Root mean square error of fresh readings, per joint, rad."""
        return [float(x) for x in np.sqrt(np.mean(np.square(self.errors), axis=0))]
