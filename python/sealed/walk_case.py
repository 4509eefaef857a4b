"""Cases of the walking humanoid: what is wrong with it, and the logs of its walks."""

from __future__ import annotations

import shutil
import zlib
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from omniwalk_reference import policy_file

from . import commands, effects, humanoid
from .effects import Case, Effect
from .humanoid import STEP, Humanoid
from .walk import World

ROOT = Path(__file__).resolve().parents[2]
ROBOT = ROOT / "robots" / "nimbro_op2x"
POLICY = ROOT / "runs" / "nimbro_op2x_omni" / "policy.omni"

LOGS = [("fit", 4), ("heldout", 2)]
SECONDS = 8.0


@cache
def maker() -> Humanoid:
    """The robot as its maker describes it."""
    return humanoid.read(ROBOT)


@cache
def policy(path: Path = POLICY) -> SimpleNamespace:
    return policy_file.read(path.read_bytes())


@cache
def typical() -> dict[str, dict[str, float]]:
    """What drawn shares are multiplied with, by leg joint: from a walk of the robot as its maker describes it."""
    walked = World(maker(), Case("none"), np.random.default_rng(0)).walk(
        policy(), commands.tour(np.random.default_rng(0), 4.0), 4.0, np.random.default_rng(0)
    )
    scales = {}
    for name, torque, speed, motion in zip(maker().names, walked.torque, walked.speed, walked.motion):
        mass = maker().carried(name)
        scales[name] = effects.scales(float(torque), float(speed), float(motion)) | {
            "payload.mass": mass,
            "loose_mass.mass": mass,
            "sensor_offset.offset": 0.5,
            # As many cycles within the motion as a rig has.
            "position_ripple.frequency": effects.RIG_MOTION / max(float(motion), 0.15),
            "ripple_with_beat.frequency": effects.RIG_MOTION / max(float(motion), 0.15),
        }
    return scales


def world(seed: int, machine: str = "walk", step: float = STEP) -> World:
    """The sealed world of a case of the machine `walk`, or `worn`, whose knees are, simulated in steps of `step` s."""
    rng = np.random.default_rng([seed, zlib.crc32(machine.encode())])
    if machine == "worn":
        case = effects.draw_worn(rng, typical())
    else:
        case = effects.draw_case(seed, rng, maker().carriers(), typical(), effects.WALKING)
    return World(maker(), replace(case, effects=[_placed(effect) for effect in case.effects]), rng, step)


def _placed(effect: Effect) -> Effect:
    """A cable is stretched from somewhere about the nominal pose on."""
    if effect.name != "cable_spring":
        return effect
    start = maker().nominal(effect.joint) + 0.5 * effect.get("from")
    return replace(effect, parameters=effect.parameters | {"from": start})


def write(seed: int, folder: Path, seconds: float, machine: str = "walk", walker: Path = POLICY) -> dict:
    """Writes robot and logs of case `seed` of a machine, in which the policy `walker` walks, into `folder`; gives the truth."""
    shutil.copytree(ROBOT, folder / "robot", dirs_exist_ok=True)
    try:
        return _walk(world(seed, machine), seed, folder, seconds, walker)
    except FloatingPointError:
        # What is between the flanks of a gap and a light link, such as a foot, is too stiff for the step (walk 606).
        return _walk(world(seed, machine, STEP / 4), seed, folder, seconds, walker)


def _walk(sealed: World, seed: int, folder: Path, seconds: float, walker: Path) -> dict:
    read = policy(walker)
    floors, walks = {}, {}
    for part, count in LOGS:
        for number in range(count):
            key = [seed, 1 if part == "fit" else 2, number]
            tour = commands.tour(np.random.default_rng(key), seconds)
            walked = sealed.walk(read, tour, seconds, np.random.default_rng([*key, 1]))
            late = np.random.default_rng([*key, 2])
            log = f"{part}/{number:02d}-tour"
            groups = {"motion": f"{part}{number}"}
            walked.log.write(folder / f"{log}.mcap", groups, {}, lambda: float(late.uniform(2e-4, 1.5e-3)))
            floors[log] = dict(zip(sealed.names, walked.floor))
            walks[log] = {"seconds": walked.seconds, "fell": walked.fell, "error": walked.error}
    return {
        "case": asdict(sealed.case),
        "servos": {name: asdict(servo) for name, servo in sealed.servos.items()},
        "floor": floors,
        "walks": walks,
    }
