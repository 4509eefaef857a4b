"""Accelerations of the engines against MuJoCo's equation of motion.

With `qvel = G v` for the mimic couplings, the engines must satisfy `G'MG a + G'c = f` with MuJoCo's mass matrix M
(armature included) and bias force c, for the generalised force f of joint torques and a push at the base. Every
component of the residual is compared with the sum of the magnitudes of its terms. As torque, push, velocities and
pose of the 500 states are random, wrong entries of M or c cannot cancel.
"""

import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from subjects import PUBLISHED, ROBOTS, ROOT, STATES, Subject, dump, published, subject

STEPPING = [ROBOTS[0], ROBOTS[2]]
"""Those of the project with contact points."""

ALL = pytest.mark.parametrize("robot", [subject(folder) for folder in ROBOTS], ids=ROBOTS)


def order(robot: Subject, dofs: list[str]) -> list[int]:
    """Where the degrees of freedom of `robot` are among `dofs`."""
    return [dofs.index(joint.name) for joint in robot.robot.tree.joints if joint.mimic is None]


def accelerations(robot: Subject, engine: str, dt: float, *ground: str) -> np.ndarray:
    """Generalised accelerations that the engine finds, a row for each state."""
    reference = dump(robot.folder, engine, dt, *ground)
    free = order(robot, reference.dofs)
    floating = robot.robot.floating
    rows = []
    for state in reference.states:
        twist = [*state.base_linear_acceleration, *state.base_angular_acceleration] if floating else []
        rows.append([*twist, *np.array(state.accelerations)[free]])
    return np.array(rows)


def residuals(robot: Subject, rows: np.ndarray) -> np.ndarray:
    """Relative residual of the equation of motion, a row for each state."""
    reference = dump(robot.folder, "scalar", 0.001)
    results = []
    for state, acceleration in zip(reference.states, rows):
        missing, scale, _ = missing_force(robot, reference, state, acceleration)
        results.append(np.abs(missing) / scale)
    return np.array(results)


def missing_force(
    robot: Subject, reference: SimpleNamespace, state: SimpleNamespace, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[mujoco.MjData, np.ndarray]]:
    """What the acceleration needs beyond torques and push, the sums of the magnitudes of its terms, and MuJoCo's data
    and the couplings in this state."""
    free = order(robot, reference.dofs)
    data, coupling = robot.data(state, reference.dofs, reference.gravity)
    mass = np.empty((robot.model.nv, robot.model.nv))
    mujoco.mj_fullM(robot.model, data, mass)
    mass = coupling.T @ mass @ coupling
    bias = coupling.T @ data.qfrc_bias
    base_force = [*state.push, 0, 0, 0] if robot.robot.floating else []
    force = np.array([*base_force, *np.array(state.torques)[free]])
    scale = np.abs(mass) @ np.abs(acceleration) + np.abs(bias) + np.abs(force)
    return mass @ acceleration + bias - force, scale, (data, coupling)


@ALL
def test_lanes_in_f64_obey_mujocos_equation_of_motion(robot: Subject) -> None:
    # A velocity of some rad/s is known to 1e-15, so its change over 1 ms to 1e-12 of an acceleration of one.
    assert residuals(robot, accelerations(robot, "scalar", 0.001)).max() < 1e-10


@ALL
def test_lanes_in_f32_obey_mujocos_equation_of_motion(robot: Subject) -> None:
    # A velocity of some rad/s is known to 3e-7, so its change over 5 ms to 6e-5 of an acceleration of one.
    assert residuals(robot, accelerations(robot, "f32x8", 0.005)).max() < 1e-4


@pytest.mark.parametrize("urdf", PUBLISHED)
def test_lanes_obey_mujocos_equation_of_motion_for_published_robots(urdf: str) -> None:
    robot = subject(published(urdf))
    assert residuals(robot, accelerations(robot, "scalar", 0.001)).max() < 1e-10
    assert residuals(robot, accelerations(robot, "f32x8", 0.005)).max() < 1e-4


@pytest.mark.parametrize("name", [*STEPPING, *PUBLISHED])
@pytest.mark.parametrize("engine, dt, bound", [("scalar", 0.001, 1e-10), ("f32x8", 0.005, 1e-4)])
def test_ground_forces_of_lanes_act_through_mujocos_contact_jacobians(
    name: str, engine: str, dt: float, bound: float
) -> None:
    """What moves a robot beyond torques and push is a wrench on each link that touches, through MuJoCo's Jacobian of the
    link; a foot's force is the one the engine reports. Bounds as in free flight."""
    robot = subject(published(name) if name in PUBLISHED else name)
    reference = dump(robot.folder, engine, dt, "ground")
    rows = accelerations(robot, engine, dt, "ground")
    touched = 0
    for state, acceleration in zip(reference.states, rows):
        missing, scale, (data, coupling) = missing_force(robot, reference, state, acceleration)
        touched += np.abs(missing / scale).max() > 1e-3
        forces = {link: np.array(force) for link, force in state.foot_forces}
        columns = []
        for link in state.near_ground:
            linear, angular = np.empty((3, robot.model.nv)), np.empty((3, robot.model.nv))
            mujoco.mj_jacBody(robot.model, data, linear, angular, robot.model.body(link).id)
            columns.append((angular @ coupling).T)
            if link in forces:
                missing -= (linear @ coupling).T @ forces.pop(link)
            else:
                columns.append((linear @ coupling).T)
        assert not any(force.any() for force in forces.values())
        columns = np.hstack(columns) / scale[:, None]
        wrenches, _, rank, _ = np.linalg.lstsq(columns, missing / scale)
        assert rank < len(missing)
        assert np.abs(columns @ wrenches - missing / scale).max() < bound
    assert touched > STATES / 2


def test_rapier_obeys_mujocos_equation_of_motion_in_the_limit_of_small_steps(tmp_path: Path) -> None:
    # Rapier takes velocity products implicitly, so its accelerations are off in proportion to the step h; combining
    # two steps leaves an error of about (h v)^2, with v some 10 rad/s. The couplings are left out: the few sweeps
    # of a step solve those to half a per cent only.
    awkward = ROOT / ROBOTS[-1]
    shutil.copy(awkward / "robot.toml", tmp_path)
    description = (awkward / "awkward.urdf").read_text()
    (tmp_path / "awkward.urdf").write_text(re.sub("<mimic [^>]*/>", "", description))
    robot, step = subject(str(tmp_path)), 1e-4
    extrapolated = 2 * accelerations(robot, "rapier", step / 2) - accelerations(robot, "rapier", step)
    assert residuals(robot, extrapolated).max() < (10 * step) ** 2
