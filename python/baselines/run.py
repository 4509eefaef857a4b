"""Every run of the comparison: those that take the least time first, what is finished passed over, what was begun gone on with.

    python3 -m baselines.run --work DIR

in `python/`. May be stopped at any time and called again. A finished run's curve and summary go to docs/measured/baselines.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from . import files, settings
from .settings import Variant


def command(variant: Variant, seed: int, steps: int, work: Path) -> list[str]:
    """The command of one run."""
    module = {"omniwalk": "baselines.ours", "sb3": "baselines.sb3"}[variant.learner]
    words = [sys.executable, "-m", module, "--settings", variant.settings, "--seed", str(seed), "--steps", str(steps)]
    return words + (["--world", variant.world] if variant.learner == "sb3" else []) + ["--work", str(work)]


class Queue:
    """Runs, some of them at a time."""

    def __init__(self, work: Path, results: Path, steps: int) -> None:
        self.work, self.results, self.steps = work, results, steps
        self.running: set[subprocess.Popen] = set()
        self.stopped = False

    def run(self, variant: Variant, seed: int) -> str | None:
        """Does one run; what went wrong."""
        name = f"{variant.name}-{seed}"
        summary = self.results / f"{name}.json"
        if summary.exists() or self.stopped:
            return None
        folder = self.work / name
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "log.txt").open("a") as log:
            words = command(variant, seed, self.steps, folder)
            # A group of its own, so that it is ended with all processes it starts; no session, which would have a priority of its own.
            process = subprocess.Popen(words, stdout=log, stderr=log, process_group=0)
            self.running.add(process)
            code = process.wait()
            self.running.discard(process)
        if code != 0:
            return None if self.stopped else f"{name} ended with {code}: {folder / 'log.txt'}"
        files.write(self.results / f"{name}.csv", (folder / "curve.csv").read_text())
        files.write(summary, (folder / "result.json").read_text())
        print(f"{name} is finished", flush=True)
        return None

    def stop(self) -> None:
        """Ends what runs; nothing is begun any more."""
        self.stopped = True
        for process in list(self.running):
            os.killpg(process.pid, signal.SIGTERM)


def main() -> None:
    """Parses the command line and runs."""
    parser = argparse.ArgumentParser(prog="python -m baselines.run", description=__doc__.splitlines()[0])
    names = [variant.name for variant in settings.VARIANTS]
    parser.add_argument("--work", type=Path, required=True, help="folder for the runs and their checkpoints")
    parser.add_argument("--results", type=Path, default=settings.RESULTS, help="where finished curves go (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=settings.STEPS)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(settings.SEEDS))
    parser.add_argument("--variants", nargs="+", choices=names, default=names)
    parser.add_argument("--jobs", type=int, default=2, help="runs at a time (default: %(default)s)")
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    with (given.work / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sys.exit(f"{given.work}: another call is at work here")
        queue = Queue(given.work, given.results, given.steps)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: queue.stop())
        chosen = [variant for variant in settings.VARIANTS if variant.name in given.variants]
        with ThreadPoolExecutor(given.jobs) as pool:
            runs = [pool.submit(queue.run, variant, seed) for variant in chosen for seed in given.seeds]
            problems = [run.result() for run in runs]
    problems = [problem for problem in problems if problem]
    if problems:
        sys.exit("\n".join(problems))


if __name__ == "__main__":
    main()
