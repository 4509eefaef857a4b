"""NimbRo-OP2X stands in MuJoCo under its position servos alone, with targets at the nominal pose."""

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest
from subjects import ROBOTS, Subject, subject

GRAVITY = 9.81

pytestmark = pytest.mark.parametrize("physics_hz", [200.0, 1000.0])


def start(physics_hz: float, height: float) -> tuple[Subject, mujoco.MjData]:
    """The robot in its nominal pose, lifted by `height` m."""
    robot = subject(ROBOTS[0], physics_hz)
    robot.model.opt.gravity[:] = [0, 0, -GRAVITY]
    data = mujoco.MjData(robot.model)
    mujoco.mj_resetDataKeyframe(robot.model, data, 0)
    data.qpos[2] += height
    return robot, data


def steps(robot: Subject, data: mujoco.MjData, seconds: float) -> Iterator[None]:
    """Steps the simulation for `seconds`, stopping for a look after every step."""
    for _ in range(round(seconds / robot.model.opt.timestep)):
        mujoco.mj_step(robot.model, data)
        yield


def contact_force(robot: Subject, data: mujoco.MjData) -> float:
    """Sum of the normal forces of all contacts with the floor, N."""
    force, total = np.empty(6), 0.0
    for contact in range(data.ncon):
        mujoco.mj_contactForce(robot.model, data, contact, force)
        total += force[0]
    return total


def coupling_error(robot: Subject, data: mujoco.MjData) -> float:
    """Largest difference between a mimic joint and what it follows, rad."""
    joints = [joint for joint in robot.robot.tree.joints if joint.mimic is not None]
    follow = [j.mimic[1] * data.joint(j.mimic[0]).qpos[0] + j.mimic[2] for j in joints]
    return max(abs(data.joint(joint.name).qpos[0] - value) for joint, value in zip(joints, follow))


def is_upright(robot: Subject, data: mujoco.MjData) -> bool:
    """Base within 2 cm of its nominal height and 2 degrees of the vertical."""
    tilt = np.degrees(np.arccos(np.clip(data.body(1).xmat[8], -1, 1)))
    return abs(data.qpos[2] - robot.model.key_qpos[0, 2]) < 0.02 and tilt < 2


def test_weight_equals_contact_force_when_standing_for_ten_seconds(physics_hz: float) -> None:
    robot, data = start(physics_hz, 0.0)
    assert all(is_upright(robot, data) for _ in steps(robot, data, 8))
    forces = [contact_force(robot, data) for _ in steps(robot, data, 2)]
    # Momentum balance: over two seconds the mean force differs from the weight by m dv / 2 s.
    assert np.abs(data.qvel).max() < 0.01
    weight = GRAVITY * robot.model.body_mass.sum()
    assert np.mean(forces) == pytest.approx(weight, rel=0.02 / (2 * GRAVITY))
    assert is_upright(robot, data)


def test_standing_takes_a_small_part_of_the_torque(physics_hz: float) -> None:
    robot, data = start(physics_hz, 0.0)
    for _ in steps(robot, data, 5):
        pass
    limits = np.array([joint.motor.torque_limit for joint in robot.robot.joints if joint.motor])
    assert (np.abs(data.actuator_force) < 0.3 * limits).all()


def test_a_drop_from_two_centimetres_ends_in_standing(physics_hz: float) -> None:
    robot, data = start(physics_hz, 0.02)
    depth, error = 0.0, 0.0
    for _ in steps(robot, data, 3):
        depth = max(depth, -data.contact.dist.min(initial=0.0))
        error = max(error, coupling_error(robot, data))
    assert is_upright(robot, data)
    # A critically damped contact of time constant T stops an impact at speed v within v T.
    assert depth < np.sqrt(2 * GRAVITY * 0.02) * 2 / physics_hz
    # So do the couplings: the impact turns a thigh of 0.298 m at v over its length.
    assert error < np.sqrt(2 * GRAVITY * 0.02) / 0.298 * 2 / physics_hz
