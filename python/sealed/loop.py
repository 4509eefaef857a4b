"""The closed loop's world: how a policy walks in the sealed world of a case, before and after it learned from its logs."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from . import walk_case
from .commands import steady

COMMANDS = [
    *((0.0, 0.0, 0.0), (0.6, 0.0, 0.0), (-0.6, 0.0, 0.0), (0.0, 0.6, 0.0), (0.0, -0.6, 0.0), (0.0, 0.0, 0.6)),
    *((0.0, 0.0, -0.6), (0.4, 0.4, 0.0), (0.4, 0.3, 0.0), (0.0, 0.4, 0.3)),
]
"""Those of `omniwalk eval`, m/s, m/s, rad/s."""

SEEDS = range(2)
"""Of noise and jitter; a world without any would play the same walk again."""

SECONDS = 10.0
"""Length of a walk, s."""


@dataclass
class Play:
    """One walk."""

    command: tuple[float, float, float]
    seed: int
    fell: bool
    seconds: float
    """To the fall, or all of it."""
    velocity_error: float | None
    """m/s; none where the robot fell before the command was held for a second."""
    turn_error: float | None
    """rad/s"""


def play(
    policy: Path, case: int, commands=COMMANDS, seeds=SEEDS, seconds: float = SECONDS, machine: str = "walk"
) -> list[Play]:
    """Lets a policy file walk in the sealed world of case `case` of a machine that walks."""
    world, read = walk_case.world(case, machine), walk_case.policy(policy)
    plays = []
    for command in commands:
        for seed in seeds:
            # Noise that no log of the case has seen.
            walked = world.walk(read, steady(command), seconds, np.random.default_rng([case, 3, seed]))
            velocity, turn = walked.error or (None, None)
            plays.append(Play(tuple(command), seed, walked.fell, walked.seconds, velocity, turn))
    return plays


def totals(plays: list[Play]) -> dict:
    """Falls, mean time to one (s), and mean errors of the walks that have any."""
    fell = [one.seconds for one in plays if one.fell]
    mean = lambda values: float(np.mean(values)) if values else None
    return {
        "walks": len(plays),
        "falls": len(fell),
        "seconds_to_fall": mean(fell),
        "velocity_error": mean([one.velocity_error for one in plays if one.velocity_error is not None]),
        "turn_error": mean([one.turn_error for one in plays if one.turn_error is not None]),
    }


def write(plays: list[Play], policy: Path, case: int, out: Path) -> Path:
    """Writes walks and totals as JSON into the folder `out`; gives the file."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"walk-{case:04d}-{policy.stem}.json"
    content = {"policy": policy.name, "case": case, "totals": totals(plays), "walks": [asdict(one) for one in plays]}
    path.write_text(json.dumps(content, indent=1) + "\n")
    return path


def table(plays: list[Play]) -> str:
    """A row a command, and one for all, as Markdown."""
    lines = ["| command | falls | time to fall s | error m/s | error rad/s |", "|---|---|---|---|---|"]
    for command in dict.fromkeys(one.command for one in plays):
        name = ", ".join(f"{part:.1f}" for part in command)
        lines.append(_row(name, totals([one for one in plays if one.command == command])))
    return "\n".join([*lines, _row("all", totals(plays))])


def _row(name: str, figures: dict) -> str:
    number = lambda value, digits: "-" if value is None else f"{value:.{digits}f}"
    falls = f"{figures['falls']} of {figures['walks']}"
    errors = [number(figures[key], 3) for key in ("velocity_error", "turn_error")]
    return f"| {' | '.join([name, falls, number(figures['seconds_to_fall'], 1), *errors])} |"
