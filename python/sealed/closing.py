"""The whole loop, end to end: a policy walks in a world it was not trained for, its logs are identified, training goes on with the
robot that came out, and without it, and both walk there again.

Every stage leaves a file and is skipped where that is: it can be stopped and started again.
"""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

from . import loop
from .cases import ensure
from .generate import name_of
from .walk_case import ROBOT

MACHINE = "worn"

REPORTED = ["verdict", "accepted", "indistinguishable", "unexplained", "nominal", "refit", "final", "noise_floor", "gap_closed"]
"""Keys of `report.json` that a result keeps."""

STAGES = {"before": "as it was", "without": "trained on, nominal robot", "with": "trained on, identified robot"}
"""The policies that walk."""

GOING_ON = [
    # A policy that walks already needs no curriculum.
    *("curriculum.scheduler=false", "curriculum.velocity_start=1.0", "curriculum.foot_start=1.0"),
    # Play moves otherwise at longer steps; for both robots, so that the robot alone makes the difference.
    "engine.physics_hz=1000",
]
"""What training that goes on changes."""


@dataclass
class Closing:
    """What the loop is closed with."""

    program: list[str]
    """The command `omniwalk`."""
    run: Path
    """The run whose policy walks."""
    out: Path
    """Where logs, robots and runs are made."""
    steps: int
    """Of the training that goes on."""

    def world(self, seed: int, results: Path) -> None:
        """Closes the loop in the world of a seed; writes `results/worn-SEED.json`."""
        name = name_of(MACHINE, seed)
        target = results / f"{name}.json"
        if target.exists():
            print(f"{target} is there already", flush=True)
            return
        folder = self.out / name
        folder.mkdir(parents=True, exist_ok=True)
        policy = self._exported(self.run, folder / "before.omni")
        case = ensure(MACHINE, seed, self.out, policy)
        totals = {"before": self._walked(policy, seed, folder)}
        report = self._identified(case, folder)
        robots = {"without": ROBOT, "with": folder / "found" / "robot"}
        for stage, robot in robots.items():
            if not robot.exists():
                continue  # `identify` gave no answer
            run = self._trained(folder / stage, robot, seed)
            totals[stage] = self._walked(self._exported(run, folder / f"{stage}.omni"), seed, folder)
        results.mkdir(parents=True, exist_ok=True)
        content = {"seed": seed, "steps": self.steps, "report": report, "walks": totals}
        # Written whole or not at all.
        partial = target.with_suffix(".part")
        partial.write_text(json.dumps(content, indent=1) + "\n")
        partial.rename(target)

    def _call(self, *arguments: object) -> None:
        print(" ".join(["omniwalk", *map(str, arguments)]), flush=True)
        subprocess.run([*self.program, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)

    def _exported(self, run: Path, policy: Path) -> Path:
        if not policy.exists():
            self._call("export", run, "--out", policy)
        return policy

    def _walked(self, policy: Path, seed: int, folder: Path) -> dict:
        path = folder / f"walk-{seed:04d}-{policy.stem}.json"
        if not path.exists():
            loop.write(loop.play(policy, seed, machine=MACHINE), policy, seed, folder)
        return json.loads(path.read_text())["totals"]

    def _identified(self, case: Path, folder: Path) -> dict:
        found = folder / "found"
        path = found / "report.json"
        if not path.exists():
            fit, held_out = (sorted((case / part).glob("*.mcap")) for part in ("fit", "heldout"))
            try:
                self._call("identify", *fit, "--robot", case / "robot", "--heldout", *held_out, "--out", found)
            except subprocess.CalledProcessError:
                # That logs carry no answer, as of a robot that falls at once, is an answer.
                if not path.exists():
                    raise
        report = json.loads(path.read_text())
        return {key: report[key] for key in REPORTED if key in report}

    def _trained(self, run: Path, robot: Path, seed: int) -> Path:
        """Goes on from the run with a robot."""
        if (run / "done").exists():
            return run
        if run.exists():
            self._call("train", "--resume", "--run", run, "--quiet")
        else:
            changes = [*GOING_ON, f'robot.path="{robot.resolve()}"']
            sets = [part for change in changes for part in ("--set", change)]
            self._call("train", "--from", self.run, "--seed", seed, "--steps", self.steps, "--run", run, "--quiet", *sets)
        (run / "done").touch()
        return run


def table(results: Path) -> str:
    """A row a world and policy, as Markdown."""
    lines = ["| world | policy | falls | error m/s | error rad/s |", "|---|---|---|---|---|"]
    number = lambda value: "-" if value is None else f"{value:.3f}"
    for path in sorted(results.glob(f"{MACHINE}-*.json")):
        walks = json.loads(path.read_text())["walks"]
        for stage, title in STAGES.items():
            own = walks.get(stage)
            if own is None:
                lines.append(f"| {path.stem} | {title} | no answer | - | - |")
                continue
            errors = f"{number(own['velocity_error'])} | {number(own['turn_error'])}"
            lines.append(f"| {path.stem} | {title} | {own['falls']} of {own['walks']} | {errors} |")
    return "\n".join(lines)
