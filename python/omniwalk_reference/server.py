"""`python -m omniwalk_reference.server`: MuJoCo and the readings of this package for another program, over its pipes.

A request is a letter, the length of what follows (u32) and that much; a reply is 0 and what was asked for, or 1 and a sentence
on what is wrong, each with its length (u32) between. All numbers are little-endian; a head of JSON has its length (u32)
before it, and float64 after it. The letters are the methods of [`Server`].
"""

from __future__ import annotations

import json
import os
import struct
import sys
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np

from . import dynamics, policy_file, robot
from .walker import Walker
from .worlds import BASE, Worlds


class Server:
    """Answers requests; each method takes the bytes of one and gives those of the reply."""

    def __init__(self) -> None:
        self.worlds: Worlds | None = None
        self.links: list[str] = []
        self.joints: list[str] = []

    def model(self, payload: bytes) -> bytes:
        """Worlds of a robot: its path, the rate of the physics, how many, where its base is bolted (`stand`, m, or null), `without`
        what (`couplings`, `limits`, `legs` that collide), the `soles`, and the order of everything by name."""
        head, _ = _head(payload)
        loaded = robot.load(Path(head["robot"]), head["soles"])
        if head["stand"]:
            loaded.floating, loaded.fixed_pose = False, robot.Pose(translation=np.array(head["stand"], float))
        self.links, self.joints = head["links"], head["joints"]
        if "couplings" in head["without"]:
            for joint in loaded.tree.joints:
                joint.mimic = None
        legs = "legs" not in head["without"]
        feet = [sole["link"] for sole in head["soles"]]
        self.worlds = Worlds(loaded, head["physics_hz"], head["worlds"], head["dofs"], feet, legs=legs)
        if "limits" in head["without"]:
            for world in self.worlds.worlds:
                world.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        model = self.worlds.model
        described = {"mujoco": mujoco.__version__, "mass": float(model.body_mass.sum()), "width": self.worlds.width}
        return json.dumps(described).encode()

    def reset(self, payload: bytes) -> bytes:
        """A world starts anew: its number (f64), then what [`World.reset`] takes. Its state."""
        numbers = np.frombuffer(payload, "<f8")
        return self.worlds.reset(int(numbers[0]), numbers[1:], self.links, self.joints).tobytes()

    def step(self, payload: bytes) -> bytes:
        """A physics step of all worlds: seven rows of drive, then a push for each world. The states."""
        count, dofs = len(self.worlds.worlds), len(self.worlds.dofs)
        numbers = np.frombuffer(payload, "<f8")
        drive, pushes = numbers[: 7 * dofs * count], numbers[7 * dofs * count :]
        return self.worlds.step(drive.reshape(7, dofs, count), pushes.reshape(count, 3)).tobytes()

    def dynamics(self, payload: bytes) -> bytes:
        """What follows from the state that the first world was reset to, see [`dynamics.of`]."""
        return dynamics.of(self.worlds, np.frombuffer(payload, "<f8"))

    def network(self, payload: bytes) -> bytes:
        """Targets of a policy over readings in sequence, from a reset at phase 0 on. Of the head: the length of the policy's
        file, which follows; then for each step a row of positions, velocities, attitude, gyro, desired velocity, where it is `given`
        the base's velocity, and the targets that were sent, which the next step goes by."""
        head, rest = _head(payload)
        walker = Walker(policy_file.read(rest[: head["policy"]]))
        walker.reset(0.0)
        n = len(walker.spec.names)
        width = 2 * n + 8 + (3 if head["given"] else 0)
        targets = []
        for row in np.frombuffer(rest[head["policy"] :], "<f8").reshape(-1, width + n):
            targets.append(walker.step(_readings(row[:width], n)))
            walker.previous_target = row[width:]
        return np.array(targets).tobytes()

    def observe(self, payload: bytes) -> bytes:
        """Observations of a policy along a trajectory of the first world, from MuJoCo's own kinematics. Of the head: the length
        of the policy's file, the phase the clock starts at, the policy's joints, and whether the base's velocity is `given`;
        then for each step the base, positions and velocities of the degrees of freedom, the desired velocity and the action."""
        head, rest = _head(payload)
        walker = Walker(policy_file.read(rest[: head["policy"]]))
        walker.reset(head["phase"])
        world, columns = self.worlds.worlds[0], [self.worlds.dofs.index(name) for name in walker.spec.names]
        n, joints = len(self.worlds.dofs), len(columns)
        rows = np.frombuffer(rest[head["policy"] :], "<f8").reshape(-1, BASE + 2 * n + 3 + joints)
        observations = []
        for row in rows:
            base, q, v, desired, action = np.split(row, np.cumsum([BASE, n, n, 3]))
            world.place(base, q, v)
            readings = dynamics.readings(world, columns, desired, head["given"])
            walker.observe(readings)
            observations.append(walker.observation)
            walker.decode(action, readings.position)
        return np.array(observations).tobytes()


def _readings(row: np.ndarray, n: int) -> SimpleNamespace:
    position, velocity, attitude, gyro, desired, base = np.split(row, np.cumsum([n, n, 2, 3, 3]))
    return SimpleNamespace(
        position=position,
        velocity=velocity,
        attitude=attitude,
        gyro=gyro,
        desired=desired,
        base_velocity=base if base.size else None,
    )


def _head(payload: bytes) -> tuple[dict, bytes]:
    (length,) = struct.unpack_from("<I", payload)
    return json.loads(payload[4 : 4 + length]), payload[4 + length :]


def main() -> None:
    """Answers until the other side closes its pipe."""
    requests, replies = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    # What anything prints goes where people look.
    os.dup2(2, 1)
    server = Server()
    methods = {name[0]: getattr(server, name) for name in ("model", "reset", "step", "dynamics", "network", "observe")}
    while header := requests.read(5):
        letter, length = struct.unpack("<cI", header)
        try:
            status, reply = 0, methods[letter.decode()](requests.read(length))
        except Exception as error:  # Whatever it is, the other side should hear of it.
            status, reply = 1, f"{type(error).__name__}: {error}".encode()
        replies.write(struct.pack("<BI", status, len(reply)))
        replies.write(reply)
        replies.flush()


if __name__ == "__main__":
    main()
