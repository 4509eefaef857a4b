"""Motions of the engines against MuJoCo's: a chain and a double pendulum that swing, and the NimbRo-OP2X on a stand under chirps.

Every program has an error in proportion to its step. Twice the motion of half a step less that of a whole one leaves an
error of second order, of which three quarters go when both steps are halved again: what the last halving changes is
three times what is left. So two programs that mean the same robot must agree, extrapolated, within the sum of
those changes, whatever integrators they have.
"""

import json
import re
import shutil
import subprocess
from functools import cache

import mujoco
import numpy as np
import pytest
from programs import ROOT, program
from subjects import subject

CHAIN = "python/tests/robots/chain"

STEPS = (0.001, 0.0005, 0.00025)
"""s"""

SECONDS, SAMPLES = 0.5, 0.01
AMPLITUDE = 0.15
"""Of the chirps, rad, as in the example `motion_dump`."""


@cache
def engine_motion(robot: str, engine: str, dt: float) -> dict:
    """The output of the example `motion_dump`."""
    result = subprocess.run(
        [*program("motion_dump"), robot, engine, str(dt), str(SECONDS)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def mujoco_motion(folder: str, dt: float) -> np.ndarray:
    """The same motion in MuJoCo: samples by the degrees of freedom in the order of the engines."""
    robot, first = subject(folder, 1 / dt), engine_motion(folder, "scalar", STEPS[0])
    model, data = robot.model, mujoco.MjData(robot.model)
    model.opt.gravity[:] = [0, 0, -9.81]
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[:] = robot.robot.tree.positions(dict(zip(first["dofs"], first["start"])))
    columns = [model.joint(name).qposadr[0] for name in first["dofs"]]
    phases = np.array([first["dofs"].index(model.actuator(a).name) for a in range(model.nu)], float)
    nominal, every, samples = model.key_ctrl[0], round(SAMPLES / dt), []
    for step in range(round(SECONDS / dt)):
        time = step * dt
        data.ctrl[:] = nominal + AMPLITUDE * (np.sin((3 + 6 * time) * time + phases) - np.sin(phases))
        mujoco.mj_step(model, data)
        if (step + 1) % every == 0:
            samples.append(data.qpos[columns].copy())
    return np.array(samples)


def extrapolated(motions: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """The motion without a step, and what the last halving changed of it, rad."""
    coarse, middle, fine = motions
    first, second = 2 * middle - coarse, 2 * fine - middle
    return second, np.abs(second - first).max()


@pytest.fixture(scope="module")
def on_a_stand(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder of the NimbRo-OP2X bolted to a stand of 2 m."""
    folder, source = tmp_path_factory.mktemp("stand"), ROOT / "robots/nimbro_op2x"
    shutil.copy(source / "nimbro_op2x.urdf", folder)
    stand = (
        '<link name="world"/><joint name="stand" type="fixed"><parent link="world"/><child link="trunk_link"/>'
        '<origin xyz="0 0 2" rpy="0 0 0"/></joint>'
    )
    description = folder / "nimbro_op2x.urdf"
    description.write_text(re.sub(r"(<robot [^>]*>)", rf"\1{stand}", description.read_text(), count=1))
    settings = (source / "robot.toml").read_text()
    (folder / "robot.toml").write_text(settings.replace('base = "floating"', 'base = "fixed"'))
    return str(folder)


@pytest.fixture(scope="module")
def double_pendulum(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder of the chain's first two rods."""
    folder, source = tmp_path_factory.mktemp("double"), ROOT / CHAIN
    description = (source / "chain.urdf").read_text()
    rest = r'<(joint|link) name="(?:hinge|rod)_[2-5]".*?</\1>'
    (folder / "chain.urdf").write_text(re.sub(rest, "", description, flags=re.DOTALL))
    shutil.copy(source / "robot.toml", folder)
    return str(folder)


def agrees(folder: str, engine: str) -> None:
    """Asserts that the engine and MuJoCo move the robot alike."""
    own, own_change = extrapolated([np.array(engine_motion(folder, engine, dt)["positions"]) for dt in STEPS])
    other, other_change = extrapolated([mujoco_motion(folder, dt) for dt in STEPS])
    # A motion to speak of, or agreement says nothing.
    assert np.ptp(own, axis=0).max() > 0.1
    assert np.abs(own - other).max() < own_change + other_change


@pytest.mark.parametrize("engine", ["scalar", "rapier"])
def test_a_chain_swings_as_in_mujoco(engine: str) -> None:
    agrees(CHAIN, engine)


@pytest.mark.parametrize("engine", ["scalar", "rapier"])
def test_a_double_pendulum_swings_as_in_mujoco(engine: str, double_pendulum: str) -> None:
    assert len(engine_motion(double_pendulum, engine, STEPS[0])["dofs"]) == 2
    agrees(double_pendulum, engine)


@pytest.mark.parametrize("engine", ["scalar", "rapier"])
def test_a_robot_on_a_stand_follows_chirps_as_in_mujoco(engine: str, on_a_stand: str) -> None:
    agrees(on_a_stand, engine)
