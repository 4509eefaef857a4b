"""Reads a robot folder: one URDF, and `robot.toml` for what a URDF cannot say."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import tree, urdf
from .pose import Pose, from_rpy
from .tree import Tree
from .urdf import Urdf

DEFAULT_REACH = 0.5
"""Without gains, a motor gives its full torque at this error, rad (m),"""

DEFAULT_DAMPING_TIME = 0.025
"""and damps with this time constant `kd / kp`, s."""


@dataclass
class Motor:
    """A position servo, `torque = kp (target - q) - kd dq` within +-`torque_limit`, with the stiffness it really has; SI units."""

    kp: float
    kd: float
    torque_limit: float
    speed_limit: float


@dataclass
class JointModel:
    """What acts at a moving joint: limits and nominal position (rad or m), passive dynamics (SI), motor."""

    limits: tuple[float, float]
    nominal: float
    armature: float
    damping: float
    friction: float
    motor: Motor | None


@dataclass
class Foot:
    """A flat sole: `pose` of its centre in the frame of body number `body`, half length and half width, m."""

    name: str
    body: int
    pose: Pose
    half_extents: tuple[float, float]

    def corners(self) -> list[np.ndarray]:
        """The four corners in the body's frame, m."""
        x, y = self.half_extents
        return [self.pose.point(np.array([a * x, b * y, 0.0])) for a in (1, -1) for b in (1, -1)]


@dataclass
class Robot:
    """The robot as both sides of the comparison understand it. `joints` and `nominal` go with `tree.joints`;
    `contacts` are further points (body, m) that touch the ground; `overlaps` are the pairs of bodies that must not pass
    through each other; `policy` names the joints a policy moves; `fixed_pose` is the world pose of a base that does not
    float; `beyond` are the effects that no rigid body has, each with what it is on."""

    name: str
    floating: bool
    fixed_pose: Pose
    tree: Tree
    joints: list[JointModel]
    feet: list[Foot]
    contacts: list[tuple[int, np.ndarray]]
    overlaps: list[tuple[int, int]]
    policy: list[str]
    beyond: list[str]

    def nominal(self) -> list[float]:
        """Nominal positions of all moving joints, mimic joints included (rad or m)."""
        own = {joint.name: model.nominal for joint, model in zip(self.tree.joints, self.joints)}
        return self.tree.positions(own)

    def limits(self, name: str) -> tuple[float, float]:
        """Position limits of a joint that moves by itself, rad or m: its own, tightened by those of the joints that follow it."""
        models = dict(zip((joint.name for joint in self.tree.joints), self.joints))
        lower, upper = models[name].limits
        for joint in self.tree.joints:
            leader, ratio, offset = joint.mimic or ("", 0.0, 0.0)
            if leader == name and ratio != 0:
                ends = [(limit - offset) / ratio for limit in models[joint.name].limits]
                lower, upper = max(lower, min(ends)), min(upper, max(ends))
        return lower, upper

    def base_pose(self) -> Pose:
        """Where the base stands in the nominal pose: upright, the lowest contact point on the plane z = 0. Without
        contact points its frame is on the plane."""
        if not self.floating:
            return self.fixed_pose
        poses = self.tree.poses(Pose(), self.nominal())
        points = self.contacts + [(foot.body, corner) for foot in self.feet for corner in foot.corners()]
        heights = [poses[body].point(point)[2] for body, point in points]
        return Pose(translation=np.array([0.0, 0.0, -min(heights, default=0.0)]))


def load(path: Path, soles: Sequence[dict] = ()) -> Robot:
    """Reads a robot folder, or a URDF with perhaps a TOML of its name beside it. Raises `ValueError` on what it
    cannot understand: the Rust loader is the one that explains errors, and that guesses soles where none are given, which it hands
    over as `soles`.
    """
    description, settings = _read(path)
    values = {joint.name: _joint_values(settings, joint.name) for joint in description.joints}
    locked = {
        name: values[name].get("nominal", 0.0)
        for name in values
        if any(_matches(name, pattern) for pattern in settings.get("locked", []))
    }
    root, given_base, base_pose = _base(description)
    merged = tree.build(description, root, tree.held_positions(description, locked))
    beyond = [effect for entry in settings.get("effect", []) for effect in _effect(merged, entry)]
    joints = [_joint_model(joint, values[joint.name]) for joint in merged.joints]
    feet = [_foot(merged, entry) for entry in settings.get("foot", [])] or [_sole(merged, sole) for sole in soles]
    base = settings.get("base", given_base or ("floating" if feet else "fixed"))
    return Robot(
        name=description.name,
        floating=base == "floating",
        fixed_pose=base_pose,
        tree=merged,
        joints=joints,
        feet=feet,
        contacts=[contact for entry in settings.get("contact", []) for contact in _contact(merged, entry)],
        overlaps=[tuple(merged.body_of(link)[0] for link in pair) for pair in settings.get("overlap_pairs", [])],
        policy=_policy(settings, merged, joints),
        beyond=beyond,
    )


def _effect(merged: Tree, entry: dict) -> list[str]:
    """Changes the bodies by an effect on links. Of others, which act between motors, joints and encoders, the names."""
    for body in merged.bodies:
        if not any(_matches(body.name, pattern) for pattern in entry["match"]):
            continue
        place = np.array([entry.get(axis, 0.0) for axis in "xyz"])
        match entry["id"]:
            case "mass":
                body.mass, body.inertia = entry["factor"] * body.mass, entry["factor"] * body.inertia
            case "centre_of_mass":
                body.com = body.com + place
            case "payload":
                body.add(entry["mass"], place, np.zeros((3, 3)))
    if entry["id"] in ("mass", "centre_of_mass", "payload"):
        return []
    joints = [joint.name for joint in merged.joints]
    return [f"{entry['id']} ({name})" for name in joints if any(_matches(name, p) for p in entry["match"])]


def _read(path: Path) -> tuple[Urdf, dict]:
    """The URDF, and the TOML or an empty table."""
    if path.is_dir():
        urdfs = list(path.glob("*.urdf"))
        if len(urdfs) != 1:
            raise ValueError(f"{path}: one URDF expected, found {len(urdfs)}")
        tomls = [path / "robot.toml", path / f"{path.resolve().name}.toml"]
    else:
        urdfs, tomls = [path], [path.with_suffix(".toml")]
    toml = next((toml for toml in tomls if toml.exists()), None)
    return urdf.read(urdfs[0]), tomllib.loads(toml.read_text()) if toml else {}


def _base(description: Urdf) -> tuple[str, str | None, Pose]:
    """The base link, and what the URDF says about how it is held: a floating joint from the root makes it float, a
    fixed joint from a massless `world` bolts it down at the joint's origin."""
    carried = description.children(description.root)
    if len(carried) == 1:
        joint = carried[0]
        if joint.kind == "floating":
            return joint.child, "floating", Pose()
        if joint.kind == "fixed" and description.root == "world" and description.links["world"].mass == 0:
            return joint.child, "fixed", joint.origin
    return description.root, None, Pose()


def _joint_values(settings: dict, name: str) -> dict:
    """What the TOML says of a joint: of the entries that match its name, the later win."""
    values: dict = {}
    for entry in settings.get("joint", []):
        if any(_matches(name, pattern) for pattern in entry["match"]):
            values |= {key: value for key, value in entry.items() if key != "match"}
    return values


def _matches(name: str, pattern: str) -> bool:
    """Whether `name` matches `pattern`, in which `*` stands for any characters."""
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), name) is not None


def _joint_model(joint: urdf.Joint, values: dict) -> JointModel:
    lower, upper = values.get("limits", joint.limits)
    return JointModel(
        limits=(lower, upper),
        nominal=values.get("nominal", min(max(0.0, lower), upper)),
        armature=values.get("armature", 0.0),
        damping=values.get("damping", joint.damping),
        friction=values.get("friction", joint.friction),
        motor=None if joint.mimic else _motor(joint, values),
    )


def _motor(joint: urdf.Joint, values: dict) -> Motor | None:
    """The motor of the TOML, completed by the URDF's effort and velocity; none if a limit is nowhere given."""
    torque_limit = values.get("torque_limit", joint.effort)
    speed_limit = values.get("speed_limit", joint.velocity)
    if not (0 < torque_limit < math.inf and 0 < speed_limit < math.inf):
        return None
    kp = values.get("kp", torque_limit / DEFAULT_REACH)
    return Motor(values.get("kp_scale", 1.0) * kp, values.get("kd", kp * DEFAULT_DAMPING_TIME), torque_limit, speed_limit)


def _foot(merged: Tree, entry: dict) -> Foot:
    body, link = merged.body_of(entry["link"])
    sole = link @ from_rpy(entry.get("sole", [0.0, 0.0, 0.0]), entry.get("rpy", [0.0, 0.0, 0.0]))
    length, width = entry["size"]
    return Foot(entry.get("name", entry["link"]), body, sole, (length / 2, width / 2))


def _sole(merged: Tree, sole: dict) -> Foot:
    """A sole with its pose in the frame of its body."""
    body, link = merged.body_of(sole["link"])
    pose = link @ Pose(np.array(sole["rotation"], float), np.array(sole["translation"], float))
    return Foot(sole["name"], body, pose, tuple(sole["half_extents"]))


def _contact(merged: Tree, entry: dict) -> list[tuple[int, np.ndarray]]:
    body, link = merged.body_of(entry["link"])
    return [(body, link.point(np.array(point, float))) for point in entry["points"]]


def _policy(settings: dict, merged: Tree, joints: list[JointModel]) -> list[str]:
    """The policy's joints in its order: pattern by pattern, each in the tree's order; all motors by default."""
    free = [joint.name for joint in merged.joints if joint.mimic is None]
    moved = [joint.name for joint, model in zip(merged.joints, joints) if model.motor is not None]
    if "policy" not in settings:
        return moved
    return list(dict.fromkeys(name for pattern in settings["policy"] for name in free if _matches(name, pattern)))
