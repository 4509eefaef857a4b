"""Speed of MuJoCo on one core for a robot that moves: `python bench_mujoco.py ROBOT --physics-hz 200 --seconds 5`.

A batch of robots gets new random targets every 25 ms and starts over after a fall, as in `omniwalk bench env`.
`mujoco.batch` steps all of them in one call on the calling thread, so that Python costs little; how much is
measured by the same loop with the physics left out, printed and subtracted. Times are processor times, because
other work on the machine must not count.

Two sets of settings are measured side by side:

- `thesis`: the model as `omniwalk_reference.mjcf` writes it, with torsional and rolling friction and elliptic
  cones. The same physics as the project's engines; this is the one to compare with.
- `fastest`: sliding friction only (three dimensions a contact), pyramidal cones, no search for islands (there is
  one). Less physics than the project's engines have, but nobody can say that MuJoCo was held back.

Neither limits the solver's iterations, because contacts that have not converged are another simulation. Of the
other choices CG, PGS, the implicit and the discrete integrator are slower here than Newton with implicitfast (CG also
diverges now and then); Euler and a sparse Jacobian save 5 %, but Euler takes the servos' damping explicitly and
MuJoCo 4.0.0 factors the sparse Hessian wrongly.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch

from omniwalk_reference import mjcf
from omniwalk_reference.robot import Robot, load

CONTROL_HZ = 40.0
"""Rate of new targets, Hz (thesis 7.5)."""

TARGET_RANGE = 0.3
"""Targets are uniform within this distance of the nominal pose, rad (or m), and within the limits: a standard
deviation of 0.17 rad, that of random actions of 0.7 rad behind the default low-pass of the action."""

FALLEN_HEIGHT = 0.7
"""A robot has fallen when its base is lower than this share of its nominal height,"""

FALLEN_TILT = 0.7
"""or when its base's vertical axis is further than this off the vertical, rad. Both as the task has them by default."""

CELLS, CELL, AMPLITUDE = 256, 0.25, 0.02
"""A rough ground: cells a side, their side (m), and how far from zero heights are (m)."""


@dataclass
class Timing:
    """Processor time (s) of a number of policy steps, and falls on the way."""

    seconds: float = 0.0
    policy_steps: int = 0
    falls: int = 0


def on_rough_ground(xml: str, seed: int) -> mujoco.MjModel:
    """The model on a height field instead of the plane: that of `ground.kind = "rough"` with its default cells and amplitude, with
    heights of its own."""
    spec = mujoco.MjSpec.from_string(xml)
    heights = np.random.default_rng(seed).uniform(size=(CELLS + 1) ** 2)
    side = 0.5 * CELLS * CELL
    size = [side, side, 2 * AMPLITUDE, 1.0]
    spec.add_hfield(name="ground", nrow=CELLS + 1, ncol=CELLS + 1, size=size, userdata=heights.tolist())
    floor = spec.geom("floor")
    floor.type, floor.hfieldname, floor.pos = mujoco.mjtGeom.mjGEOM_HFIELD, "ground", [0, 0, -AMPLITUDE]
    return spec.compile()


class Bench:
    """`worlds` robots with their random targets and falls."""

    def __init__(
        self,
        robot: Robot,
        physics_hz: float,
        worlds: int,
        seed: int,
        settings: Callable[[mujoco.MjModel], None],
        rough: bool = False,
    ) -> None:
        xml = mjcf.write(robot, physics_hz)
        self.model = on_rough_ground(xml, seed) if rough else mujoco.MjModel.from_xml_string(xml)
        settings(self.model)
        self.substeps = round(physics_hz / CONTROL_HZ)
        self.floating = robot.floating
        self.batch = Batch(self.model, nsim=worlds, nthread=1)
        self.qpos, self.ctrl = self.batch.bind("qpos"), self.batch.bind("ctrl")
        self.random = np.random.default_rng(seed)
        self.nominal = self.model.key_ctrl[0]
        self.lower, self.upper = self._target_bounds(robot)
        self.batch.reset(keyframe=0)

    def _target_bounds(self, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the random targets; joints that no policy moves hold their nominal position."""
        joints = self.model.actuator_trnid[:, 0]
        names = [self.model.joint(j).name for j in joints]
        reach = np.where([name in robot.policy for name in names], TARGET_RANGE, 0.0)
        limits = np.where(self.model.jnt_limited[joints, None], self.model.jnt_range[joints], [-np.inf, np.inf])
        return np.maximum(self.nominal - reach, limits[:, 0]), np.minimum(self.nominal + reach, limits[:, 1])

    def fallen(self) -> np.ndarray:
        """Indices of the worlds whose robot lies, or whose state is not finite."""
        if not self.floating:
            return np.flatnonzero(~np.isfinite(self.qpos).all(axis=1))
        height, x, y = self.qpos[:, 2], self.qpos[:, 4], self.qpos[:, 5]
        cosine = 1 - 2 * (x * x + y * y)
        standing = (height > FALLEN_HEIGHT * self.model.key_qpos[0, 2]) & (cosine > np.cos(FALLEN_TILT))
        return np.flatnonzero(~standing)

    def run(self, policy_steps: int, physics: bool) -> Timing:
        """Runs so many policy steps of every world, with the physics or with all but the physics."""
        falls, start = 0, time.process_time()
        for _ in range(policy_steps):
            self.ctrl[:] = self.random.uniform(self.lower, self.upper, self.ctrl.shape)
            if physics:
                self.batch.step(nstep=self.substeps)
            fallen = self.fallen()
            if fallen.size:
                self.batch.reset(fallen, keyframe=0, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
                falls += fallen.size
        return Timing(time.process_time() - start, policy_steps * len(self.qpos), falls)


def thesis(model: mujoco.MjModel) -> None:
    """The model as it is."""


def fastest(model: mujoco.MjModel) -> None:
    """The least contact physics with which a robot still stands and walks."""
    model.geom_condim[:] = 3
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND


SETTINGS = {"thesis": thesis, "fastest": fastest}


@dataclass
class Run:
    """A bench with the time of its blocks, with physics and without."""

    bench: Bench
    full: Timing = field(default_factory=Timing)
    empty: Timing = field(default_factory=Timing)

    def block(self) -> None:
        """One second of every robot's life, then the same without physics."""
        for total, physics in ((self.full, True), (self.empty, False)):
            block = self.bench.run(round(CONTROL_HZ), physics)
            total.seconds += block.seconds
            total.policy_steps += block.policy_steps
            total.falls += block.falls

    def figures(self) -> dict[str, float]:
        """What came out: SI units but for the microseconds."""
        overhead = self.empty.seconds / self.empty.policy_steps
        per_policy_step = self.full.seconds / self.full.policy_steps - overhead
        return {
            "us_per_physics_step": 1e6 * per_policy_step / self.bench.substeps,
            "policy_steps_per_second": 1 / per_policy_step,
            "python_share": overhead / (per_policy_step + overhead),
            "seconds_between_falls": self.full.policy_steps / CONTROL_HZ / max(self.full.falls, 1),
        }


def measure(benches: dict[str, Bench], seconds: float) -> dict[str, dict[str, float]]:
    """Alternates between the benches until each has run for `seconds` of processor time."""
    runs = {name: Run(bench) for name, bench in benches.items()}
    for bench in benches.values():
        bench.run(round(CONTROL_HZ), physics=True)
    while min(run.full.seconds for run in runs.values()) < seconds:
        for run in runs.values():
            run.block()
    return {name: run.figures() for name, run in runs.items()}


def main() -> None:
    """Parses the command line, measures, prints."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("robot", type=Path, help="a robot folder")
    parser.add_argument("--physics-hz", type=float, default=200.0, help="default: %(default)g")
    parser.add_argument("--seconds", type=float, default=5.0, help="processor time of each measurement, s")
    parser.add_argument("--worlds", type=int, default=64, help="robots in the batch")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    arguments = parser.parse_args()
    if arguments.physics_hz % CONTROL_HZ:
        parser.error(f"--physics-hz must be a multiple of {CONTROL_HZ:g}")

    robot = load(arguments.robot)
    benches = {
        name: Bench(robot, arguments.physics_hz, arguments.worlds, arguments.seed, settings)
        for name, settings in SETTINGS.items()
    }
    results = measure(benches, arguments.seconds)
    print(f"mujoco {mujoco.__version__}, {arguments.worlds} worlds, one core, {arguments.physics_hz:g} Hz physics")
    for name, figures in results.items():
        print(
            f"{name:8} {figures['us_per_physics_step']:6.2f} us per physics step, "
            f"{figures['policy_steps_per_second']:6.0f} policy steps/s "
            f"(Python's {100 * figures['python_share']:.1f} % taken off; "
            f"{figures['seconds_between_falls']:.1f} s between falls)"
        )
    if arguments.json:
        record = {
            "engine": f"mujoco {mujoco.__version__}",
            "threads": 1,
            "environments": arguments.worlds,
            "physics_hz": arguments.physics_hz,
            **results["thesis"],
            "settings": results,
        }
        arguments.json.write_text(json.dumps(record, indent=2) + "\n")


if __name__ == "__main__":
    main()
