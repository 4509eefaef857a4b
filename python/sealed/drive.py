"""Puts the torques of a joint's servo and friction into a MuJoCo world."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from .actuator import Actuator


BROKEN = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


def refuse_broken(data: mujoco.MjData, world: object) -> None:
    """MuJoCo starts again without a word where a simulation came apart; no log may hold that."""
    if any(data.warning[which].number for which in BROKEN):
        raise FloatingPointError(f"the simulation of {world} broke")


@dataclass
class Place:
    """Where a hinge is in MuJoCo's state: its place among positions and among velocities."""

    position: int
    velocity: int


def place(model: mujoco.MjModel, joint: str) -> Place:
    found = model.joint(joint)
    return Place(int(found.qposadr[0]), int(found.dofadr[0]))


@dataclass
class Drive:
    """One joint, whose rotor is a body of its own if it has a place."""

    actuator: Actuator
    link: Place
    rotor: Place | None
    transmitted: float = 0.0
    """What passed the gear in the last step, N m."""

    def act(self, data: mujoco.MjData, time: float, on: bool, step: float) -> None:
        """Sets what acts on the joint for a step of `step` s from `time` on."""
        actuator, link, rotor = self.actuator, self.link, self.rotor
        position, velocity = float(data.qpos[link.position]), float(data.qvel[link.velocity])
        torque = actuator.motor(time, position + actuator.offset, velocity, on, step)
        if rotor is None:
            # What passes the gear: the motor's torque less what turns the rotor.
            self.transmitted = torque - actuator.servo.armature * float(data.qacc[link.velocity])
            passed = torque
        else:
            turned, speed = float(data.qpos[rotor.position]), float(data.qvel[rotor.velocity])
            passed = self.transmitted = actuator.coupling(turned - position, speed - velocity)
            friction = actuator.rotor_bristle.torque(speed, 0.2 * actuator.servo.friction, step)
            data.qfrc_applied[rotor.velocity] = torque - passed - friction
        taken = actuator.friction(velocity, self.transmitted, time, step)
        data.qfrc_applied[link.velocity] = passed - taken + actuator.outside(position)
