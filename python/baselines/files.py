"""Curves and checkpoints: files that are whole, whenever the program that writes them is stopped."""

from __future__ import annotations

import csv
import json
import os
import shutil
from pathlib import Path

COLUMNS = ["steps", "processor_seconds", "return", "length", "fallen", "error_xy_mps", "error_yaw_radps"]
"""Of a learning curve, a row an update: control steps of all robots, processor time of all processes (s), and means over the last
hundred episodes: sum of rewards, control steps, share that fell or had legs overlap, errors of the velocity where it was held."""


def write(path: Path, text: str) -> None:
    """Writes `text` to `path`, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(text)
    draft.replace(path)


def write_curve(path: Path, rows: list[list]) -> None:
    """Writes a learning curve."""
    write(path, "\n".join([",".join(COLUMNS), *(",".join(map(str, row)) for row in rows)]) + "\n")


def read_curve(path: Path) -> list[list[str]]:
    """The rows of a learning curve; none if there is no file."""
    if not path.exists():
        return []
    with path.open() as file:
        return list(csv.reader(file))[1:]


def save(folder: Path, fill) -> None:
    """Replaces the checkpoint `folder`: `fill(draft)` writes its files and returns the state, which says that it is whole."""
    draft = folder.with_name(folder.name + ".draft")
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    write(draft / "state.json", json.dumps(fill(draft)) + "\n")
    shutil.rmtree(folder, ignore_errors=True)
    draft.rename(folder)


def load(folder: Path) -> dict | None:
    """The state of the checkpoint `folder`, of which a draft that is whole is the newer; `None` without any."""
    draft = folder.with_name(folder.name + ".draft")
    if (draft / "state.json").exists():
        shutil.rmtree(folder, ignore_errors=True)
        draft.rename(folder)
    state = folder / "state.json"
    return json.loads(state.read_text()) if state.exists() else None


def processor_seconds(processes: list[int]) -> float:
    """Processor time of running processes so far, s; Linux says it in /proc."""
    ticks = 0
    for process in processes:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")
