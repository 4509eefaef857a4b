"""The forward task in MuJoCo as one would set it up without this project: a Gymnasium environment in Python, one robot a process.

Robot, observation, actions, reward, commands, randomisation and the rules of an episode are those of configs/forward.toml; physics,
contacts and integration are MuJoCo's own. Random numbers are drawn from the same distributions, not in the same order. Legs that
touch each other end the episode, as overlapping ones do in the project's engines.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces

from omniwalk_reference import mjcf
from omniwalk_reference import robot as robots

from . import settings
from .judge import Judge, Truth, heading
from .observer import Observer

CONTACT_SHARE, RELEASE_SHARE, RELEASE_TIME = 0.05, 0.01, 0.02
"""A foot is loaded from this share of the weight on, until it has carried less than that share for so long (s)."""


class Walk(gymnasium.Env):
    """A robot that learns to walk at a desired velocity; actions in [-1, 1], 0 is the nominal pose."""

    metadata = {"render_modes": []}

    def __init__(self, config: Path = settings.CONFIG, changes: dict[str, dict] | None = None) -> None:
        """Under a configuration file, with `changes` (section, key, value) over it."""
        self.config = settings.task(config)
        for section, values in (changes or {}).items():
            self.config[section] |= values
        engine = self.config["engine"]
        self.hz, self.substeps = engine["control_hz"], engine["physics_hz"] // engine["control_hz"]
        self.robot = robots.load(settings.ROOT / self.config["robot"]["path"])
        text = mjcf.write(self.robot, engine["physics_hz"], legs=True)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.observer = Observer(self.config, self.robot, self.model)
        layout, self.base_height = self.observer.layout, self.robot.base_pose().translation[2]
        self.judge = Judge(self.config, layout.nominal, self.base_height)
        self.floor = self.model.geom("floor").id
        self.sole_of = [-1] * self.model.ngeom
        for index, foot in enumerate(self.robot.feet):
            self.sole_of[self.model.geom(f"sole_{foot.name}").id] = index
        self.centres = np.array([foot.pose.translation for foot in self.robot.feet])
        self.sideways = np.array([foot.pose.rotation[:, 1] for foot in self.robot.feet])
        self.original = {name: getattr(self.model, name).copy() for name in ("body_mass", "body_inertia", "body_ipos")}
        self.weight = self.model.body_mass.sum() * 9.81
        self.observation_space = spaces.Box(-np.inf, np.inf, (self.observer.width,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (self.observer.actions,), np.float32)
        self.first = self.config["task"]["random_first_length"]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Starts an episode."""
        super().reset(seed=seed)
        self._draw_episode()
        self._draw_world()
        self._place()
        truth = self.truth_now()
        self.observer.reset(0.5 if self.np_random.random() < 0.5 else 0.0)
        self.judge.reset(heading(truth.rotation))
        self.readings = [self.measure(truth)] * 4
        self.soles, self.contact, self.unloaded = truth.soles, np.ones(2, bool), np.zeros(2)
        self.legs_touched, self.total, self.tracking = False, 0.0, Tracking(self.hz)
        return self.observer.observe(self._delayed(), self.desired), {}

    def step(self, action: np.ndarray):
        """One control step."""
        self._command(np.asarray(action, float))
        self._push()
        for _ in range(self.substeps):
            self._physics()
        mujoco.mj_kinematics(self.model, self.data)
        self.count += 1
        truth = self.truth_now()
        slip = self._slip(truth)
        commanded, desired = self.observer.commanded, self.desired
        self._redraw()
        self.readings = [self.measure(truth), *self.readings[:3]]
        observation = self.observer.observe(self._delayed(), self.desired)
        terms = self.judge.terms(truth, commanded, self.observer.frame_was_set, float(self.observer.phase), slip)
        reward = sum(terms.values())
        self.total += reward
        self.tracking.step(truth, commanded, bool(np.abs(commanded - desired).max() < 1e-4))
        end = "fallen" if not self.judge.stands(truth) else "leg_overlap" if self.legs_touched else None
        truncated = end is None and self.count >= self.length
        info: dict[str, Any] = {}
        if end or truncated:
            end = {"end": end or "time_out", "steps": self.count, "return": self.total}
            info["episode_end"] = end | self.tracking.errors()
        return observation, reward, bool(info) and not truncated, truncated, info

    def _draw_episode(self) -> None:
        """What stays for the episode, but its physics."""
        random, config = self.np_random, self.config
        full = round(config["task"]["episode_seconds"] * self.hz)
        self.length = 1 + int(random.random() * full) if self.first else full
        self.first, self.count, self.pushing = False, 0, 0
        self.desired, self.until = self._draw_command(), self._draw_interval()
        spread, latency = config["randomise"]["pd_noise"], config["latency"]
        self.response = random.uniform(1.0 - spread, 1.0 + spread, self.observer.actions)
        self.delay = random.uniform(latency["lower"], latency["upper"]) * self.hz if latency["enabled"] else 0.0

    def _draw_command(self) -> np.ndarray:
        random, command = self.np_random, self.config["command"]
        kind, axis = random.random(), random.integers(3)
        velocity = random.uniform(command["lower"], command["upper"])
        if kind < command["zero_share"]:
            return np.zeros(3)
        if kind < command["zero_share"] + command["axis_share"]:
            return np.where(np.arange(3) == axis, velocity, 0.0)
        return velocity

    def _draw_interval(self) -> int:
        mean = self.config["command"]["resample_seconds"] * self.hz
        return max(round(self.np_random.uniform(0.5, 1.5) * mean), 1)

    def _redraw(self) -> None:
        self.until -= 1
        if self.until == 0:
            self.desired, self.until = self._draw_command(), self._draw_interval()

    def _draw_world(self) -> None:
        """Friction of the ground, masses, the base's centre of mass."""
        random, model, friction = self.np_random, self.model, self.config["friction"]
        ranges = np.array([friction[key] for key in ("tangential", "torsional", "rolling")])
        model.geom_friction[self.floor] = random.uniform(*ranges.T) if friction["enabled"] else ranges.mean(axis=1)
        spread, shift = (self.config["randomise"][key] for key in ("mass", "centre_of_mass"))
        factors = random.uniform(1.0 - spread, 1.0 + spread, model.nbody)
        model.body_mass[:] = factors * self.original["body_mass"]
        model.body_inertia[:] = factors[:, None] * self.original["body_inertia"]
        model.body_ipos[1] = self.original["body_ipos"][1] + random.uniform(-shift, shift, 3)
        mujoco.mj_setConst(model, self.data)

    def _place(self) -> None:
        """The nominal pose but for the joints' deviations, the lowest corner of the soles on the ground."""
        layout, deviation = self.observer.layout, self.config["randomise"]["start_position"]
        start = layout.nominal + self.np_random.normal(0.0, deviation, len(layout.nominal))
        start = np.clip(start, layout.lower, layout.upper)
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.data.qpos[7:] = layout.ratios @ start + layout.offsets
        mujoco.mj_kinematics(self.model, self.data)
        feet = self.observer.feet
        rotations = self.data.xmat[feet].reshape(-1, 3, 3)
        corners = self.observer.corners @ rotations.transpose(0, 2, 1) + self.data.xpos[feet][:, None]
        self.data.qpos[2] -= corners[..., 2].min()
        mujoco.mj_forward(self.model, self.data)

    def _command(self, action: np.ndarray) -> None:
        """Targets for the motors, which answer as strongly as drawn for this episode (equation 7.14)."""
        layout = self.observer.layout
        target, position = self.observer.decode(action), self.data.qpos[layout.positions]
        target = np.clip(position + self.response * (target - position), layout.lower, layout.upper)
        self.data.ctrl[layout.motors] = target

    def _push(self) -> None:
        """Now and then a force on the base from a random side."""
        push, force = self.config["push"], self.data.qfrc_applied
        if not push["enabled"]:
            return
        if self.pushing > 0:
            self.pushing -= 1
            if self.pushing == 0:
                force[:3] = 0.0
        elif self.np_random.random() < 1.0 / (self.hz * push["interval"]):
            angle, size = self.np_random.uniform(0.0, [2.0 * math.pi, push["force"]])
            force[:3] = size * math.cos(angle), size * math.sin(angle), 0.0
            self.pushing = max(round(push["duration"] * self.hz), 1)

    def _physics(self) -> None:
        """One physics step. A motor's torque in the direction of motion falls linearly to zero at its no-load speed."""
        layout, data = self.observer.layout, self.data
        share = data.qvel[layout.velocities] / layout.speed
        limits = self.model.actuator_forcerange
        limits[layout.motors, 0] = -layout.torque * np.minimum(np.maximum(1.0 + share, 0.0), 1.0)
        limits[layout.motors, 1] = layout.torque * np.minimum(np.maximum(1.0 - share, 0.0), 1.0)
        mujoco.mj_step(self.model, data)
        self._feel()

    def _feel(self) -> None:
        """Which feet are loaded, by the vertical forces of this step, and whether legs touched."""
        data, forces = self.data, [0.0, 0.0]
        if data.ncon:
            contact = data.contact
            for (one, other), row, distance in zip(contact.geom.tolist(), contact.efc_address.tolist(), contact.dist.tolist()):
                if one != self.floor:
                    self.legs_touched |= distance < 0.0
                elif self.sole_of[other] >= 0 and row >= 0:
                    forces[self.sole_of[other]] += data.efc_force[row]
        dt = self.model.opt.timestep
        for foot, force in enumerate(forces):
            share = force / self.weight
            if share > CONTACT_SHARE:
                self.contact[foot], self.unloaded[foot] = True, 0.0
            elif share < RELEASE_SHARE or not self.contact[foot]:
                self.unloaded[foot] += dt
                if self.unloaded[foot] >= RELEASE_TIME - 1e-9:
                    self.contact[foot] = False
            else:
                self.unloaded[foot] = 0.0

    def _slip(self, truth: Truth) -> float:
        """Sum of the squared horizontal speeds of the soles in contact over this control step, (m/s)^2."""
        moved = (truth.soles - self.soles)[:, :2] * self.hz
        self.soles = truth.soles
        return float((moved**2).sum(axis=1) @ self.contact)

    def truth_now(self) -> Truth:
        """The robot as it is."""
        data, layout, feet = self.data, self.observer.layout, self.observer.feet
        rotations = data.xmat[feet].reshape(-1, 3, 3)
        return Truth(
            rotation=data.xmat[1].reshape(3, 3).copy(),
            position=data.qpos[:3].copy(),
            velocity=data.qvel[:3].copy(),
            turning=data.qvel[3:6].copy(),
            joints=data.qpos[layout.positions],
            soles=np.einsum("fij,fj->fi", rotations, self.centres) + data.xpos[feet],
            sideways=np.einsum("fij,fj->fi", rotations, self.sideways),
        )

    def measure(self, truth: Truth) -> tuple[np.ndarray, ...]:
        """What the sensors say now."""
        up = truth.rotation[2]
        attitude = np.array([math.asin(min(max(up[1], -1.0), 1.0)), math.asin(min(max(-up[0], -1.0), 1.0))])
        exact = truth.joints, self.data.qvel[self.observer.layout.velocities], attitude, truth.turning
        noise = self.config["noise"]
        if not noise["enabled"]:
            return exact
        sizes = noise["position"], noise["velocity"], noise["accelerometer"] / 9.81, noise["gyro"]
        return tuple(value + self.np_random.normal(0.0, size, len(value)) for value, size in zip(exact, sizes))

    def _delayed(self) -> tuple[np.ndarray, ...]:
        """The readings that reach the policy now, between two of the past."""
        whole = int(self.delay)
        share = self.delay - whole
        return tuple(new + share * (old - new) for new, old in zip(self.readings[whole], self.readings[whole + 1]))


class Tracking:
    """Errors of the velocity averaged over a second, after the command has been held for one."""

    def __init__(self, steps: int) -> None:
        self.window, self.next, self.sum = np.zeros((steps, 3)), 0, np.zeros(3)
        self.steady, self.commanded, self.samples, self.error = 0, np.zeros(3), 0, np.zeros(2)

    def step(self, truth: Truth, commanded: np.ndarray, reached: bool) -> None:
        """Takes in a step; `reached`: the command is the desired velocity."""
        (a, b), (x, y, _) = heading(truth.rotation), truth.velocity
        velocity = np.array([a * x + b * y, a * y - b * x, truth.rotation[2] @ truth.turning])
        self.sum += velocity - self.window[self.next]
        self.window[self.next] = velocity
        self.next = (self.next + 1) % len(self.window)
        held = reached and np.array_equal(commanded, self.commanded)
        self.steady, self.commanded = self.steady + 1 if held else 0, commanded
        if self.steady >= len(self.window):
            error = commanded - self.sum / len(self.window)
            self.samples += 1
            self.error += math.hypot(error[0], error[1]), abs(error[2])

    def errors(self) -> dict[str, float]:
        """Mean errors, m/s and rad/s; not numbers if no command was held."""
        xy, yaw = self.error / self.samples if self.samples else (math.nan, math.nan)
        return {"error_xy_mps": float(xy), "error_yaw_radps": float(yaw)}
