"""Accelerations of the engines against MuJoCo's equation of motion.

With `qvel = G v` for the mimic couplings, the engines must satisfy `G'MG a + G'c = f` with MuJoCo's mass matrix M
(armature included) and bias force c, for the generalised force f of joint torques and a push at the base. Every
component of the residual is compared with the sum of the magnitudes of its terms. As torque, push, velocities and
pose of the 64 states are random, wrong entries of M or c cannot cancel.
"""

import mujoco
import numpy as np
import pytest
from subjects import ROBOTS, Subject, dump, subject

pytestmark = pytest.mark.parametrize("robot", [subject(folder) for folder in ROBOTS], ids=ROBOTS)


def residuals(robot: Subject, engine: str, dt: float) -> np.ndarray:
    """Relative residual of the equation of motion, a row for each state."""
    reference = dump(robot.folder, engine, dt)
    free = [joint.name for joint in robot.robot.tree.joints if joint.mimic is None]
    order = [reference.dofs.index(name) for name in free]
    rows = []
    for state in reference.states:
        data, coupling = robot.data(state, reference.dofs, reference.gravity)
        mass = np.empty((robot.model.nv, robot.model.nv))
        mujoco.mj_fullM(robot.model, data, mass)
        mass = coupling.T @ mass @ coupling
        bias = coupling.T @ data.qfrc_bias
        floating = robot.robot.floating
        twist = [*state.base_linear_acceleration, *state.base_angular_acceleration] if floating else []
        acceleration = np.array([*twist, *np.array(state.accelerations)[order]])
        base_force = [*state.push, 0, 0, 0] if floating else []
        force = np.array([*base_force, *np.array(state.torques)[order]])
        scale = np.abs(mass) @ np.abs(acceleration) + np.abs(bias) + np.abs(force)
        rows.append(np.abs(mass @ acceleration + bias - force) / scale)
    return np.array(rows)


def test_lanes_in_f64_obey_mujocos_equation_of_motion(robot: Subject) -> None:
    # A velocity of some rad/s is known to 1e-15, so its change over 1 ms to 1e-12 of an acceleration of one.
    assert residuals(robot, "scalar", 0.001).max() < 1e-10


def test_lanes_in_f32_obey_mujocos_equation_of_motion(robot: Subject) -> None:
    # A velocity of some rad/s is known to 3e-7, so its change over 5 ms to 6e-5 of an acceleration of one.
    assert residuals(robot, "f32x8", 0.005).max() < 1e-4
