"""The Rust loader and this one make the same robot of a folder, and MuJoCo moves it as our kinematics does.

Tolerances are those of f64 arithmetic: some hundred operations on numbers of order one lose less than 1e-12, the
bound is 1e-10 of the quantity's own scale.
"""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from subjects import ROBOTS, Subject, dump, matrix, subject

pytestmark = pytest.mark.parametrize("robot", [subject(folder) for folder in ROBOTS], ids=ROBOTS)

KINEMATIC_DT = 0.001


def by_name(robot: Subject) -> dict[str, int]:
    return {body.name: index for index, body in enumerate(robot.robot.tree.bodies)}


def test_merged_links_have_the_same_mass_centre_and_inertia(robot: Subject) -> None:
    links = dump(robot.folder, "scalar", KINEMATIC_DT).links
    index = by_name(robot)
    assert sorted(link.name for link in links) == sorted(index)
    for link in links:
        body = robot.robot.tree.bodies[index[link.name]]
        assert_allclose(link.mass, body.mass, rtol=1e-12)
        assert_allclose(link.com, body.com, rtol=0, atol=1e-12)
        assert_allclose(link.inertia, body.inertia, rtol=0, atol=1e-10 * np.trace(body.inertia) + 1e-15)


def test_joints_stop_where_their_followers_do(robot: Subject) -> None:
    reference = dump(robot.folder, "scalar", KINEMATIC_DT)
    assert len(reference.dofs) > 0
    for name, limits in zip(reference.dofs, reference.limits):
        joint = robot.model.joint(name)
        assert bool(joint.limited[0]) == (None not in limits)
        if joint.limited[0]:
            assert_allclose(joint.range, limits, rtol=1e-12)


def test_the_base_stands_at_the_same_height(robot: Subject) -> None:
    base = dump(robot.folder, "scalar", KINEMATIC_DT).base_pose
    pose = robot.robot.base_pose()
    assert_allclose(base.position, pose.translation, rtol=0, atol=1e-12)
    assert_allclose(matrix(base.orientation), pose.rotation, rtol=0, atol=1e-12)


def test_links_are_where_mujoco_has_them(robot: Subject) -> None:
    reference = dump(robot.folder, "scalar", KINEMATIC_DT)
    for state in reference.states:
        data, _ = robot.data(state, reference.dofs, reference.gravity)
        for link, pose in zip(reference.links, state.link_poses):
            body = data.body(link.name)
            assert_allclose(body.xpos, pose.position, rtol=0, atol=1e-10)
            assert_allclose(body.xmat.reshape(3, 3), matrix(pose.orientation), rtol=0, atol=1e-10)


def test_centre_of_mass_and_momentum_are_mujocos(robot: Subject) -> None:
    reference = dump(robot.folder, "scalar", KINEMATIC_DT)
    mass = robot.model.body_mass.sum()
    for state in reference.states:
        data, _ = robot.data(state, reference.dofs, reference.gravity)
        mujoco.mj_subtreeVel(robot.model, data)
        assert_allclose(state.center_of_mass, data.subtree_com[0], rtol=0, atol=1e-10)
        assert_allclose(state.linear_momentum, mass * data.subtree_linvel[0], rtol=0, atol=1e-10 * mass)
        assert_allclose(state.angular_momentum, data.subtree_angmom[0], rtol=0, atol=1e-10 * mass)


def test_a_foots_shape_ends_where_its_sole_is(robot: Subject) -> None:
    # One engine collides the shape, the other and MuJoCo the sole.
    for foot in robot.robot.feet:
        (shape,) = robot.robot.tree.bodies[foot.body].shapes
        assert shape.kind == "box"
        x, y, z = shape.size
        corners = [shape.pose.point(np.array([a * x, b * y, -z])) for a in (1, -1) for b in (1, -1)]
        assert_allclose(corners, foot.corners(), rtol=0, atol=1e-9)
