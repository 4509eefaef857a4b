"""Sealed world of a robot that walks: a policy drives a humanoid with the faults of a case."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from types import SimpleNamespace

import mujoco
import numpy as np

from omniwalk_reference.walker import Walker

from . import track
from .actuator import Actuator
from .commands import Commands
from .drive import Drive, place, refuse_broken
from .effects import Case
from .humanoid import STEP, Humanoid
from .imu import Imu, fused
from .logs import Log
from .sensors import Reader
from .stand import worn

SETTLE = 0.75
"""How long the robot stands before the log begins, s."""

STANDING = 0.25
"""How long it stands in the log before it walks, s."""

LATENESS = 2e-4
"""Spread of when the control loop's steps come, s."""

LOWEST = 0.7
"""The trunk of a robot that has fallen is below this share of its height, or beyond the policy's angles."""


@dataclass
class Walked:
    """One walk: its log, and what only the truth may know of it."""

    log: Log
    floor: list[float]
    """Root mean square of reading less what was to be read, per joint, rad."""
    seconds: float
    """Length of the log, which ends with a fall."""
    fell: bool
    error: tuple[float, float] | None
    """Mean error of velocity, m/s, and turn rate, rad/s (`track.py`)."""
    torque: np.ndarray
    """Root mean square torque of each servo, N m."""
    speed: np.ndarray
    """Largest speed of each joint, rad/s."""
    motion: np.ndarray
    """Half of the range of each joint's motion, rad."""


class World:
    """A humanoid with the faults of a case, simulated in steps of `step` s; `rng` draws how far its data sheet is off."""

    def __init__(self, humanoid: Humanoid, case: Case, rng: np.random.Generator, step: float = STEP) -> None:
        self.humanoid, self.case, self.step = humanoid, case, step
        self.names = humanoid.names
        self.servos = {name: worn(servo, rng) for name, servo in humanoid.servos.items()}
        rotors = [name for name in self.names if self._actuator(name, rng).two_bodies]
        self.model = humanoid.model(self.servos, case.effects, rotors, step)
        self.places = [place(self.model, name) for name in self.names]
        self.rotors = {name: place(self.model, f"{name}_rotor") for name in rotors}
        self.positions = np.array([at.position for at in self.places])
        self.velocities = np.array([at.velocity for at in self.places])

    def _actuator(self, name: str, rng: np.random.Generator) -> Actuator:
        effects = [effect for effect in self.case.effects if effect.joint == name]
        return Actuator(self.servos[name], effects, rng, self.humanoid.nominal(name))

    def walk(self, policy: SimpleNamespace, commands: Commands, seconds: float, rng: np.random.Generator) -> Walked:
        """Lets `policy` follow `commands` for `seconds`, or until it falls; `rng` makes noise and jitter."""
        return _Run(self, policy, commands, rng).until(seconds)


class _Run:
    """A walk from standing on."""

    def __init__(self, world: World, policy: SimpleNamespace, commands: Commands, rng: np.random.Generator) -> None:
        self.world, self.commands, self.rng = world, commands, rng
        self.data = mujoco.MjData(world.model)
        world.humanoid.place(world.model, self.data)
        mujoco.mj_forward(world.model, self.data)
        self.height = float(self.data.qpos[2])
        self.drives = [
            Drive(world._actuator(name, rng), at, world.rotors.get(name)) for name, at in zip(world.names, world.places)
        ]
        self.log, self.reader, self.imu = Log(world.names), Reader(rng), Imu(rng)
        self.offsets = np.array([drive.actuator.offset for drive in self.drives])
        self.ages = [round(drive.actuator.reading_age / world.step) for drive in self.drives]
        self.history: deque[np.ndarray] = deque(maxlen=int(0.05 / world.step))
        self.policy = policy
        self.walker = Walker(policy)
        self.walker.reset(policy.spec.clock[1] if policy.spec.clock is not None else 0.0)
        self.columns = [world.names.index(name) for name in policy.spec.names]
        self.targets = np.array([world.humanoid.nominal(name) for name in world.names])
        self.track = track.Track(round(policy.spec.control_hz))
        self.torques = np.zeros(len(world.names))
        self.seen: list[tuple[np.ndarray, np.ndarray]] = []

    def until(self, seconds: float) -> Walked:
        """Runs to the end or to a fall."""
        period = 1.0 / self.policy.spec.control_hz
        length, ticks, next_tick = self.world.step, 0, 0.0
        for step in range(-round(SETTLE / length), round(seconds / length)):
            time = step * length
            self.history.append(self.data.qpos[self.world.positions] + self.offsets)
            self._sense(time)
            if time >= next_tick:
                self._control(time)
                if self._fallen():
                    return self._walked(time, True)
                ticks += 1
                next_tick = ticks * period + float(self.rng.normal(0.0, LATENESS))
            for drive in self.drives:
                drive.act(self.data, max(time, 0.0), True, length)
            mujoco.mj_step(self.world.model, self.data)
        return self._walked(seconds, False)

    def _sense(self, time: float) -> None:
        if time < 0.0:
            return
        if self.reader.due(time):
            last = len(self.history) - 1
            seen = [self.history[max(last - age, 0)][i] for i, age in enumerate(self.ages)]
            self.reader.read(time, np.array(seen))
        if self.imu.due(time):
            data = self.data
            self.imu.read(time, data.qpos[3:7], data.qvel[3:6], data.sensordata[:3])

    def _control(self, time: float) -> None:
        """A step of the control loop: targets from the last readings."""
        if time >= STANDING:
            desired = self.commands(time - STANDING)
            targets = self.walker.step(self._readings(desired))
            self.targets[self.columns] = targets
            data = self.data
            velocity = track.velocity(data.qpos[3:7], data.qvel[:3], data.qvel[3:6])
            self.track.add(velocity, self.walker.commanded, desired)
            self.seen.append((data.qpos[self.world.positions], data.qvel[self.world.velocities]))
            self.torques += [drive.actuator.load**2 for drive in self.drives]
        targets = [float(target) for target in self.targets]
        for drive, target in zip(self.drives, targets):
            drive.actuator.command(time, target)
        self.log.commands(time + float(self.rng.normal(0.0, 5e-5)), targets)

    def _readings(self, desired: np.ndarray) -> SimpleNamespace:
        return SimpleNamespace(
            position=np.array(self.reader.positions[-1])[self.columns],
            velocity=np.array(self.reader.velocities[-1])[self.columns],
            attitude=self.imu.attitude(),
            gyro=self.imu.turnings[-1],
            desired=desired,
            base_velocity=None,
        )

    def _fallen(self) -> bool:
        """Whether the trunk is too low or inclined."""
        base = self.data.qpos[:7]
        refuse_broken(self.data, self.world.case)
        return bool(base[2] < LOWEST * self.height or (np.abs(fused(base[3:7])) > self.policy.spec.upright).any())

    def _walked(self, seconds: float, fell: bool) -> Walked:
        for time, position, velocity in zip(self.reader.times, self.reader.positions, self.reader.velocities):
            self.log.states(time, position, velocity)
        imu = self.imu
        for time, (w, x, y, z), turning, force in zip(imu.times, imu.orientations, imu.turnings, imu.forces):
            self.log.imu(time, [float(v) for v in (x, y, z, w)], turning.tolist(), force.tolist())
        positions, speeds = (np.array(rows) for rows in zip(*self.seen))
        return Walked(
            log=self.log,
            floor=self.reader.floor(),
            seconds=seconds,
            fell=fell,
            error=self.track.error(),
            torque=np.sqrt(self.torques / len(self.seen)),
            speed=np.abs(speeds).max(axis=0),
            motion=0.5 * np.ptp(positions, axis=0),
        )
