"""Tabulates what DeepWalk's evaluation says of the default's seeds, or of other runs: python3 -m studies.seeds [FOLDER...] (in `python/`)

Reads the eval.json of each folder; of `runs/nimbro_op2x_omni/seed-*`, which `runs/nimbro_op2x_omni/make.sh` writes, without any. Nothing but Python's
standard library. Errors are means over the ten commands of the suite `falls`, gait the worst of those that move. A second table has the means
over what else was played: figure 7.8's commands, the grid's cells (whose largest components are listed apart), the random changes.
"""

import itertools
import json
import math
import statistics
import sys
from pathlib import Path

from studies.common import GAIT, ROOT

RUNS = ROOT / "runs" / "nimbro_op2x_omni"
STEP = 10.0
"""Of pushes, N."""


def goal(thesis: float) -> float:
    """What a push must reach: 1.5 times the thesis's figure, rounded up to a step, N."""
    return math.ceil(1.5 * thesis / STEP - 1e-9) * STEP


def pushes(rows: list[dict]) -> tuple[int, int]:
    """Goals of table 7.2 that are reached, of how many: all ten recovered, and any."""
    reached = [
        row[found] is not None and row[found] >= goal(row[thesis])
        for row in rows
        for found, thesis in (("all_ten_n", "thesis_all_ten_n"), ("max_n", "thesis_max_n"))
    ]
    return sum(reached), len(reached)


def conditions(result: dict, name: str) -> list[str]:
    """A row's cells for one of the two conditions; a dash where a suite has not been played."""
    suite = {key: result.get(key) for key in ("falls", "changes", "push")}
    if name == "nominal":
        suite = {key: value and value["nominal"] for key, value in suite.items()}
    falls, changes, push = suite["falls"], suite["changes"], suite["push"]
    cells = ["-"] * 5
    if falls:
        gait = [row["gait"] for row in falls["rows"] if any(row["command"])]
        error = [statistics.mean(row[key] for row in falls["rows"]) for key in ("error_xy_mps", "error_yaw_radps")]
        cells[0] = f"{falls['falls']} of {falls['episodes']}"
        cells[2] = f"{error[0]:.3f}, {error[1]:.3f}"
        worst = {key: choose(row[key] for row in gait) for key, choose in GAIT.items()}
        cells[4] = "{:.0f} %, {:.1f} /s, {:.2f} m/s".format(
            100 * worst["alternation"], worst["touchdowns_per_second"], worst["slip_mps"]
        )
    if changes:
        cells[1] = f"{changes['survived']} of {changes['total']}"
    if push:
        cells[3] = "{} of {}".format(*pushes(push["rows"]))
    return cells


def off(rows: list[dict]) -> str:
    """The mean errors of velocity and turn rate over rows, m/s and rad/s."""
    return ", ".join(f"{statistics.mean(row[key] for row in rows):.3f}" for key in ("error_xy_mps", "error_yaw_radps"))


def cells(grid: dict) -> list[dict]:
    """The grid's cells as rows, each with its command."""
    axes = [list(enumerate(grid[axis])) for axis in ("omega_z", "v_y", "v_x")]
    return [
        {"command": (x, y, turn), **{key: values[k][j][i] for key, values in grid["cells"].items()}}
        for (k, turn), (j, y), (i, x) in itertools.product(*axes)
    ]


def at_the_limit(cell: dict, grid: dict) -> int:
    """Along how many axes a cell's command is the grid's largest."""
    return sum(abs(value) == max(grid[axis]) for value, axis in zip(cell["command"], ("v_x", "v_y", "omega_z"), strict=True))


def others(result: dict, name: str) -> list[tuple[str, str, str]]:
    """Beside `falls`: what was played, its mean errors, how often it fell or failed."""
    tracking, changes = ((result.get(suite) or {}) for suite in ("tracking", "changes"))
    if name == "nominal":
        tracking, changes = tracking.get("nominal", {}), changes.get("nominal", {})
    found = []
    if tracking:
        rows, grid = tracking["rows"], tracking["grid"]
        sequences = sum(row["episodes"] for row in rows)
        found.append((f"figure 7.8's {len(rows)} commands", off(rows), f"{sum(row['falls'] for row in rows)} of {sequences}"))
        far = [cell for cell in cells(grid) if at_the_limit(cell, grid) >= 2]
        near = [cell for cell in cells(grid) if at_the_limit(cell, grid) < 2]
        for what, part in (("grid", far + near), ("of these the largest along two or three axes", far), ("the others", near)):
            fallen = f"{sum(row['falls'] for row in part):.0f} of {len(part) * grid['episodes']}"
            found.append((f"{what}, {len(part)} commands", off(part), fallen))
    if changes:
        found.append(("random changes", off([changes]), f"{changes['total'] - changes['survived']} of {changes['total']}"))
    return found


def main() -> None:
    runs = [Path(given) for given in sys.argv[1:]] or sorted(RUNS.glob("seed-*"))
    results = [(run.name.removeprefix("seed-"), json.loads((run / "eval.json").read_text())) for run in runs]
    print("| seed | conditions | falls | changes survived | error m/s, rad/s | push goals reached | gait: alternating, touchdowns, slip |")
    print("|---|---|---|---|---|---|---|")
    for seed, result in results:
        for name in ("randomised", "nominal"):
            print("| " + " | ".join([seed, name, *conditions(result, name)]) + " |")
    print("\n| seed | conditions | mean over | error m/s, rad/s | falls or failures |")
    print("|---|---|---|---|---|")
    for seed, result in results:
        for name in ("randomised", "nominal"):
            for row in others(result, name):
                print("| " + " | ".join([seed, name, *row]) + " |")


if __name__ == "__main__":
    main()
