"""A humanoid from its maker's folder, as MuJoCo simulates the faulty one.

The readings of the folder and the tree of bodies are those of `omniwalk_reference`, which shares nothing with omniwalk. The rest
is another world than the one that identification has:

- Step: implicitfast at 4 kHz. Torques of servos and friction come from outside and hold for a step; fourth-order Runge-Kutta, which
  the stands have, would let stiff springs of play and bristles gain energy from that, semi-implicit steps do not.
- Contact is MuJoCo's own soft one (time constant 20 ms) with pyramidal cones. Its friction is one that training drew: a policy
  that leans on torsional friction turns by 0.2 to 0.45 rad/s too much or too little where only the corners of the soles resist it.
- Couplings (the parallelograms of hip and knee) are constraints with a time constant of half a millisecond: a joint that
  follows has no servo, friction or encoder, and effects sit at its leader.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import mujoco

from omniwalk_reference import mjcf, robot

from .effects import Effect
from .machine import Servo, loose_mass, rotor, text

STEP = 2.5e-4
"""Physics step, s."""

OUTPUT = 0.1
"""Share of a gear's inertia on the joint's side of play or a spring: what is there beside, the plate of a parallelogram or
a foot, weighs next to nothing."""

FRICTION = (0.7, 0.1)
"""Of soles on the ground, tangential and torsional (m); training had 0.4 to 0.8 and 0.1 to 0.3, identification has 1 and 0.01."""


@dataclass
class Humanoid:
    """What the maker knows: the robot, and the servos of the joints that have one."""

    robot: robot.Robot
    servos: dict[str, Servo]

    @property
    def names(self) -> list[str]:
        return list(self.servos)

    def nominal(self, name: str) -> float:
        """Position of a joint in the nominal pose, rad."""
        return next(model.nominal for joint, model in zip(self.robot.tree.joints, self.robot.joints) if joint.name == name)

    def carriers(self) -> list[str]:
        """Joints with a servo between trunk and soles."""
        tree, on_the_way = self.robot.tree, set()
        for foot in self.robot.feet:
            body = foot.body
            while body:
                on_the_way.add(tree.joints[body - 1].name)
                body = tree.bodies[body].parent
        return [name for name in self.names if name in on_the_way]

    def carried(self, name: str) -> float:
        """Mass of everything that hangs on a joint, kg."""
        tree = self.robot.tree
        first = self._body(name)
        inside = {first}
        for index, body in enumerate(tree.bodies):
            if body.parent in inside:
                inside.add(index)
        return sum(tree.bodies[index].mass for index in inside)

    def _body(self, name: str) -> int:
        return 1 + [joint.name for joint in self.robot.tree.joints].index(name)

    def model(self, servos: dict[str, Servo], effects: list[Effect], rotors: list[str], step: float) -> mujoco.MjModel:
        """The machine with its true `servos`, simulated in steps of `step` s; the joints in `rotors` have a rotor of their own."""
        root = fromstring(mjcf.write(self.robot, 1.0 / step, legs=True))
        _world(root)
        bodies = {body.attrib["name"]: body for body in root.iter("body")}
        parents = {child: parent for parent in root.iter() for child in parent}
        names = [body.name for body in self.robot.tree.bodies]
        for name, servo in servos.items():
            body = bodies[names[self._body(name)]]
            self._inertia(name, servo, body, parents[body] if name in rotors else None)
        for effect in effects:
            self._hang(effect, bodies[names[self._body(effect.joint)]])
        model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
        # A world that broke must not begin anew by itself.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        return model

    def _inertia(self, name: str, servo: Servo, body: Element, beside: Element | None) -> None:
        """The gear's inertia at a joint: all of it on its `body`, or most of it on a rotor `beside`. Friction is the actuator's."""
        hinge = next(entry for entry in body.findall("joint") if entry.attrib["name"] == name)
        own = servo.armature if beside is None else OUTPUT * servo.armature
        hinge.attrib |= {"armature": text(own), "damping": "0", "frictionloss": "0"}
        if beside is not None:
            joint = self.robot.tree.joints[self._body(name) - 1]
            turning = rotor(beside, name, tuple(joint.origin.translation), tuple(joint.axis), servo.armature - own)
            turning.attrib["quat"] = body.attrib["quat"]

    def _hang(self, effect: Effect, body: Element) -> None:
        """Adds masses that nobody knows of, kg, at the link's centre of mass."""
        index = self._body(effect.joint)
        link, axis = self.robot.tree.bodies[index], self.robot.tree.joints[index - 1].axis
        if effect.name == "payload":
            inertial = body.find("inertial")
            inertial.attrib["mass"] = text(link.mass + effect.get("mass"))
        if effect.name == "loose_mass":
            body.append(loose_mass(link.name, tuple(link.com), tuple(axis), effect.get("mass"), effect.get("play")))

    def place(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Stands the robot in its nominal pose."""
        pose = self.robot.base_pose()
        data.qpos[:3] = pose.translation
        mujoco.mju_mat2Quat(data.qpos[3:7], pose.rotation.flatten())
        entries = [model.joint(number) for number in range(model.njnt)]
        addresses = {entry.name: entry.qposadr[0] for entry in entries}
        for joint, position in zip(self.robot.tree.joints, self.robot.nominal()):
            for name in (joint.name, f"{joint.name}_rotor"):
                if name in addresses:
                    data.qpos[addresses[name]] = position


def read(folder: Path) -> Humanoid:
    """Reads a robot folder."""
    described = robot.load(folder)
    servos = {}
    for joint, model in zip(described.tree.joints, described.joints):
        if model.motor is not None:
            motor = model.motor
            drive = (motor.kp, motor.kd, motor.torque_limit, motor.speed_limit)
            servos[joint.name] = Servo(*drive, model.armature, model.friction, model.damping)
    return Humanoid(described, servos)


def _world(root: Element) -> None:
    """Another integrator and another ground than the reference's, no motors, an accelerometer in the trunk."""
    root.find("option").attrib["cone"] = "pyramidal"
    # Without a time constant of its own a geom has MuJoCo's.
    del root.find("default").find("geom").attrib["solref"]
    floor = next(geom for geom in root.iter("geom") if geom.attrib.get("name") == "floor")
    floor.attrib |= {"condim": "4", "friction": text(*FRICTION, 0.0)}
    for name in ("actuator", "keyframe"):
        root.remove(root.find(name))
    trunk = root.find("worldbody").find("body")
    SubElement(trunk, "site", name="imu")
    SubElement(SubElement(root, "sensor"), "accelerometer", site="imu")
