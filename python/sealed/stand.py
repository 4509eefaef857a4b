"""Sealed worlds of machines on a stand: the one-joint rig and the hanging leg."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from .actuator import Actuator
from .effects import Case
from .logs import Log
from .drive import Drive, place, refuse_broken
from .machine import Machine, Servo, loose_mass
from .motions import Motion
from .sensors import Reader

STEP = 2.5e-4
"""Physics step, s."""

COMMAND_RATE = 100.0
"""Of targets on the wire, Hz."""


@dataclass
class Recorded:
    """One log and what only the truth may know of it."""

    log: Log
    floor: list[float]
    """Root mean square of reading less what was to be read, per joint, rad."""


def worn(servo: Servo, rng: np.random.Generator) -> Servo:
    """The servo as it is: its data sheet is off by up to a fifth in what is hard to know. No effect is missing for it."""
    keys = ("armature", "friction", "damping")
    return replace(servo, **{key: getattr(servo, key) * rng.uniform(0.8, 1.2) for key in keys})


class Stand:
    """A machine with the faults of a case."""

    def __init__(self, machine: Machine, case: Case, rng: np.random.Generator) -> None:
        self.case = case
        self.rng = rng
        self.names = [joint.name for joint in machine.joints]
        joints = [replace(joint, servo=worn(joint.servo, rng)) for joint in machine.joints]
        for effect in case.effects:
            if effect.name == "payload":
                joints = [_loaded(joint, effect.get("mass")) if joint.name == effect.joint else joint for joint in joints]
        self.machine = replace(machine, joints=joints)
        rotors, extras = {}, {}
        for joint in joints:
            effects = [effect for effect in case.effects if effect.joint == joint.name]
            if Actuator(joint.servo, effects, rng, 0.0).two_bodies:
                rotors[joint.name] = joint.servo.armature
            extras[joint.link] = [_loose(joint, effect) for effect in effects if effect.name == "loose_mass"]
        self.model = mujoco.MjModel.from_xml_string(self.machine.mjcf(STEP, rotors, extras))
        self.places = [place(self.model, name) for name in self.names]
        self.links = np.array([at.position for at in self.places])
        self.rotors = {self.names.index(name): place(self.model, f"{name}_rotor") for name in rotors}

    def record(self, motions: list[Motion], start: list[float], duration: float, gain: float, off_from: float) -> Recorded:
        """Runs the motions (one per joint) from rest at `start`; `gain` multiplies kp, motors are off from `off_from` s on."""
        servos = [replace(joint.servo, kp=joint.servo.kp * gain) for joint in self.machine.joints]
        actuators = [self._actuator(i, servo, start[i]) for i, servo in enumerate(servos)]
        data = mujoco.MjData(self.model)
        data.qpos[self.links] = start
        for joint, rotor in self.rotors.items():
            data.qpos[rotor.position] = start[joint]
        log, reader = Log(self.names), Reader(self.rng)
        history: deque[np.ndarray] = deque(maxlen=int(0.05 / STEP))
        offsets = np.array([actuator.offset for actuator in actuators])
        ages = np.array([round(actuator.reading_age / STEP) for actuator in actuators])
        drives = [Drive(actuator, self.places[i], self.rotors.get(i)) for i, actuator in enumerate(actuators)]
        next_command, switched = 0.0, False
        if off_from < duration:
            log.enabled(0.0, True)
        for step in range(round(duration / STEP)):
            time = step * STEP
            position = data.qpos[self.links].copy()
            history.append(position + offsets)
            if time >= next_command:
                targets = [motion(time) for motion in motions]
                for actuator, target in zip(actuators, targets):
                    actuator.command(time, target)
                log.commands(time + float(self.rng.normal(0.0, 5e-5)), targets)
                next_command += 1.0 / COMMAND_RATE
            if time >= off_from and not switched:
                log.enabled(time, False)
                switched = True
            if reader.due(time):
                seen = [history[max(len(history) - 1 - age, 0)][i] for i, age in enumerate(ages)]
                reader.read(time, np.array(seen))
            for drive in drives:
                drive.act(data, time, time < off_from, STEP)
            mujoco.mj_step(self.model, data)
        refuse_broken(data, self.case)
        for time, position, velocity in zip(reader.times, reader.positions, reader.velocities):
            log.states(time, position, velocity)
        return Recorded(log, reader.floor())

    def _actuator(self, index: int, servo: Servo, start: float) -> Actuator:
        name = self.names[index]
        return Actuator(servo, [effect for effect in self.case.effects if effect.joint == name], self.rng, start)

    def typical(self, motion: float) -> list[float]:
        """Typical torque of each joint: the largest of gravity over poses within `motion` (rad), N m."""
        data = mujoco.MjData(self.model)
        draws = np.random.default_rng(0)
        largest = np.zeros(len(self.links))
        for _ in range(100):
            data.qpos[self.links] = draws.uniform(-motion, motion, len(self.links))
            mujoco.mj_forward(self.model, data)
            largest = np.maximum(largest, np.abs(data.qfrc_bias[self.links]))
        return [max(float(x), 4.0 * joint.servo.friction) for x, joint in zip(largest, self.machine.joints)]


def _loaded(joint, mass: float):
    """The joint's link with a point mass at its centre of mass."""
    return replace(joint, mass=joint.mass + mass)


def _loose(joint, effect):
    """The loose mass of a faulty link, at the link's centre of mass."""
    mass = effect.get("mass") * joint.mass
    return loose_mass(joint.link, joint.com, joint.axis, mass, effect.get("play"))
