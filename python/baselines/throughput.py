"""Steps a second of each learner, simulation and update together, measured in turns: on a machine whose speed changes with what else
runs, neighbours in time are compared.

    python3 -m baselines.throughput                  rounds over all
    python3 -m baselines.throughput --once NAME      one measurement, added to those there are

in `python/`. Policies are untrained, so episodes are short and starts of episodes are part of it. The program is that of the
environment variable OMNIWALK, or target/release/omniwalk.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from . import files, settings

CASES = {variant.name: (variant.learner, variant.world, variant.settings) for variant in settings.VARIANTS}
CASES |= {"omniwalk-rapier": ("omniwalk", "rapier", "shipped"), "sb3-rapier-ours": ("sb3", "rapier", "ours")}
"""What is measured: learner, world, settings."""

STEPS = {"lanes": 400_000, "rapier": 60_000}
"""Control steps of a measurement of ours: some ten seconds."""


def measure(name: str) -> float:
    """Steps a second, on all cores."""
    learner, world, chosen = CASES[name]
    return _ours(world, chosen) if learner == "omniwalk" else _sb3(world, chosen)


def _ours(world: str, chosen: str) -> float:
    """Between the first update of a training and the last."""
    from . import ours

    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        command = ours.command(run, chosen, seed=1, steps=STEPS[world], threads=os.cpu_count() or 1, engine=world)
        subprocess.run(command, cwd=settings.ROOT, check=True, stdout=subprocess.DEVNULL)
        with (run / "metrics.csv").open() as file:
            rows = list(csv.DictReader(file))
    first, last = rows[0], rows[-1]
    return (int(last["step"]) - int(first["step"])) / (float(last["seconds"]) - float(first["seconds"]))


def _sb3(world: str, chosen: str) -> float:
    """Whole updates, after a step of each robot."""
    import torch
    from stable_baselines3 import PPO

    from . import sb3

    cores = os.cpu_count() or 1
    # Beside processes that step robots a second thread of PyTorch, which waits busily, makes everything slower.
    torch.set_num_threads(1 if world == "mujoco" else cores)
    given = settings.sb3(chosen)
    envs = sb3.wrapped(sb3.robots(world, given["robots"], cores), given)
    model = PPO("MlpPolicy", envs, seed=1, device="cpu", **given["ppo"])
    envs.reset()
    envs.step([envs.action_space.sample() for _ in range(given["robots"])])
    begun = time.perf_counter()
    # One update is 16,384 steps of theirs and 8,192 of ours.
    model.learn(16_384)
    rate = model.num_timesteps / (time.perf_counter() - begun)
    envs.close()
    return rate


def main() -> None:
    """Parses the command line and measures."""
    parser = argparse.ArgumentParser(prog="python -m baselines.throughput", description=__doc__.splitlines()[0])
    parser.add_argument("--once", choices=list(CASES), metavar="NAME", help="a single measurement: " + ", ".join(CASES))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=settings.RESULTS / "throughput.json")
    given = parser.parse_args()
    if given.once is None:
        for _ in range(given.rounds):
            for name in CASES:
                words = ["--once", name, "--out", str(given.out)]
                subprocess.run([sys.executable, "-m", "baselines.throughput", *words], check=True)
        return
    rate = measure(given.once)
    found = json.loads(given.out.read_text()) if given.out.exists() else {"cores": os.cpu_count(), "steps_per_second": {}}
    found["steps_per_second"].setdefault(given.once, []).append(round(rate, 1))
    files.write(given.out, json.dumps(found, indent=2) + "\n")
    print(f"{given.once}: {rate:.0f} steps/s", flush=True)


if __name__ == "__main__":
    main()
