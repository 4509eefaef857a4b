"""From a URDF to the tree of bodies that move: fixed and locked joints merged, mimic chains resolved."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .pose import Pose, axis_angle, skew
from .urdf import Joint, Mimic, Shape, Urdf

MOVING = ("revolute", "continuous", "prismatic")
"""Joint types with one degree of freedom."""


@dataclass
class Body:
    """A rigid body: what a link carries without a moving joint in between, in the frame of the link next to
    the root. `frames` holds the poses of all links merged into it, in that frame."""

    name: str
    parent: int | None
    mass: float = 0.0
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    shapes: list[Shape] = field(default_factory=list)
    frames: dict[str, Pose] = field(default_factory=dict)

    def add(self, mass: float, com: np.ndarray, inertia: np.ndarray) -> None:
        """Adds a part: mass (kg), centre of mass (m), inertia about it (kg m^2), in the body's frame."""
        total = self.mass + mass
        if total == 0:
            self.inertia = self.inertia + inertia
            return
        centre = (self.mass * self.com + mass * com) / total
        self.inertia = (
            self.inertia - self.mass * _square(self.com - centre) + inertia - mass * _square(com - centre)
        )
        self.mass, self.com = total, centre


@dataclass
class Tree:
    """Bodies, parents first, and the moving joints: `joints[i]` carries `bodies[i + 1]`. A joint's `origin` is
    in its parent body's frame, `mimic` names a joint that is not a mimic joint."""

    bodies: list[Body]
    joints: list[Joint]

    def body_of(self, link: str) -> tuple[int, Pose]:
        """The body a link belongs to, and the link's pose in that body."""
        for index, body in enumerate(self.bodies):
            if link in body.frames:
                return index, body.frames[link]
        raise ValueError(f"no link {link!r} in the URDF")

    def positions(self, independent: dict[str, float]) -> list[float]:
        """Positions of all joints from those that follow no other (rad or m)."""
        values = []
        for joint in self.joints:
            leader, ratio, offset = joint.mimic or (joint.name, 1.0, 0.0)
            values.append(ratio * independent[leader] + offset)
        return values

    def poses(self, base: Pose, positions: list[float]) -> list[Pose]:
        """World poses of the bodies' frames."""
        poses = [base]
        for joint, position, body in zip(self.joints, positions, self.bodies[1:]):
            poses.append(poses[body.parent] @ joint.origin @ motion(joint, position))
        return poses


def motion(joint: Joint, position: float) -> Pose:
    """What a joint adds to its origin at `position` (rad or m)."""
    if joint.kind not in MOVING:
        return Pose()
    if joint.kind == "prismatic":
        return Pose(translation=position * joint.axis)
    return Pose(axis_angle(joint.axis, position))


def build(urdf: Urdf, root: str, held: dict[str, float]) -> Tree:
    """The tree from link `root` outward, with the joints in `held` (at these positions, rad or m) merged into the
    bodies that carry them."""
    tree = Tree([Body(root, None)], [])
    _absorb(urdf, held, tree, 0, root, Pose())
    mimics = {joint.name: joint.mimic for joint in urdf.joints}
    for joint in tree.joints:
        joint.mimic = _resolve(mimics, joint.mimic)
    return tree


def held_positions(urdf: Urdf, locked: dict[str, float]) -> dict[str, float]:
    """Positions (rad or m) of the joints that do not move: fixed ones, `locked` ones, and those that follow them."""
    held = {joint.name: 0.0 for joint in urdf.joints if joint.kind not in MOVING} | locked
    followers = [joint for joint in urdf.joints if joint.mimic is not None]
    for _ in followers:
        for joint in followers:
            leader, ratio, offset = joint.mimic
            if joint.name not in held and leader in held:
                held[joint.name] = ratio * held[leader] + offset
    return held


def _absorb(urdf: Urdf, held: dict[str, float], tree: Tree, index: int, name: str, pose: Pose) -> None:
    """Adds link `name` at `pose` in body `index`, then what hangs on it, depth first."""
    link, body = urdf.links[name], tree.bodies[index]
    body.frames[name] = pose
    body.add(link.mass, pose.point(link.com), pose.rotation @ link.inertia @ pose.rotation.T)
    body.shapes += [Shape(shape.kind, shape.size, pose @ shape.pose) for shape in link.shapes]
    for joint in urdf.children(name):
        origin = pose @ joint.origin
        if joint.name in held:
            _absorb(urdf, held, tree, index, joint.child, origin @ motion(joint, held[joint.name]))
        else:
            joint.origin = origin
            tree.joints.append(joint)
            tree.bodies.append(Body(joint.child, index))
            _absorb(urdf, held, tree, len(tree.bodies) - 1, joint.child, Pose())


def _resolve(mimics: dict[str, Mimic | None], mimic: Mimic | None) -> Mimic | None:
    """Follows a chain of mimic joints to the joint that moves by itself."""
    for _ in mimics:
        if mimic is None or mimics[mimic[0]] is None:
            return mimic
        leader, ratio, offset = mimics[mimic[0]]
        mimic = (leader, mimic[1] * ratio, mimic[1] * offset + mimic[2])
    raise ValueError(f"the mimic joints that follow {mimic[0]!r} form a circle")


def _square(v: np.ndarray) -> np.ndarray:
    return skew(v) @ skew(v)
