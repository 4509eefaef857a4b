"""The policy of the repository walks in both engines."""

import json
import math
import subprocess
import sys
from pathlib import Path
from statistics import variance

from programs import ROOT, program

WALK = ROOT / "runs/nimbro_op2x_omni/policy.omni"

EPISODES = range(4)
"""Seeds, one episode of every command each."""


def test_a_policy_walks_in_lanes_as_in_rapier(tmp_path: Path) -> None:
    """It falls in neither, and velocity errors differ by no more than those of policies trained with other seeds do in rapier
    (`docs/performance.md`), and what is left to chance by few episodes: two standard errors of the difference."""
    file = tmp_path / "figures.json"
    options = ["--suite", "falls", "--episodes", "1", "--seconds", "6", "--seeds", *map(str, EPISODES), "--json", str(file)]
    comparison = [sys.executable, "python/compare_engines.py", str(WALK), "--omniwalk", *program("omniwalk"), *options]
    subprocess.run(comparison, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    trained = json.loads((ROOT / "docs/measured/omni.json").read_text())
    spreads = {tuple(row["command"]): row["error_xy_mps"]["spread"] for row in trained}
    for row in json.loads(file.read_text()):
        falls, error = row["falls"], row["error_xy_mps"]
        assert not any(falls["rapier"] + falls["lanes"]), row
        chance = 2 * math.sqrt((variance(error["rapier"]) + variance(error["lanes"])) / len(EPISODES))
        assert abs(error["difference"]) <= spreads[tuple(row["command"])] + chance, row
