"""Makes a case: a robot folder and logs for the identification, the truth in a file of its own elsewhere."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict
from pathlib import Path

import numpy as np

from . import effects, machine, motions, walk_case
from .effects import Case
from .stand import Stand

FIT = ["chirp", "multisine", "triangle", "steps", "swell", "multisine", "multisine", "triangle"]
HELD_OUT = ["multisine", "chirp", "triangle"]
REPEATED = 6
"""The motion with this number among `FIT` is the one before again: the spread of repeats."""

SECONDS = 6.0
LOW_GAIN = 0.6
"""What every other motion of the rig has of the servo's kp."""

MACHINES = ["rig", "leg", "walk", "worn"]


def name_of(kind: str, seed: int) -> str:
    return f"{kind}-{seed:04d}"


def generate(
    kind: str,
    seed: int,
    out: Path,
    seconds: float | None = None,
    walker: Path = walk_case.POLICY,
    count: int = len(FIT),
) -> Path:
    """Writes case `seed` of a machine under `out/cases`, its truth under `out/truth`; gives the case's folder.

    Each log lasts `seconds`, or as long as this machine's do; `walker` is the policy of machines that walk, `count` the number of logs
    to fit of those that do not.
    """
    folder = out / "cases" / name_of(kind, seed)
    if kind in ("walk", "worn"):
        truth = walk_case.write(seed, folder, seconds or walk_case.SECONDS, kind, walker)
    else:
        truth = _on_a_stand(kind, seed, folder, seconds or SECONDS, count)
    path = out / "truth" / f"{name_of(kind, seed)}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**truth, "machine": kind, "seed": seed}, indent=1) + "\n")
    return folder


def _on_a_stand(kind: str, seed: int, folder: Path, seconds: float, count: int) -> dict:
    """Writes robot and logs of a machine on a stand into `folder`; gives the truth."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    built = {"rig": machine.rig, "leg": machine.leg}[kind](lambda low, high: float(rng.uniform(low, high)))
    typical = Stand(built, Case("none"), rng).typical(built.motions)
    scales = {
        joint.name: effects.scales(torque, 4.4 * built.motions, built.motions)
        | {"payload.mass": joint.mass, "sensor_offset.offset": min(1.0, built.motions)}
        for joint, torque in zip(built.joints, typical)
    }
    case = effects.draw_case(seed, rng, [joint.name for joint in built.joints], scales)
    stand = Stand(built, case, rng)
    built.write(folder / "robot")
    floors = {}
    to_fit = [FIT[number % len(FIT)] for number in range(count)]
    for part, shapes in (("fit", to_fit), ("heldout", HELD_OUT)):
        for number, shape in enumerate(shapes):
            # A repeat is its motion again, with other noise.
            drawn = number - 1 if part == "fit" and number % len(FIT) == REPEATED else number
            plan = np.random.default_rng([seed, 1 if part == "fit" else 2, drawn])
            middle = [_middle(joint) for joint in built.joints]
            moves = [motions.motion(shape, plan, at, built.motions, seconds) for at in middle]
            gain = LOW_GAIN if kind == "rig" and drawn % 2 else 1.0
            off_from = 2 / 3 * seconds if shape == "steps" and kind == "rig" else seconds
            recorded = stand.record(moves, middle, seconds, gain, off_from)
            groups = {"shape": shape, "motion": f"{part}{drawn}", "gain": f"{gain}"}
            kp = {f"joint.{joint.name}.kp": joint.servo.kp * gain for joint in built.joints if gain != 1.0}
            late = np.random.default_rng([seed, 3, number])
            log = f"{part}/{number:02d}-{shape}"
            recorded.log.write(folder / f"{log}.mcap", groups, kp, lambda: float(late.uniform(2e-4, 1.5e-3)))
            floors[log] = dict(zip(stand.names, recorded.floor))
    return {
        "case": asdict(case),
        "servos": {joint.name: asdict(joint.servo) for joint in stand.machine.joints},
        "floor": floors,
    }


def _middle(joint: machine.Joint) -> float:
    """Where a joint moves about, rad: its zero, or the middle of a range that lies to one side."""
    middle = 0.5 * sum(joint.limits)
    return middle if abs(middle) > 0.5 else 0.0
