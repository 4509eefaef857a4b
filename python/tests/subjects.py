"""The robots of the project in MuJoCo, and what the Rust side says of them."""

import json
import os
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from omniwalk_reference import dynamics, mjcf
from omniwalk_reference.robot import Robot, load
from programs import ROOT, program

ROBOTS = ["robots/nimbro_op2x", "robots/pendulum", "python/tests/robots/awkward"]
"""Folders: a humanoid with couplings, a rig with a fixed base, and a collection of everything that is difficult."""

STATES = 500

PUBLISHED = {
    "igus_op/igus_op.urdf": {
        "feet": ["left_foot_link", "right_foot_plane_link"],
        "others": ["camera_optical", "left_lower_arm_link", "right_shank_link"],
    },
    "booster_t1/T1_locomotion.urdf": {
        "feet": ["left_foot_link", "right_foot_link"],
        "others": ["left_hand_link", "Hip_Yaw_Left", "Shank_Right"],
    },
    "unitree_g1/g1_12dof.urdf": {
        "feet": ["left_ankle_roll_link", "right_ankle_roll_link"],
        "others": ["left_wrist_roll_rubber_hand", "left_hip_roll_link", "right_knee_link"],
    },
}
"""Robots as their makers publish them, in the folder `robots/urdf` of what `OMNIWALK_SHARED` points to, each with its feet and other
links that touch the ground here; some of them are fixed to the body that moves."""

FOOT = """
[[foot]]
link = "{link}"
sole = [0.03, -0.01, -0.04]
rpy = [0.1, -0.2, 0.3]
size = [0.2, 0.1]
"""
"""Where on its link a sole is does not matter to the equations, so it is nowhere special."""

CONTACT = """
[[contact]]
link = "{link}"
points = [[0.05, -0.02, 0.03], [-0.04, 0.03, -0.06]]
"""


@cache
def dump(robot: str, engine: str, dt: float, *ground: str) -> SimpleNamespace:
    """The output of the example `dynamics_dump` for a robot of the project: link properties and random states, in free
    flight or on the `ground`."""
    arguments = [robot, engine, "1", str(STATES), str(dt), *ground]
    result = subprocess.run(program("dynamics_dump") + arguments, cwd=ROOT, capture_output=True, text=True)
    if "no instructions" in result.stderr:
        pytest.skip(result.stderr.strip())
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout, object_hook=lambda entries: SimpleNamespace(**entries))


@cache
def published(urdf: str) -> str:
    """A folder with the published robot and a TOML that lets it float and touch the ground, which a URDF cannot say; skips where it
    is not at hand."""
    if "OMNIWALK_SHARED" not in os.environ:
        pytest.skip("OMNIWALK_SHARED is not set: no published robots")
    source = Path(os.environ["OMNIWALK_SHARED"]) / "robots/urdf" / urdf
    folder = Path(tempfile.mkdtemp(prefix="published-"))
    (folder / source.name).write_text(source.read_text())
    tables = [FOOT.format(link=link) for link in PUBLISHED[urdf]["feet"]]
    tables += [CONTACT.format(link=link) for link in PUBLISHED[urdf]["others"]]
    (folder / "robot.toml").write_text('base = "floating"\n' + "".join(tables))
    return str(folder)


@dataclass
class Subject:
    """A robot as Python reads it, and in MuJoCo."""

    folder: str
    robot: Robot
    model: mujoco.MjModel

    def coupling(self, rotation: np.ndarray) -> np.ndarray:
        """G of `qvel = G v`, see [`dynamics.coupling`]."""
        free = [joint.name for joint in self.robot.tree.joints if joint.mimic is None]
        return dynamics.coupling(self.robot, rotation, free)

    def data(self, state: SimpleNamespace, dofs: list[str], gravity: list[float]) -> tuple[mujoco.MjData, np.ndarray]:
        """MuJoCo in a state of the Rust side, all quantities computed, and the state's coupling matrix."""
        data = mujoco.MjData(self.model)
        self.model.opt.gravity[:] = gravity
        positions = self.robot.tree.positions(dict(zip(dofs, state.positions)))
        free = [joint.name for joint in self.robot.tree.joints if joint.mimic is None]
        velocities = [state.velocities[dofs.index(name)] for name in free]
        rotation = matrix(state.base.orientation)
        base = [*state.base.position, *state.base.orientation] if self.robot.floating else []
        data.qpos[:] = [*base, *positions]
        twist = [*state.base_linear_velocity, *state.base_angular_velocity] if self.robot.floating else []
        coupling = self.coupling(rotation)
        data.qvel[:] = coupling @ [*twist, *velocities]
        mujoco.mj_forward(self.model, data)
        return data, coupling


def matrix(quaternion: list[float]) -> np.ndarray:
    """Rotation matrix of a quaternion w, x, y, z."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.array(quaternion, float))
    return rotation.reshape(3, 3)


@cache
def subject(folder: str, physics_hz: float = 1000.0) -> Subject:
    """A robot of the project, compiled in MuJoCo."""
    robot = load(ROOT / folder)
    return Subject(folder, robot, mujoco.MjModel.from_xml_string(mjcf.write(robot, physics_hz)))
