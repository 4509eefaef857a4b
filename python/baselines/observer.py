"""What the policy sees and what becomes of its actions, in NumPy with MuJoCo's kinematics: the same definitions as those of
docs/policy-file.md, written for one robot in one process."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from omniwalk_reference.robot import Robot
from omniwalk_reference.walker import JOINTS, SIGNS

HEIGHT_SCALE, VELOCITY_SCALE, VELOCITY_TERM_MAX = 4e-3, 0.05, 8.0
"""Of the velocity estimate: how soles' corners are weighted (m, m/s, an exponent)."""

NEEDED = {
    "action": {"law": "offset_from_nominal", "torque_clamp": True},
    "clock": {"enabled": True, "symmetric": True},
    "observation": {"true_velocity": False},
    "task": {"end_on_overlap": True},
    "ground": {"kind": "plane"},
}
"""What is not written a second time for other values."""


class Layout:
    """Where the policy's joints are in a MuJoCo model, with what each can do; the mirror image of each."""

    def __init__(self, robot: Robot, model: mujoco.MjModel) -> None:
        names = [joint.name for joint in robot.tree.joints]
        self.joints = robot.policy
        models = [robot.joints[names.index(name)] for name in self.joints]
        joints = [model.joint(name) for name in self.joints]
        self.positions = np.array([joint.qposadr[0] for joint in joints])
        self.velocities = np.array([joint.dofadr[0] for joint in joints])
        self.motors = np.array([model.actuator(name).id for name in self.joints])
        self.nominal = np.array([joint.nominal for joint in models])
        self.lower, self.upper = np.array([joint.limits for joint in models]).T
        self.torque = np.array([joint.motor.torque_limit for joint in models])
        self.speed = np.array([joint.motor.speed_limit for joint in models])
        self.reach = self.torque / np.array([joint.motor.kp for joint in models])
        self._couple(robot, names)
        self._mirror(robot, model)

    def _couple(self, robot: Robot, names: list[str]) -> None:
        """All joints from the policy's: `ratios @ q + offsets`; other leaders stand at their nominal position."""
        self.ratios, self.offsets = np.zeros((len(names), len(self.joints))), np.array(robot.nominal())
        for row, joint in enumerate(robot.tree.joints):
            leader, ratio, offset = joint.mimic or (joint.name, 1.0, 0.0)
            if leader in self.joints:
                self.ratios[row, self.joints.index(leader)], self.offsets[row] = ratio, offset

    def _mirror(self, robot: Robot, model: mujoco.MjModel) -> None:
        """The joint that is each one's mirror image, and the sign between them: a reflection at the plane between left and right
        turns the axis (x, y, z) of a rotation into (-x, y, -z)."""
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        swapped = [_other_side(name) for name in self.joints]
        axes = np.array([data.xaxis[model.joint(name).id] for name in self.joints])
        self.partners = np.array([self.joints.index(name) for name in swapped])
        self.signs = np.sign((axes * (axes[self.partners] * [-1.0, 1.0, -1.0])).sum(axis=1))


def _other_side(name: str) -> str:
    return name.replace("left", "right", 1) if "left" in name else name.replace("right", "left", 1)


class Observer:
    """Observations and joint targets of one robot, step after step."""

    def __init__(self, config: dict, robot: Robot, model: mujoco.MjModel) -> None:
        self.config, self.model, self.layout = config, model, Layout(robot, model)
        for section, needed in NEEDED.items():
            others = {key: config[section][key] for key, value in needed.items() if config[section][key] != value}
            if others:
                raise ValueError(f"[{section}]: the environment in MuJoCo is written for {needed}, not for {others}")
        self.hz = float(config["engine"]["control_hz"])
        self.rate = np.array(config["command"]["rate"]) / self.hz
        self.frame_period = round(config["observation"]["inertial_frame_period"] * self.hz)
        self.scale, self.gain = config["action"]["scale"], config["action"]["filter"]["gain"]
        self.tick = np.float32(1.0) / (np.float32(self.hz) * np.float32(config["clock"]["period"]))
        # The robot as its sensors have it, with the base at the origin.
        self.data = mujoco.MjData(model)
        self.first_joint = 7 if robot.floating else 0
        self.feet = np.array([model.body(robot.tree.bodies[foot.body].name).id for foot in robot.feet])
        self.corners = np.array([foot.corners() for foot in robot.feet])
        self.blocks, joints = [*config["observation"]["blocks"], "clock"], self.layout
        self.parts = [joints.signs if name in JOINTS else np.array(SIGNS[name], float) for name in self.blocks]
        starts = np.cumsum([0, *map(len, self.parts)])
        places = [joints.partners if name in JOINTS else np.arange(len(part)) for name, part in zip(self.blocks, self.parts)]
        self.mirror_signs = np.concatenate(self.parts)
        self.mirror_places = np.concatenate([start + place for start, place in zip(starts, places)])
        self.width, self.actions = len(self.mirror_signs), len(joints.joints)
        self.reset(0.0)

    def reset(self, phase: float) -> None:
        """Starts an episode with the clock at `phase`."""
        self.phase, self.commanded = np.float32(phase), np.zeros(3)
        self.previous_target, self.filtered = self.layout.nominal.copy(), None
        self.velocity, self.tracking_error = np.zeros(3), np.zeros(3)
        self.heading, self.turning, self.age = 0.0, 0.0, -1

    @property
    def frame_was_set(self) -> bool:
        """Whether the inertial frame was set to the heading in the last observation."""
        return self.age == 0

    @property
    def mirrored(self) -> bool:
        """Whether the policy looks into a mirror: in the second half of a cycle."""
        return self.phase >= 0.5

    def observe(self, readings: tuple, desired: np.ndarray) -> np.ndarray:
        """The observation for readings: positions, velocities (in the policy's order), fused roll and pitch, gyro."""
        positions, velocities, attitude, gyro = readings
        self.measured = positions
        up = _up(*attitude)
        self._turn(gyro[2] + (gyro[0] * up[0] + gyro[1] * up[1]) / (1.0 + up[2]))
        self.velocity = self._estimate(positions, velocities, up, gyro)
        self.commanded = self.commanded + np.minimum(np.maximum(desired - self.commanded, -self.rate), self.rate)
        level = self._level(up)
        error = self.commanded - np.array([level[0], level[1], self.turning])
        self.tracking_error = self.tracking_error + (error - self.tracking_error) / max(self.hz, 1.0)
        angle = 2.0 * math.pi * float(self.phase)
        found = {
            "joint_position": positions,
            "joint_velocity": velocities,
            "attitude": attitude,
            "gyro": gyro,
            "velocity_inertial": self._inertial(level),
            "velocity_base": self.velocity,
            "desired_velocity": desired,
            "commanded_velocity": self.commanded,
            "previous_target": self.previous_target - self.layout.nominal,
            "tracking_error": self.tracking_error,
            "clock": (math.sin(angle), math.cos(angle)),
        }
        row = np.concatenate([found[name] for name in self.blocks])
        if self.mirrored:
            row = self.mirror_signs * row[self.mirror_places]
        return row.astype(np.float32)

    def _turn(self, rate: float) -> None:
        """Integrates the heading in the inertial frame, which is set to the robot's every so often."""
        self.age += 1
        if self.age == 0 or self.age >= self.frame_period:
            self.heading, self.age = 0.0, 0
        else:
            self.heading += 0.5 * (self.turning + rate) / self.hz
        self.turning = rate

    def _level(self, up: np.ndarray) -> np.ndarray:
        """The velocity, levelled by the rotation without yaw that takes `up` upright."""
        x, y, z = self.velocity
        a, b, c = up
        # The shortest rotation that takes (a, b, c) to (0, 0, 1).
        k = 1.0 / (1.0 + c)
        level_x = (1.0 - a * a * k) * x - a * b * k * y - a * z
        level_y = -a * b * k * x + (1.0 - b * b * k) * y - b * z
        return np.array([level_x, level_y, a * x + b * y + c * z])

    def _inertial(self, level: np.ndarray) -> np.ndarray:
        """A level velocity in the inertial frame."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return np.array([cos * level[0] - sin * level[1], sin * level[0] + cos * level[1], level[2]])

    def _estimate(self, positions, velocities, up: np.ndarray, gyro: np.ndarray) -> np.ndarray:
        """The base's velocity, as if the soles' corners stood still: those that are low and agree with the last estimate count."""
        model, data, layout, first = self.model, self.data, self.layout, self.first_joint
        data.qpos[first:] = layout.ratios @ positions + layout.offsets
        data.qvel[first - 1 :] = layout.ratios @ velocities
        if first:
            data.qpos[:7], data.qvel[:3], data.qvel[3:6] = (0, 0, 0, 1, 0, 0, 0), 0.0, gyro
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        rotations = data.xmat[self.feet].reshape(-1, 3, 3)
        levers = self.corners @ rotations.transpose(0, 2, 1)
        points = levers + data.xpos[self.feet][:, None]
        twists = data.cvel[self.feet]
        # `cvel` is the velocity of the point of the body that is at the centre of mass of the whole tree.
        arms = points - data.subtree_com[1]
        moving = -(twists[:, None, 3:] + _cross(twists[:, None, :3], arms)).reshape(-1, 3)
        heights = (points.reshape(-1, 3) @ up - (points @ up).min()) / HEIGHT_SCALE
        squares = ((moving - self.velocity) ** 2).sum(axis=1)
        energies = 0.5 * heights**2 + squares / (2.0 * VELOCITY_SCALE**2 + squares / VELOCITY_TERM_MAX)
        weights = np.exp(energies.min() - energies)
        return weights @ moving / weights.sum()

    def decode(self, action: np.ndarray) -> np.ndarray:
        """Joint targets of an action in [-1, 1]; the clock goes on."""
        layout = self.layout
        wanted = np.clip(action, -1.0, 1.0)
        if self.mirrored:
            wanted = layout.signs * wanted[layout.partners]
        self.filtered = wanted if self.filtered is None else self.filtered + self.gain * (wanted - self.filtered)
        target = layout.nominal + self.scale * self.filtered
        target = np.clip(target, self.measured - layout.reach, self.measured + layout.reach)
        self.previous_target = np.clip(target, layout.lower, layout.upper)
        phase = self.phase + self.tick
        self.phase = phase - np.floor(phase)
        return self.previous_target


def _up(roll: float, pitch: float) -> np.ndarray:
    """The unit vector against gravity in the base frame."""
    x, y = -math.sin(pitch), math.sin(roll)
    square = x * x + y * y
    if square > 1.0:
        return np.array([x, y, 0.0]) / [math.sqrt(square), math.sqrt(square), 1.0]
    return np.array([x, y, math.sqrt(1.0 - square)])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product along the last axis; `np.cross` takes several times as long."""
    out = np.empty_like(b)
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out
