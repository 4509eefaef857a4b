"""What can be wrong with a machine, and how a case is drawn.

Names and parameters are those that reports use, so that a guess can be compared with the truth. The physics behind a
name is in `actuator.py`, in another form than the one that is fitted where there is another form.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

Range = tuple[float, float]

COUPLING_DAMPING: Range = (0.25, 0.5)
"""Damping of a rotor on play or spring, as a share of the critical one. With less, servos that look at the joint shake machines to and fro
all the time: nobody records one that does."""

RIG_MOTION = 1.2
"""How far the joint of a rig moves to either side, rad."""

INSIDE: dict[str, dict[str, Range]] = {
    "command_delay": {"time": (0.012, 0.035)},
    "command_rate_limit": {"speed": (0.25, 0.45)},
    "command_dead_band": {"width": (0.02, 0.05)},
    "command_gain": {"gain": (0.86, 0.94)},
    "supply_voltage": {"ratio": (0.72, 0.88)},
    "stribeck_friction": {"torque": (0.15, 0.3), "velocity": (0.1, 0.35)},
    "load_dependent_friction": {"coefficient": (0.12, 0.3)},
    "directional_friction": {"torque": (0.07, 0.15)},
    "backlash": {"gap": (0.025, 0.06), "coupling_damping": COUPLING_DAMPING},
    "elasticity": {"compliance": (0.04, 0.1), "coupling_damping": COUPLING_DAMPING},
    "position_ripple": {"amplitude": (0.12, 0.25), "frequency": (0.6, 1.6), "phase": (0.0, 2 * np.pi)},
    "payload": {"mass": (0.12, 0.3)},
    "sensor_offset": {"offset": (0.03, 0.08)},
    "sensor_delay": {"time": (0.012, 0.03)},
    "external_force": {"torque": (0.1, 0.25)},
}
"""Effects a library has. Torques are shares of the machine's typical torque (gravity), speeds of the motion's fastest,
compliance is a share of the motion per typical torque, a payload a share of the moved mass, other values absolute (SI) or shares;
frequency is in cycles per rad of a rig, and in as many over the whole motion of another machine: what has fewer is a curve and no ripple."""

OUTSIDE: dict[str, tuple[dict[str, Range], list[str]]] = {
    "ripple_with_beat": (
        {"amplitude": (0.12, 0.22), "frequency": (0.8, 1.4), "ratio": (1.15, 1.3), "phase": (0.0, 2 * np.pi)},
        ["position"],
    ),
    "thermal_drift": ({"share": (1.5, 3.0), "time_constant": (4.0, 12.0)}, ["time", "temperature"]),
    "cable_spring": ({"torque": (0.25, 0.5), "from": (-0.2, 0.2)}, ["position"]),
    "loose_mass": ({"mass": (0.25, 0.4), "play": (0.02, 0.04)}, ["position", "acceleration", "time", "torque", "load"]),
    "battery_sag": ({"share": (0.35, 0.6)}, ["load", "torque", "voltage"]),
}
"""Effects no library has, and the variables that may be named as leading. On which side a loose mass lies hangs on weight and acceleration, as
the joint's load and its motor's torque do."""

PAIRS = [
    ("stribeck_friction", "backlash"),
    ("command_delay", "stribeck_friction"),
    ("load_dependent_friction", "command_delay"),
    ("backlash", "sensor_offset"),
    ("position_ripple", "command_delay"),
    ("directional_friction", "elasticity"),
    ("supply_voltage", "stribeck_friction"),
    ("payload", "load_dependent_friction"),
]

WALKER_INSIDE: dict[str, dict[str, Range]] = {
    **{name: ranges for name, ranges in INSIDE.items() if name != "directional_friction"},
    "coulomb_friction": {"torque": (0.15, 0.35)},
    "backlash": {"gap": (0.01, 0.03), "coupling_damping": COUPLING_DAMPING},
    "elasticity": {"compliance": (0.01, 0.03), "coupling_damping": COUPLING_DAMPING},
}
"""Of a machine that walks. Its servos, which look at the joint, get no hold of a trunk behind more play or a softer spring. Its
maker knows of no dry friction, and what differs between the directions needs some: plain dry friction stands in its place."""

WALKER_PAIRS = [tuple("coulomb_friction" if name == "directional_friction" else name for name in pair) for pair in PAIRS]

WALKER_OUTSIDE = OUTSIDE | {
    "thermal_drift": ({"torque": (0.3, 0.6), "time_constant": (2.0, 5.0)}, ["time", "temperature"]),
}
"""Warmth adds friction to a machine that has none, and has to within a log."""

SIGNED = {"directional_friction", "sensor_offset", "external_force"}


@dataclass
class Effect:
    """One fault at one joint."""

    name: str
    joint: str
    parameters: dict[str, float]

    def get(self, key: str) -> float:
        return self.parameters[key]


@dataclass
class Case:
    """What is wrong in a sealed world."""

    kind: str
    """`none`, `single`, `pair` or `outside`."""
    effects: list[Effect] = field(default_factory=list)
    leading: list[str] = field(default_factory=list)
    """For outside effects, the variables that may be named first."""


@dataclass(frozen=True)
class Library:
    """What a machine's cases are drawn from."""

    inside: dict[str, dict[str, Range]]
    outside: dict[str, tuple[dict[str, Range], list[str]]]
    pairs: list[tuple[str, str]]


HELD = Library(INSIDE, OUTSIDE, PAIRS)
"""Of machines on a stand."""

WALKING = Library(WALKER_INSIDE, WALKER_OUTSIDE, WALKER_PAIRS)
"""Of machines that walk."""


KINDS = ["none", "single", "single", "outside", "none", "single", "pair", "outside"]
"""Kinds of consecutive seeds: a quarter is none."""


def draw_case(
    seed: int, rng: np.random.Generator, joints: list[str], scales: dict[str, dict[str, float]], library: Library = HELD
) -> Case:
    """Draws what is wrong. `scales` gives per joint what parameters are shares of."""
    kind = KINDS[seed % len(KINDS)]
    joint = joints[rng.integers(len(joints))]

    def draw(name: str, ranges: dict[str, Range]) -> Effect:
        values = {key: float(rng.uniform(*bounds)) * scales[joint].get(f"{name}.{key}", 1.0) for key, bounds in ranges.items()}
        if name in SIGNED:
            first = next(iter(values))
            values[first] *= rng.choice([-1.0, 1.0])
        return Effect(name, joint, values)

    if kind == "single":
        # Walks through the names so that a list of seeds covers them all.
        names = list(library.inside)
        singles = sum(KINDS[earlier % len(KINDS)] == "single" for earlier in range(seed))
        name = names[singles % len(names)]
        return Case(kind, [draw(name, library.inside[name])])
    if kind == "pair":
        pair = library.pairs[(seed // len(KINDS)) % len(library.pairs)]
        return Case(kind, [draw(name, library.inside[name]) for name in pair])
    if kind == "outside":
        names = list(library.outside)
        earlier = sum(KINDS[other % len(KINDS)] == "outside" for other in range(seed))
        name = names[earlier % len(names)]
        ranges, leading = library.outside[name]
        return Case(kind, [draw(name, ranges)], leading)
    return Case(kind)


WORN: dict[str, dict[str, Range]] = {
    "coulomb_friction": {"torque": (0.5, 1.0)},
    "backlash": {"gap": (0.03, 0.05), "coupling_damping": COUPLING_DAMPING},
    "command_delay": {"time": (0.07, 0.1)},
}
"""What is wrong with a worn knee, all at once: so much that the repository's policy walks badly with two of them."""

WORN_KNEES = ["left_knee_pitch", "right_knee_pitch"]


def draw_worn(rng: np.random.Generator, scales: dict[str, dict[str, float]]) -> Case:
    """A robot with worn knees."""
    faults = []
    for joint in WORN_KNEES:
        for name, ranges in WORN.items():
            values = {key: float(rng.uniform(*bounds)) * scales[joint].get(f"{name}.{key}", 1.0) for key, bounds in ranges.items()}
            faults.append(Effect(name, joint, values))
    return Case("worn", faults)


def scales(torque: float, speed: float, motion: float) -> dict[str, float]:
    """Typical torque (N m), speed (rad/s) and motion (rad) of a joint as what drawn shares are multiplied with."""
    of_torque = [
        *("stribeck_friction.torque", "directional_friction.torque", "position_ripple.amplitude"),
        *("external_force.torque", "ripple_with_beat.amplitude", "cable_spring.torque"),
        *("coulomb_friction.torque", "thermal_drift.torque"),
    ]
    return {key: torque for key in of_torque} | {
        "command_rate_limit.speed": speed,
        "elasticity.compliance": motion / torque,
        "position_ripple.frequency": RIG_MOTION / motion,
        "ripple_with_beat.frequency": RIG_MOTION / motion,
    }
