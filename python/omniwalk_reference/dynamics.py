"""What MuJoCo says of a single state: equation of motion, momentum, and what sensors read.

With `qvel = G v` for the couplings, where v are the velocities as the project has them (origin and rotation of the base in the
world frame, then the degrees of freedom), the equation of motion is `G'MG a + G'c = f` with MuJoCo's mass matrix M (armature
included) and bias force c.
"""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np

from .robot import Robot
from .worlds import World, Worlds


def coupling(robot: Robot, rotation: np.ndarray, dofs: list[str]) -> np.ndarray:
    """G, for the degrees of freedom in the order of `dofs`; `rotation` is that of the base, whose turning MuJoCo has in the
    base's own frame."""
    joints, base = robot.tree.joints, 6 if robot.floating else 0
    matrix = np.zeros((base + len(joints), base + len(dofs)))
    if base:
        matrix[:3, :3], matrix[3:6, 3:6] = np.eye(3), rotation.T
    for row, joint in enumerate(joints):
        leader, ratio, _ = (joint.name, 1.0, 0.0) if joint.name in dofs else joint.mimic
        matrix[base + row, base + dofs.index(leader)] = ratio
    return matrix


def of(worlds: Worlds, accelerations: np.ndarray) -> bytes:
    """For the state that the first world was reset to: the centre of mass, linear momentum and angular momentum about it, and then, for
    each row of `accelerations` (base, then the degrees of freedom), `G'MG a`, and the sum of the magnitudes of what it is
    made of; last `G'c`."""
    world = worlds.worlds[0]
    model, data = world.model, world.data
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    matrix = coupling(worlds.robot, data.xmat[1].reshape(3, 3), worlds.dofs)
    mass, bias = matrix.T @ mass @ matrix, matrix.T @ data.qfrc_bias
    rows = accelerations.reshape(-1, mass.shape[0])
    momentum = [data.subtree_com[0], model.body_mass.sum() * data.subtree_linvel[0], data.subtree_angmom[0]]
    parts = [*momentum, rows @ mass, np.abs(rows) @ np.abs(mass), bias]
    return np.concatenate([np.ravel(part) for part in parts]).tobytes()


def readings(world: World, columns: list[int], desired: np.ndarray, given: bool) -> SimpleNamespace:
    """What the sensors of a robot in the state of `world` say, for the joints in `columns` of the degrees of freedom."""
    model, data = world.model, world.data
    mujoco.mj_forward(model, data)
    up = data.xmat[1].reshape(3, 3)[2]
    twist = np.empty(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, 1, twist, 1)
    return SimpleNamespace(
        position=world.position[world.positions[columns]],
        velocity=world.velocity[world.velocities[columns]],
        # Fused roll and pitch.
        attitude=np.array([np.arcsin(up[1]), np.arcsin(-up[0])]),
        gyro=twist[:3],
        desired=desired,
        base_velocity=twist[3:] if given else None,
    )
