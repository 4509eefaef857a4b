"""What the machine is told: smooth and sharp motions between limits, drawn by seed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

Motion = Callable[[float], float]


def motion(shape: str, rng: np.random.Generator, middle: float, amplitude: float, duration: float) -> Motion:
    """A target over time (s) that starts at `middle` and stays within `amplitude` (rad) of it."""
    return {"chirp": _chirp, "multisine": _multisine, "triangle": _triangle, "steps": _steps, "swell": _swell}[shape](
        rng, middle, amplitude, duration
    )


def _chirp(rng, middle, amplitude, duration) -> Motion:
    start, end = rng.uniform(0.2, 0.4), rng.uniform(1.5, 2.5)
    # Slower where it is large, as speed is what motors run out of.
    def at(t: float) -> float:
        frequency = start + (end - start) * t / duration
        phase = 2 * math.pi * (start * t + 0.5 * (end - start) * t * t / duration)
        return middle + amplitude * min(1.0, 0.7 / frequency) * math.sin(phase)

    return at


def _multisine(rng, middle, amplitude, duration) -> Motion:
    frequencies = rng.uniform(0.15, 1.6, 5)
    phases = rng.uniform(0, 2 * math.pi, 5)
    weights = 1.0 / (0.5 + frequencies)
    weights *= amplitude / weights.sum() * 1.3
    start = float(np.sum(weights * np.sin(phases)))

    def at(t: float) -> float:
        ramp = min(t / 0.5, 1.0)
        value = float(np.sum(weights * np.sin(2 * math.pi * frequencies * t + phases))) - (1.0 - ramp) * start
        return middle + min(max(ramp * value, -amplitude), amplitude)

    return at


def _triangle(rng, middle, amplitude, duration) -> Motion:
    period = duration / rng.integers(1, 3)
    size = amplitude * rng.uniform(0.6, 1.0)

    def at(t: float) -> float:
        x = (t / period) % 1.0
        return middle + size * (4 * x if x < 0.25 else 2 - 4 * x if x < 0.75 else 4 * x - 4)

    return at


def _steps(rng, middle, amplitude, duration) -> Motion:
    hold = 0.6
    levels = [middle, *(middle + rng.uniform(-amplitude, amplitude, int(duration / hold) + 1))]
    return lambda t: float(levels[int(t / hold)])


def _swell(rng, middle, amplitude, duration) -> Motion:
    frequency = rng.uniform(0.5, 0.9)
    return lambda t: middle + amplitude * (t / duration) * math.sin(2 * math.pi * frequency * t)
