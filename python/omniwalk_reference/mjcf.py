"""Writes a robot as a MuJoCo model (MJCF).

What the model is made of, and why:

- Bodies are the merged ones, so that MuJoCo's degrees of freedom are the robot's, plus one per mimic joint, which
  an equality constraint ties to the joint it follows. A massless body (a linkage plate) gets 1e-12 of
  the robot's mass, because MuJoCo refuses a moving body without any.
- Motors are `position` actuators: the implicitfast integrator takes their velocity gain implicitly, as the
  project's engines do, and clamps the sum of both terms at the torque limit. The speed limit of a motor is not
  part of the model; who needs it sets `forcerange` as the joint turns.
- A sole is a thin box with its lower face in the sole's plane: MuJoCo makes up to four contacts out of it, at the
  corners, which are the points the project's engines use. Further contact points are tiny spheres; the
  primitive shapes of all bodies without a sole collide as they are.
- Friction belongs to the floor (it has the higher priority), so that one geom carries what an episode randomises:
  tangential, torsional and rolling, in six-dimensional contacts with elliptic cones (thesis 7.4).
- Contacts, joint limits and couplings are as stiff as the time step allows: MuJoCo takes no time constant below
  two steps.
- Robot geoms collide with the floor only, as in the project's engines, unless `legs` is set: then the shapes of the bodies
  that must not pass through each other collide too.
- Effects on links are in the bodies. What else a robot has beyond rigid bodies (play, delays, encoders) no MJCF holds: a comment
  names it.
- The constraint Jacobian is dense: the Newton solver of MuJoCo 4.0.0 factors the Hessian of a sparse one wrongly
  (repaired in 4.0.1).
"""

from __future__ import annotations

import math
import re
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import mujoco
import numpy as np

from .pose import Pose
from .robot import Robot
from .tree import Body

SOLE_THICKNESS = 0.01
"""Thickness of a sole's box, m. Only its lower face touches the ground."""

POINT_RADIUS = 0.0001
"""Radius of the sphere that stands for a contact point, m: by so much it touches before the point does."""

LEG_FRICTION = (0.4, 0.4, 0.0, 0.0, 0.0)
"""Of leg on leg: plastic and aluminium slide; only the tangential coefficients act in such a contact of three dimensions."""

FRICTION = (0.6, 0.2, 0.1)
"""Tangential, torsional (m) and rolling (m) friction: the middle of the thesis's ranges (7.5)."""


def write(robot: Robot, physics_hz: float = 1000.0, *, legs: bool = False) -> str:
    """The robot on a plane as MJCF, with a keyframe `nominal`: standing in the nominal pose, targets there too. With `legs`
    the bodies of `robot.overlaps` collide with each other."""
    root = Element("mujoco", model=robot.name)
    if robot.beyond:
        # Names of joints may have two hyphens in a row, a comment must not.
        root.append(Comment(re.sub("-(?=-)", "- ", f" Not in this model: {', '.join(robot.beyond)} ")))
    SubElement(root, "compiler", angle="radian", autolimits="true", balanceinertia="false")
    SubElement(
        root,
        "option",
        timestep=_text(1 / physics_hz),
        integrator="implicitfast",
        cone="elliptic",
        jacobian="dense",
    )
    _defaults(root, 2 / physics_hz)
    world = SubElement(root, "worldbody")
    SubElement(world, "light", pos="0 0 3", dir="0 0 -1", directional="true")
    floor = SubElement(world, "geom", name="floor", type="plane", size="0 0 1", priority="1")
    floor.attrib |= {"contype": "1", "conaffinity": "0", "condim": "6", "friction": _text(*FRICTION)}
    elements = _bodies(robot, world)
    _collision(robot, elements)
    if legs:
        _legs(robot, root, elements, 2 / physics_hz)
    _couplings(robot, root)
    _motors(robot, root)
    _keyframe(robot, root)
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def _defaults(root: Element, time_constant: float) -> None:
    """Geoms collide with the floor only; every constraint is critically damped with the given time constant, s."""
    solref = _text(time_constant, 1.0)
    default = SubElement(root, "default")
    SubElement(default, "geom", contype="0", conaffinity="1", solref=solref, density="0")
    SubElement(default, "joint", solreflimit=solref)
    # An impedance next to one leaves a coupling no softness of its own beside the time constant.
    SubElement(default, "equality", solref=solref, solimp="0.9999 0.9999 0.001 0.5 2")


def _bodies(robot: Robot, world: Element) -> list[Element]:
    """The tree of bodies with inertias and joints, in the order of the robot's bodies."""
    bodies, mass = robot.tree.bodies, sum(body.mass for body in robot.tree.bodies)
    base = SubElement(world, "body", name=bodies[0].name, **_pose(robot.base_pose()))
    if robot.floating:
        SubElement(base, "freejoint", name="base")
    elements = [base]
    for joint, model, body in zip(robot.tree.joints, robot.joints, bodies[1:]):
        element = SubElement(elements[body.parent], "body", name=body.name, **_pose(joint.origin))
        entry = SubElement(element, "joint", name=joint.name, axis=_text(*joint.axis))
        entry.attrib["type"] = "slide" if joint.kind == "prismatic" else "hinge"
        entry.attrib |= {
            "armature": _text(model.armature),
            "damping": _text(model.damping),
            "frictionloss": _text(model.friction),
        }
        # A joint that follows another has its limits in the leader's.
        if joint.mimic is None and all(map(math.isfinite, limits := robot.limits(joint.name))):
            entry.attrib["range"] = _text(*limits)
        elements.append(element)
    for body, element in zip(bodies, elements):
        element.insert(0, _inertial(body, 1e-12 * mass))
    return elements


def _inertial(body: Body, least_mass: float) -> Element:
    if body.mass < least_mass:
        # As a ball of 10 cm: both stay above MuJoCo's least mass and inertia of 1e-15.
        least = _text(*[0.4 * 0.01 * least_mass] * 3)
        return Element("inertial", pos="0 0 0", mass=_text(least_mass), diaginertia=least)
    i = body.inertia
    full = _text(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    return Element("inertial", pos=_text(*body.com), mass=_text(body.mass), fullinertia=full)


def _collision(robot: Robot, elements: list[Element]) -> None:
    """Soles, contact points, and the shapes of bodies without a sole."""
    soled = {foot.body for foot in robot.feet}
    for foot in robot.feet:
        middle = foot.pose @ Pose(translation=np.array([0.0, 0.0, SOLE_THICKNESS / 2]))
        size = _text(*foot.half_extents, SOLE_THICKNESS / 2)
        SubElement(elements[foot.body], "geom", name=f"sole_{foot.name}", type="box", size=size, **_pose(middle))
    for index, (body, point) in enumerate(robot.contacts):
        name, pos = f"point_{index}", _text(*point)
        SubElement(elements[body], "geom", name=name, type="sphere", size=_text(POINT_RADIUS), pos=pos)
    for index, (body, element) in enumerate(zip(robot.tree.bodies, elements)):
        for shape in body.shapes if index not in soled else []:
            SubElement(element, "geom", type=shape.kind, size=_text(*shape.size), **_pose(shape.pose))


def _legs(robot: Robot, root: Element, elements: list[Element], time_constant: float) -> None:
    """Lets the shapes of bodies collide that must not pass through each other. A soled body has its shapes for this alone;
    without any it has its sole."""
    names: dict[int, list[str]] = {}
    for body in sorted({body for pair in robot.overlaps for body in pair}):
        element, soles = elements[body], [f"sole_{foot.name}" for foot in robot.feet if foot.body == body]
        for shape in robot.tree.bodies[body].shapes if soles else []:
            size = _text(*shape.size)
            SubElement(element, "geom", type=shape.kind, size=size, conaffinity="0", group="3", **_pose(shape.pose))
        shapes = [geom for geom in element.findall("geom") if "name" not in geom.attrib]
        for k, geom in enumerate(shapes):
            geom.attrib["name"] = f"shape_{element.attrib['name']}_{k}"
        names[body] = [geom.attrib["name"] for geom in shapes] or soles
    contact = SubElement(root, "contact")
    for one, other in robot.overlaps:
        for first in names[one]:
            for second in names[other]:
                pair = SubElement(contact, "pair", geom1=first, geom2=second, condim="3")
                pair.attrib |= {"friction": _text(*LEG_FRICTION), "solref": _text(time_constant, 1.0)}


def _couplings(robot: Robot, root: Element) -> None:
    equality = SubElement(root, "equality")
    for joint in robot.tree.joints:
        if joint.mimic is not None:
            leader, ratio, offset = joint.mimic
            SubElement(equality, "joint", joint1=joint.name, joint2=leader, polycoef=_text(offset, ratio, 0, 0, 0))


def _motors(robot: Robot, root: Element) -> None:
    actuator = SubElement(root, "actuator")
    for joint, model in zip(robot.tree.joints, robot.joints):
        if model.motor is not None:
            motor = model.motor
            entry = SubElement(actuator, "position", name=joint.name, joint=joint.name)
            entry.attrib |= {"kp": _text(motor.kp), "kv": _text(motor.kd)}
            if math.isfinite(motor.torque_limit):
                entry.attrib["forcerange"] = _text(-motor.torque_limit, motor.torque_limit)


def _keyframe(robot: Robot, root: Element) -> None:
    nominal = robot.nominal()
    targets = [q for q, model in zip(nominal, robot.joints) if model.motor is not None]
    pose = robot.base_pose()
    base = [*pose.translation, *_quaternion(pose)] if robot.floating else []
    SubElement(SubElement(root, "keyframe"), "key", name="nominal", qpos=_text(*base, *nominal), ctrl=_text(*targets))


def _pose(pose: Pose) -> dict[str, str]:
    return {"pos": _text(*pose.translation), "quat": _text(*_quaternion(pose))}


def _quaternion(pose: Pose) -> np.ndarray:
    """w, x, y, z, as MuJoCo writes it."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, pose.rotation.flatten())
    return quaternion


def _text(*numbers: float) -> str:
    """Numbers as text that reads back to the same bits."""
    return " ".join(repr(float(number)) for number in numbers)
