"""Worlds of one robot in MuJoCo, stepped as the project's engines are: drives and pushes in, states out.

Everything is float64 and SI. A state of a world is a row of numbers: 1 while all of it is finite and 0 after; position and
orientation (w, x, y, z) of the base link, its linear velocity and its angular velocity, in the world frame; positions,
velocities and torques of the degrees of freedom; the ground's force on each foot in the world frame. A fixed base is at
rest where it is bolted.
"""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np

from . import mjcf
from .robot import Robot

BASE = 13
"""Numbers of a base: position, orientation, linear and angular velocity."""

FAR, FAST = 1e4, 1e4
"""Beyond these a world counts as lost: positions in m or rad, velocities in m/s or rad/s."""


MOST_TRIES = 8
"""Times that a step is taken until motors are at their limits or not as they were taken to be."""

LEAST_ROTOR = 1e-3
"""Share of a rotor that stays at its joint where play or elasticity make the rotor a body of its own: joints of plates without mass
would be singular."""

WEIGHT = ["body_mass", "body_ipos", "body_inertia", "body_iquat"]
"""What a body weighs: mass, centre of mass, principal moments and their axes."""


class Worlds:
    """`count` worlds; degrees of freedom are in the order of the joints in `dofs`, feet in that of the bodies in `feet`; legs
    collide with each other if `legs` is set."""

    def __init__(
        self, robot: Robot, physics_hz: float, count: int, dofs: list[str], feet: list[str], *, legs: bool = True
    ) -> None:
        self.robot = robot
        text = mjcf.write(robot, physics_hz, legs=legs)
        leaders = {joint.name for joint in robot.tree.joints if joint.mimic is None}
        _same("degrees of freedom", dofs, leaders)
        soles = {robot.tree.bodies[foot.body].name: f"sole_{foot.name}" for foot in robot.feet}
        _same("feet", feet, set(soles))
        first = mujoco.MjModel.from_xml_string(text)
        # A world that was lost says so, and does not start anew by itself.
        first.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.model, self.dofs, self.soles = first, dofs, [soles[foot] for foot in feet]
        self.floating = robot.floating
        self.worlds = [World(first, self, mujoco.MjData(first))]
        for _ in range(count - 1):
            model = mujoco.MjModel.from_xml_string(text)
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
            self.worlds.append(World(model, self, mujoco.MjData(model)))
        self.width = 1 + BASE + 3 * len(dofs) + 3 * len(feet)
        self.states = np.zeros((count, self.width))

    def reset(self, index: int, numbers: np.ndarray, links: list[str], joints: list[str]) -> np.ndarray:
        """Starts `index` anew, see [`World.reset`]; its state."""
        self.worlds[index].reset(numbers, links, joints)
        self.worlds[index].state(self.states[index])
        return self.states[index]

    def step(self, drive: np.ndarray, pushes: np.ndarray) -> np.ndarray:
        """One physics step of every world; the states. `drive` holds targets, stiffnesses, dampings, torques ahead, lower
        and upper torque limits and dry frictions, each a row for each degree of freedom and a column for each world."""
        for index, (world, push) in enumerate(zip(self.worlds, pushes)):
            world.step(drive[:, :, index], push)
            world.state(self.states[index])
        return self.states


class World:
    """One world, with a model of its own, as masses and friction are."""

    def __init__(self, model: mujoco.MjModel, worlds: Worlds, data: mujoco.MjData) -> None:
        self.model, self.data, self.floating = model, data, worlds.floating
        joints = [model.joint(name) for name in worlds.dofs]
        self.positions = np.array([joint.qposadr[0] for joint in joints])
        self.velocities = np.array([joint.dofadr[0] for joint in joints])
        self.soles = np.full(model.ngeom, -1)
        for index, name in enumerate(worlds.soles):
            self.soles[model.geom(name).id] = index
        self.floor = model.geom("floor").id
        self.forces = np.zeros((len(worlds.soles), 3))
        self.torques, self.lost = np.zeros(len(joints)), False
        # Views, as looking them up takes longer than writing to them.
        self.armature, self.friction, self.applied = model.dof_armature, model.dof_frictionloss, data.qfrc_applied
        self.position, self.velocity = data.qpos, data.qvel
        # Every step brings its own torques.
        model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0
        fields = [*WEIGHT, "dof_armature", "dof_damping"]
        self.own = SimpleNamespace(**{field: getattr(model, field).copy() for field in fields})

    def reset(self, numbers: np.ndarray, links: list[str], joints: list[str]) -> None:
        """Starts anew. `numbers`: the base (position, orientation, velocities), positions and velocities of the degrees of
        freedom, friction (tangential, torsional, rolling), gravity, then for each of `links` mass, centre of mass and
        inertia (xx, yy, zz, xy, xz, yz), and for each of `joints` armature and viscous friction. What is not a number is as
        this side has read it."""
        n = len(self.positions)
        base, q, v, friction, gravity, bodies, passive = np.split(
            numbers, np.cumsum([BASE, n, n, 3, 3, 10 * len(links)])
        )
        model, data, own = self.model, self.data, self.own
        model.geom_friction[self.floor], model.opt.gravity[:] = friction, gravity
        self.friction[:] = 0.0
        for name, (armature, damping) in zip(joints, passive.reshape(-1, 2)):
            dof = model.joint(name).dofadr[0]
            rotor = own.dof_armature[dof]
            model.dof_armature[dof] = rotor if np.isnan(armature) else max(armature, LEAST_ROTOR * rotor)
            model.dof_damping[dof] = own.dof_damping[dof] if np.isnan(damping) else damping
        self.rotors = self.armature[self.velocities]
        changed = [self._weigh(name, row) for name, row in zip(links, bodies.reshape(-1, 10))]
        if any(changed):
            mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
        self.place(base, q, v)
        mujoco.mj_forward(model, data)
        self.forces[:], self.torques[:], self.lost = 0.0, 0.0, False

    def _weigh(self, name: str, row: np.ndarray) -> bool:
        """Sets the mass properties of a body; whether it had others."""
        model, body = self.model, self.model.body(name).id
        mass, centre, (xx, yy, zz, xy, xz, yz) = row[0], row[1:4], row[4:]
        if np.isnan(mass):
            values = [getattr(self.own, field)[body] for field in WEIGHT]
        else:
            moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            axes[:, 2] *= np.linalg.det(axes)
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, axes.flatten())
            values = [mass, centre, moments, quaternion]
        places = [getattr(model, field) for field in WEIGHT]
        same = all(np.array_equal(place[body], value) for place, value in zip(places, values))
        for place, value in zip(places, values):
            place[body] = value
        return not same

    def place(self, base: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Sets the state; joints that follow others follow."""
        if self.floating:
            rotation = np.empty(9)
            mujoco.mju_quat2Mat(rotation, base[3:7])
            self.position[:7], self.velocity[:3] = base[:7], base[7:10]
            self.velocity[3:6] = rotation.reshape(3, 3).T @ base[10:]
        self.position[self.positions], self.velocity[self.velocities] = q, v
        for follower, leader, ratio, offset in self._couplings():
            self.position[follower.qposadr] = ratio * self.position[leader.qposadr] + offset
            self.velocity[follower.dofadr] = ratio * self.velocity[leader.dofadr]

    def _couplings(self):
        model = self.model
        for e in range(model.neq):
            follower, leader = model.joint(model.eq_obj1id[e]), model.joint(model.eq_obj2id[e])
            yield follower, leader, model.eq_data[e, 1], model.eq_data[e, 0]

    def step(self, drive: np.ndarray, push: np.ndarray) -> None:
        """One step under a drive, rows as in [`Worlds.step`]."""
        if self.lost:
            return
        self.friction[self.velocities] = drive[6]
        if self.floating:
            # The generalised force on the base's position is a force on its origin in the world frame.
            self.applied[:3] = push
        self._move(*drive[:6])
        self._feel()

    def _move(self, target, stiffness, damping, ahead, lower, upper) -> None:
        """MuJoCo's step of h s under motors whose velocity gain D and limits hold for the velocity after it.

        `(M + h D) a = f - D v` with the velocity v before is that gain; h D is given as armature. MuJoCo's own implicit integration
        solves contacts and couplings with M alone, and clamps by v, with which the end of a gap, which pushes and never pulls, would
        pull: robots with play or springs in their joints came apart."""
        data, dofs, h = self.data, self.velocities, self.model.opt.timestep
        before = self.position.copy(), self.velocity.copy(), data.qacc_warmstart.copy()
        at_rest, v = stiffness * (target - self.position[self.positions]) + ahead, self.velocity[dofs]
        torque = at_rest - damping * v
        for attempt in range(MOST_TRIES):
            free, limit = (lower < torque) & (torque < upper), np.clip(torque, lower, upper)
            if attempt:
                self.position[:], self.velocity[:], data.qacc_warmstart[:] = before
            self.armature[dofs] = self.rotors + np.where(free, h * damping, 0.0)
            self.applied[dofs] = np.where(free, at_rest - damping * v, limit)
            mujoco.mj_step(self.model, data)
            torque = at_rest - damping * self.velocity[dofs]
            if np.array_equal(np.clip(torque, lower, upper), np.where(free, torque, limit)):
                break
        self.torques[:] = np.where(free, torque, limit)

    def _feel(self) -> None:
        """The ground's forces on the feet in this step."""
        self.forces[:] = 0.0
        data = self.data
        if not data.ncon:
            return
        contact = data.contact
        feet, first = self.soles[contact.geom[:, 1]], contact.efc_address
        touches = (contact.geom[:, 0] == self.floor) & (feet >= 0) & (first >= 0)
        if not touches.any():
            return
        # Normal force and two tangential ones along the rows of the contact's frame, whose normal points at the foot.
        local = data.efc_force[first[touches, None] + np.arange(3)]
        world = np.einsum("ci,cij->cj", local, contact.frame[touches].reshape(-1, 3, 3))
        np.add.at(self.forces, feet[touches], world)

    def state(self, row: np.ndarray) -> None:
        """Writes the state into `row`."""
        n, (q, v) = len(self.positions), (self.position, self.velocity)
        far = max(np.abs(q).max(), np.abs(v).max())
        self.lost = self.lost or not far < min(FAR, FAST)
        row[0] = not self.lost
        if self.floating:
            row[1:8], row[8:11] = q[:7], v[:3]
            w, x, y, z = q[3:7]
            # The turn of the base's own frame in the world: v + 2 w (u x v) + 2 u x (u x v).
            a, b, c = v[3:6]
            s, t, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
            row[11] = a + w * s + y * r - z * t
            row[12] = b + w * t + z * s - x * r
            row[13] = c + w * r + x * t - y * s
        else:
            row[1:4], row[4:8], row[8:14] = self.model.body_pos[1], self.model.body_quat[1], 0.0
        start = 1 + BASE
        row[start : start + n], row[start + n : start + 2 * n] = q[self.positions], v[self.velocities]
        row[start + 2 * n : start + 3 * n] = self.torques
        row[start + 3 * n :] = self.forces.ravel()


def _same(what: str, ours: list[str], theirs: set[str]) -> None:
    if set(ours) != theirs or len(ours) != len(theirs):
        raise ValueError(f"the robot's {what} differ between the two readings of it: {sorted(ours)} and {sorted(theirs)}")
