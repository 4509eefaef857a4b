"""Velocity commands (m/s forward, m/s to the left, rad/s) for a robot that walks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Commands = Callable[[float], np.ndarray]

HELD = 2.0
"""How long a command of a tour holds, s."""

FIRST = 1.0
"""How long a tour steps in place before, s."""

FAST = np.array([0.5, 0.4, 0.5])
"""Largest command of a tour."""


def steady(command) -> Commands:
    """The same command throughout."""
    held = np.array(command, float)
    return lambda time: held


def tour(rng: np.random.Generator, seconds: float) -> Commands:
    """Stepping in place, then one command after the other: forward or back, sideways, turning, or two of them at once."""
    count = int(max(seconds - FIRST, 0.0) / HELD) + 1
    # Every way is gone before one comes again.
    ways = [rng.permutation(3) for _ in range(count // 3 + 1)]
    pieces = [np.zeros(3)]
    for way in np.concatenate(ways)[:count]:
        piece = np.zeros(3)
        piece[way] = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.0)
        if rng.random() < 0.4:
            piece[(way + 1) % 3] = rng.uniform(-0.6, 0.6)
        pieces.append(piece * FAST)
    return lambda time: pieces[0] if time < FIRST else pieces[1 + min(int((time - FIRST) / HELD), count - 1)]
