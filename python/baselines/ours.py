"""This project's own learner on the forward task: `omniwalk train`, and its table as a learning curve.

    python3 -m baselines.ours --settings equal --seed 1 --work DIR

in `python/`; the program is that of the environment variable OMNIWALK, or target/release/omniwalk. A run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
import subprocess
import time
from pathlib import Path

from omniwalk.common import toml
from studies.common import OMNIWALK

from . import files, settings

POLL_SECONDS = 0.5
"""How often the processor time is read: to so much of it the curve's is known."""


def curve(table: Path, clock: list[tuple[int, float]]) -> list[list]:
    """The rows of `metrics.csv` as a learning curve. `clock` holds how many rows there were, and the processor time then."""
    with table.open() as file:
        found = list(csv.DictReader(file))
    rows = []
    for number, row in enumerate(found, 1):
        seconds = next((seconds for count, seconds in clock if count >= number), clock[-1][1])
        mean = lambda key: round(float(row[key]), 5) if row[key] else ""
        fallen = sum(mean(f"episode/{end}") or 0.0 for end in ("fallen", "leg_overlap"))
        errors = [mean("tracking/error_xy_mps"), mean("tracking/error_yaw_radps")]
        means = [mean("episode/return"), mean("episode/steps"), round(fallen, 5), *errors]
        rows.append([row["step"], round(seconds, 2), *means])
    return rows


def command(run: Path, name: str, seed: int, steps: int, threads: int, engine: str = "lanes") -> list[str]:
    """The command that trains in the folder `run`."""
    changes = settings.EQUAL if name == "equal" else {}
    words = [OMNIWALK, "train", str(settings.CONFIG), "--run", str(run), "--seed", str(seed), "--steps", str(steps)]
    words += ["--threads", str(threads), "--engine", engine, "--quiet"]
    return words + [word for key, value in changes.items() for word in ("--set", f"{key}={toml(value)}")]


def train(work: Path, name: str, seed: int, steps: int, threads: int) -> None:
    """Trains, or goes on with, the run in `work`."""
    run, state_file = work / "run", work / "state.json"
    state = json.loads(state_file.read_text()) if state_file.exists() else {"calls": 0, "clock": [[0, 0.0]]}
    state["calls"] += 1
    words = command(run, name, seed, steps, threads)
    if any((run / "checkpoints").glob("*")):
        words.append("--resume")
    else:
        shutil.rmtree(run, ignore_errors=True)
    work.mkdir(parents=True, exist_ok=True)
    process = subprocess.Popen(words, cwd=settings.ROOT)
    table, before, now = run / "metrics.csv", state["clock"][-1][1], 0.0
    try:
        while process.poll() is None:
            now = files.processor_seconds([process.pid])
            lines = table.read_text().count("\n") - 1 if table.exists() else 0
            if lines > state["clock"][-1][0]:
                state["clock"].append([lines, before + now])
                files.write(state_file, json.dumps(state) + "\n")
            time.sleep(POLL_SECONDS)
    finally:
        process.terminate()
    if process.wait() != 0:
        raise SystemExit(f"omniwalk train ended with {process.returncode}")
    files.write_curve(work / "curve.csv", curve(table, state["clock"]))
    result = {
        "world": "lanes",
        "settings": name,
        "seed": seed,
        "steps": steps,
        "processor_seconds": round(before + now, 1),
        "calls": state["calls"],
    }
    files.write(work / "result.json", json.dumps(result, indent=2) + "\n")


def main() -> None:
    """Parses the command line and trains."""
    parser = argparse.ArgumentParser(prog="python -m baselines.ours", description=__doc__.splitlines()[0])
    parser.add_argument("--settings", choices=["shipped", "equal"], default="shipped")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=settings.STEPS)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--work", type=Path, required=True, help="the folder of the run")
    given = parser.parse_args()
    if not (given.work / "result.json").exists():
        train(given.work, given.settings, given.seed, given.steps, given.threads)


if __name__ == "__main__":
    main()
