"""Tabulates what DeepWalk's evaluation says of the default's seeds, or of other runs: python3 -m studies.seeds [FOLDER...] (in `python/`)

Reads the eval.json of each folder; of `runs/nimbro_op2x_omni/seed-*`, which `runs/nimbro_op2x_omni/make.sh` writes, without any. Nothing but Python's
standard library. Errors are means over the ten commands of the suite `falls`, gait the worst of those that move.
"""

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


def main() -> None:
    print("| seed | conditions | falls | changes survived | error m/s, rad/s | push goals reached | gait: alternating, touchdowns, slip |")
    print("|---|---|---|---|---|---|---|")
    for folder in [Path(given) for given in sys.argv[1:]] or sorted(RUNS.glob("seed-*")):
        result = json.loads((folder / "eval.json").read_text())
        for name in ("randomised", "nominal"):
            print("| " + " | ".join([folder.name.removeprefix("seed-"), name, *conditions(result, name)]) + " |")


if __name__ == "__main__":
    main()
