"""What the studies share: the program, tables that grow by a row, the falls suite as figures."""

import csv
import json
import os
import statistics
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
OMNIWALK = os.environ.get("OMNIWALK", str(ROOT / "target" / "release" / "omniwalk"))

GAIT = {"alternation": min, "slip_mps": max, "touchdowns_per_second": max}
"""Gait measures, and which value over the commands that move is the worst."""

FIGURES = ["falls", "sequences", "error_xy_mps", "error_yaw_radps", *GAIT]
"""What `falls_suite` gives."""


def rows(table: Path) -> list[dict]:
    """The rows of a table there are."""
    if not table.exists():
        return []
    with table.open() as file:
        return list(csv.DictReader(file))


def append(table: Path, row: dict) -> None:
    """Adds a row; whoever stops the program finds the table whole, with it or without."""
    table.parent.mkdir(parents=True, exist_ok=True)
    draft = table.with_suffix(".draft")
    with draft.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        writer.writeheader()
        writer.writerows([*rows(table), row])
    draft.replace(table)
    print(row, flush=True)


def falls_suite(run: Path, file: Path, *options: str) -> dict:
    """Plays the falls suite of the run's policy in rapier, randomised, with its result in `file`; the mean errors over its
    commands and the worst gait of those that move."""
    command = [OMNIWALK, "eval", str(run), "--suite", "falls", "--json", str(file), *options]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    found = json.loads(file.read_text())["falls"]["rows"]
    moving = [row["gait"] for row in found if any(row["command"])]

    def of(values, choose):
        known = [value for value in values if value is not None]
        return round(choose(known), 4) if known else ""

    return {
        "falls": sum(row["falls"] for row in found),
        "sequences": sum(row["episodes"] for row in found),
        "error_xy_mps": of([row["error_xy_mps"] for row in found], statistics.mean),
        "error_yaw_radps": of([row["error_yaw_radps"] for row in found], statistics.mean),
        **{key: of([gait[key] for gait in moving], choose) for key, choose in GAIT.items()},
    }


def svg(width: float, height: float, parts: list[str]) -> str:
    """A picture of `parts` on white."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
        'font-family="sans-serif" font-size="12">'
    )
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *parts, "</svg>"]) + "\n"
