"""Machines: links, joints and servos, written as URDF and robot.toml for the one side and as MJCF for the other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from .effects import RIG_MOTION

Vector = tuple[float, float, float]


@dataclass
class Servo:
    """A position servo and the passive joint behind it, SI units."""

    kp: float
    kd: float
    torque_limit: float
    speed_limit: float
    armature: float
    friction: float
    damping: float


@dataclass
class Joint:
    """A hinge and the link it carries. Mass properties are in the link's frame, which is the joint's at zero."""

    name: str
    parent: str
    link: str
    origin: Vector
    axis: Vector
    limits: tuple[float, float]
    servo: Servo
    mass: float
    com: Vector
    inertia: Vector
    """Principal moments about the centre of mass, along the link's axes, kg m^2."""


@dataclass
class Machine:
    """A tree of hinges on a fixed stand."""

    name: str
    joints: list[Joint]
    height: float = 1.5
    """Of the stand above the ground, m: nothing touches it."""
    motions: float = 1.0
    """Largest amplitude of commanded motion, rad."""

    def joint(self, name: str) -> Joint:
        return next(joint for joint in self.joints if joint.name == name)

    def write(self, folder: Path) -> None:
        """Writes the robot folder that identification gets: what the maker of the machine knows."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{self.name}.urdf").write_text(self.urdf())
        (folder / "robot.toml").write_text(self.toml())

    def urdf(self) -> str:
        root = Element("robot", name=self.name)
        SubElement(root, "link", name="world")
        SubElement(root, "link", name="stand")
        fixed = SubElement(root, "joint", name="stand_joint", type="fixed")
        SubElement(fixed, "parent", link="world")
        SubElement(fixed, "child", link="stand")
        SubElement(fixed, "origin", xyz=text(0, 0, self.height))
        for joint in self.joints:
            element = SubElement(root, "joint", name=joint.name, type="revolute")
            SubElement(element, "parent", link=joint.parent)
            SubElement(element, "child", link=joint.link)
            SubElement(element, "origin", xyz=text(*joint.origin))
            SubElement(element, "axis", xyz=text(*joint.axis))
            limit = {"effort": text(joint.servo.torque_limit), "velocity": text(joint.servo.speed_limit)}
            SubElement(element, "limit", lower=text(joint.limits[0]), upper=text(joint.limits[1]), **limit)
            inertial = SubElement(SubElement(root, "link", name=joint.link), "inertial")
            SubElement(inertial, "origin", xyz=text(*joint.com))
            SubElement(inertial, "mass", value=text(joint.mass))
            ixx, iyy, izz = (text(moment) for moment in joint.inertia)
            SubElement(inertial, "inertia", ixx=ixx, iyy=iyy, izz=izz, ixy="0", ixz="0", iyz="0")
        indent(root)
        return tostring(root, encoding="unicode") + "\n"

    def toml(self) -> str:
        lines = ['base = "fixed"']
        for joint in self.joints:
            servo = joint.servo
            lines += ["", "[[joint]]", f'match = ["{joint.name}"]']
            lines += [f"{key} = {value!r}" for key, value in vars(servo).items()]
        return "\n".join(lines) + "\n"

    def mjcf(self, step: float, rotors: dict[str, float], extras: dict[str, list[Element]]) -> str:
        """The machine with other integration than 1 kHz semi-implicit: fourth-order Runge-Kutta, but for rotors on springs, into
        which that would feed energy, as torques are held over a step.

        `rotors` gives the inertia of joints whose rotor is a body of its own; `extras` adds elements to links.
        Torques come from outside, step by step.
        """
        root = Element("mujoco", model=self.name)
        integrator = "implicitfast" if rotors else "RK4"
        SubElement(root, "compiler", angle="radian", autolimits="true")
        SubElement(root, "option", timestep=text(step), integrator=integrator, cone="pyramidal", density="0")
        world = SubElement(root, "worldbody")
        bodies = {"stand": SubElement(world, "body", name="stand", pos=text(0, 0, self.height))}
        for joint in self.joints:
            parent = bodies[joint.parent]
            body = SubElement(parent, "body", name=joint.link, pos=text(*joint.origin))
            own = joint.name in rotors
            armature = 0.0 if own else joint.servo.armature
            attributes = {"type": "hinge", "axis": text(*joint.axis), "armature": text(armature)}
            SubElement(body, "joint", name=joint.name, range=text(*joint.limits), **attributes)
            inertial = {"pos": text(*joint.com), "mass": text(joint.mass), "diaginertia": text(*joint.inertia)}
            SubElement(body, "inertial", **inertial)
            body.extend(extras.get(joint.link, []))
            if own:
                rotor(parent, joint.name, joint.origin, joint.axis, rotors[joint.name])
            bodies[joint.link] = body
        indent(root)
        return tostring(root, encoding="unicode") + "\n"


def text(*numbers: float) -> str:
    return " ".join(f"{number:.10g}" for number in numbers)


def rotor(parent: Element, joint: str, origin: Vector, axis: Vector, inertia: float) -> Element:
    """A rotor that turns beside the link of `joint`, on the body that carries both. Its `inertia` is that behind a gear, of the ratio's square:
    what carries the rotor feels it by the ratio alone, next to nothing. A body of that inertia would load it too."""
    body = SubElement(parent, "body", name=f"{joint}_rotor", pos=text(*origin))
    SubElement(body, "joint", name=f"{joint}_rotor", type="hinge", axis=text(*axis), armature=text(inertia))
    SubElement(body, "inertial", pos="0 0 0", mass="1e-6", diaginertia="1e-9 1e-9 1e-9")
    return body


def loose_mass(link: str, centre: Vector, axis: Vector, mass: float, play: float) -> Element:
    """A mass at `centre` that slides in a link, along the way it moves about the joint's `axis`, between two stops."""
    across = (1, 0, 0) if axis[1] else (0, 1, 0)
    body = Element("body", name=f"{link}_loose", pos=text(*centre))
    slide = {"type": "slide", "axis": text(*across), "range": text(-play, play), "damping": "0.5"}
    SubElement(body, "joint", name=f"{link}_loose", **slide)
    SubElement(body, "inertial", pos="0 0 0", mass=text(mass), diaginertia=text(*[1e-5] * 3))
    return body


def rig(draw) -> Machine:
    """A bob on an arm on one servo: `draw(low, high)` gives the sizes."""
    mass, length = draw(0.35, 0.6), draw(0.10, 0.15)
    servo = Servo(
        kp=draw(5.0, 9.0),
        kd=draw(0.12, 0.2),
        torque_limit=2.2,
        speed_limit=draw(6.0, 8.0),
        armature=draw(0.002, 0.004),
        friction=draw(0.05, 0.09),
        damping=draw(0.01, 0.03),
    )
    bob = (2e-4, 2e-4, 2e-4)
    hinge = Joint("hinge", "stand", "arm", (0, 0, 0), (0, 1, 0), (-2.8, 2.8), servo, mass, (0, 0, -length), bob)
    return Machine("rig", [hinge], motions=RIG_MOTION)


def leg(draw) -> Machine:
    """A leg that hangs from a stand: hip roll, hip pitch, knee, ankle."""
    thigh, shank = draw(0.22, 0.28), draw(0.22, 0.28)

    def servo(strength: float) -> Servo:
        return Servo(
            kp=60.0 * strength,
            kd=1.2 * strength,
            torque_limit=16.0 * strength,
            speed_limit=6.0,
            armature=0.012 * strength,
            friction=0.35 * strength,
            damping=0.1 * strength,
        )

    joints = [
        Joint("hip_roll", "stand", "hip", (0, 0, 0), (1, 0, 0), (-0.8, 0.8), servo(1.2), 0.6, (0, 0, -0.02), (1e-3,) * 3),
        Joint(
            *("hip_pitch", "hip", "thigh", (0, 0, -0.04), (0, 1, 0), (-1.6, 1.6), servo(1.2)),
            *(draw(1.4, 1.8), (0, 0, -thigh / 2), (0.009, 0.009, 0.002)),
        ),
        Joint(
            *("knee", "thigh", "shank", (0, 0, -thigh), (0, 1, 0), (-0.1, 2.2), servo(1.0)),
            *(draw(0.9, 1.2), (0, 0, -shank / 2), (0.006, 0.006, 0.001)),
        ),
        Joint(
            *("ankle", "shank", "foot", (0, 0, -shank), (0, 1, 0), (-1.0, 1.0), servo(0.7)),
            *(draw(0.4, 0.6), (0.04, 0, -0.04), (0.0008, 0.002, 0.002)),
        ),
    ]
    return Machine("leg", joints, motions=0.5)
