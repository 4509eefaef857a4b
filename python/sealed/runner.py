"""Runs `omniwalk identify` over cases, one after the other; what is done is skipped, and what was begun goes on, so that it can be
stopped at any time.

The truth is never opened here.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from pathlib import Path

from . import cases

KEPT = [
    *("verdict", "nominal", "refit", "final", "noise_floor", "gap_closed", "accepted", "indistinguishable"),
    "unexplained",
]
"""Keys of `report.json` that a result keeps."""


def run(chosen: list[tuple[str, int]], program: list[str], out: Path, results: Path, limit: float) -> None:
    """Identifies the chosen cases, whose files are under `out`, with `program`; a case may take `limit` s."""
    results.mkdir(parents=True, exist_ok=True)
    for machine, seed in chosen:
        target = results / f"{machine}-{seed:04d}.json"
        if target.exists():
            print(f"{target} is there already", flush=True)
            continue
        found = out / "found" / target.stem
        result = identify(cases.ensure(machine, seed, out), program, found, limit)
        write(target, result)
        shutil.rmtree(found, ignore_errors=True)
        print(f"{target.stem}: {result['report'].get('verdict', 'no report')} in {result['seconds']:.0f} s", flush=True)


def baseline(chosen: list[tuple[str, int]], program: list[str], out: Path, results: Path) -> None:
    """Fits every effect at once to the chosen cases that have a result, and puts its errors there; what is done is skipped."""
    for machine, seed in chosen:
        target = results / f"{machine}-{seed:04d}.json"
        result = json.loads(target.read_text()) if target.exists() else {}
        if not result.get("report") or "all_effects" in result["report"]:
            continue
        case = cases.ensure(machine, seed, out)
        start = time.monotonic()
        folders = [str(case / part) for part in ("robot", "fit", "heldout")]
        done = subprocess.run([*program, *folders], capture_output=True, text=True, check=True)
        result["baseline_seconds"] = time.monotonic() - start
        result["report"]["all_effects"] = json.loads(done.stdout)
        write(target, result)
        print(f"{target.stem}: every effect at once in {result['baseline_seconds']:.0f} s", flush=True)


def write(target: Path, result: dict) -> None:
    """Writes a result whole or not at all."""
    partial = target.with_suffix(".part")
    partial.write_text(json.dumps(result, indent=1) + "\n")
    partial.rename(target)


def identify(case: Path, program: list[str], found: Path, limit: float) -> dict:
    """Exit code, duration and report of one identification into `found`, where one that was interrupted goes on: `resumed`, and the
    duration is that of the last go."""
    fit, held_out = (sorted(str(log) for log in (case / part).glob("*.mcap")) for part in ("fit", "heldout"))
    command = [*program, "identify", *fit, "--robot", str(case / "robot"), "--out", str(found), "--heldout", *held_out]
    resumed = (found / "unfinished").exists()
    start = time.monotonic()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
        code, said = done.returncode, done.stderr[-2000:]
    except subprocess.TimeoutExpired:
        code, said = None, f"more than {limit:.0f} s"
    seconds = time.monotonic() - start
    path = found / "report.json"
    report = json.loads(path.read_text()) if path.exists() else {}
    kept = {key: report[key] for key in KEPT if key in report}
    return {"code": code, "seconds": seconds, "resumed": resumed, "report": kept, "said": "" if code == 0 else said}
