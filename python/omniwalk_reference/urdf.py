"""Reads what a URDF says about links and joints, without interpreting it.

Format: the URDF reference of ROS (links with inertial and collision elements, joints with origin, axis, limit,
mimic and dynamics). Visuals, meshes, transmissions and Gazebo blocks are skipped: they do not enter the dynamics.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .pose import Pose, from_rpy


Mimic = tuple[str, float, float]
"""The joint that is followed, ratio and offset: `position = ratio * position(joint) + offset`."""


@dataclass
class Shape:
    """A primitive in its link's frame. `size`: half extents of a box, radius of a sphere, (radius, half length)
    of a cylinder or capsule, m."""

    kind: str
    size: tuple[float, ...]
    pose: Pose


@dataclass
class Link:
    """A link: mass (kg), centre of mass (m) and inertia about it (kg m^2), both in the link frame."""

    name: str
    mass: float = 0.0
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    shapes: list[Shape] = field(default_factory=list)


@dataclass
class Joint:
    """A joint as written. Limits in rad or m, effort in N m or N, velocity in rad/s or m/s."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Pose
    axis: np.ndarray
    limits: tuple[float, float]
    effort: float
    velocity: float
    damping: float
    friction: float
    mimic: Mimic | None


@dataclass
class Urdf:
    """A whole file; `root` is the link that no joint carries."""

    name: str
    links: dict[str, Link]
    joints: list[Joint]
    root: str

    def children(self, link: str) -> list[Joint]:
        """The joints that `link` carries, in the file's order."""
        return [joint for joint in self.joints if joint.parent == link]


def read(path: Path) -> Urdf:
    """Reads a URDF file. Raises `ValueError` where the links do not form one tree."""
    root = ElementTree.parse(path).getroot()
    links = {element.attrib["name"]: _link(element) for element in root.findall("link")}
    joints = [_joint(element) for element in root.findall("joint")]
    carried = {joint.child for joint in joints}
    roots = [name for name in links if name not in carried]
    if len(roots) != 1 or len(carried) != len(joints) or len(joints) != len(links) - 1:
        raise ValueError(f"{path}: links and joints do not form one tree (links without a parent: {roots})")
    return Urdf(root.attrib.get("name", path.stem), links, joints, roots[0])


def _numbers(element: ElementTree.Element | None, key: str, default: str) -> np.ndarray:
    text = default if element is None else element.attrib.get(key, default)
    return np.array([float(number) for number in text.split()])


def _number(element: ElementTree.Element | None, key: str, default: float) -> float:
    return default if element is None else float(element.attrib.get(key, default))


def _origin(element: ElementTree.Element) -> Pose:
    origin = element.find("origin")
    return from_rpy(_numbers(origin, "xyz", "0 0 0"), _numbers(origin, "rpy", "0 0 0"))


def _link(element: ElementTree.Element) -> Link:
    link = Link(element.attrib["name"], shapes=_shapes(element))
    inertial = element.find("inertial")
    if inertial is not None:
        frame = _origin(inertial)
        entries = {key: _number(inertial.find("inertia"), key, 0.0) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
        xx, xy, xz, yy, yz, zz = entries.values()
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        link.mass = _number(inertial.find("mass"), "value", 0.0)
        link.com = frame.translation
        link.inertia = frame.rotation @ inertia @ frame.rotation.T
    return link


def _shapes(element: ElementTree.Element) -> list[Shape]:
    shapes = []
    for collision in element.findall("collision"):
        for primitive in collision.find("geometry"):
            if primitive.tag == "box":
                size = tuple(_numbers(primitive, "size", "") / 2)
            elif primitive.tag == "sphere":
                size = (_number(primitive, "radius", 0.0),)
            elif primitive.tag in ("cylinder", "capsule"):
                size = (_number(primitive, "radius", 0.0), _number(primitive, "length", 0.0) / 2)
            else:
                continue
            shapes.append(Shape(primitive.tag, size, _origin(collision)))
    return shapes


def _joint(element: ElementTree.Element) -> Joint:
    kind = element.attrib["type"]
    limit, dynamics, mimic = (element.find(tag) for tag in ("limit", "dynamics", "mimic"))
    unlimited = kind == "continuous" or limit is None
    axis = _numbers(element.find("axis"), "xyz", "1 0 0")
    norm = np.linalg.norm(axis)
    if kind in ("revolute", "continuous", "prismatic") and norm == 0:
        raise ValueError(f"joint {element.attrib['name']}: its axis is zero")
    return Joint(
        name=element.attrib["name"],
        kind=kind,
        parent=element.find("parent").attrib["link"],
        child=element.find("child").attrib["link"],
        origin=_origin(element),
        axis=axis / norm if norm else axis,
        limits=(-math.inf, math.inf) if unlimited else (_number(limit, "lower", 0.0), _number(limit, "upper", 0.0)),
        effort=_number(limit, "effort", math.inf),
        velocity=_number(limit, "velocity", math.inf),
        damping=_number(dynamics, "damping", 0.0),
        friction=_number(dynamics, "friction", 0.0),
        mimic=None
        if mimic is None
        else (mimic.attrib["joint"], _number(mimic, "multiplier", 1.0), _number(mimic, "offset", 0.0)),
    )
