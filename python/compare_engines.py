"""The same policies in both engines: `python compare_engines.py RUN... --omniwalk target/release/omniwalk`.

Plays every policy by `omniwalk eval` in `rapier`, the engine of record, and in `lanes`, under the same conditions, and sets falls
and velocity errors of a command against how much they differ between the policies in `rapier`: seeds of one configuration, or,
for a single policy, seeds of its episodes (`--seeds`). The engines agree where their means differ by no more than that.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from statistics import mean

ENGINES = ("rapier", "lanes")
FIGURES = ("falls", "error_xy_mps")


def copied(policy: Path, folder: Path) -> Path:
    """The run or policy file in a folder of its own: an evaluation writes beside what it judges."""
    if policy.is_file():
        (folder / f"{policy.stem}.eval").mkdir()
        return Path(shutil.copy(policy, folder))
    return Path(shutil.copytree(policy, folder / policy.name, ignore=shutil.ignore_patterns("rollouts")))


def rows(arguments: argparse.Namespace, policy: Path, engine: str, seed: int) -> list[dict]:
    """What `omniwalk eval` says of every command."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rows.json"
        command = [str(arguments.omniwalk), "eval", str(copied(policy, Path(folder))), "--suite", arguments.suite]
        command += ["--engine", engine, "--seed", str(seed), "--episodes", str(arguments.episodes), "--json", str(file)]
        if arguments.seconds:
            command += ["--seconds", str(arguments.seconds)]
        result = subprocess.run(command, capture_output=True, text=True)
        if result.returncode:
            raise SystemExit(f"{' '.join(command)}\n{result.stderr}")
        return json.loads(file.read_text())[arguments.suite]["rows"]


def compare(plays: dict[str, list[list[dict]]]) -> list[dict]:
    """A row a command: every figure by engine and play, the spread over the plays in `rapier`, and whether the means differ by
    no more than it."""
    result = []
    for at, first in enumerate(plays["rapier"][0]):
        row = {"command": first["command"], "episodes": first["episodes"]}
        for figure in FIGURES:
            by_engine = {engine: [play[at][figure] for play in plays[engine]] for engine in ENGINES}
            spread = max(by_engine["rapier"]) - min(by_engine["rapier"])
            difference = mean(by_engine["lanes"]) - mean(by_engine["rapier"])
            row[figure] = by_engine | {"difference": difference, "spread": spread, "within": abs(difference) <= spread}
        result.append(row)
    return result


def main() -> None:
    """Parses the command line, plays, prints."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("policies", type=Path, nargs="+", help="run folders or policy files")
    parser.add_argument("--omniwalk", type=Path, default=Path("target/release/omniwalk"), help="the program")
    parser.add_argument("--suite", choices=("forward", "falls"), default="forward")
    parser.add_argument("--episodes", type=int, default=20, help="of each command, policy and seed")
    parser.add_argument("--seconds", type=float, help="of an episode, where it is not to be the suite's")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1000], help="of the episodes")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    arguments = parser.parse_args()

    plays = {
        engine: [rows(arguments, policy, engine, seed) for policy in arguments.policies for seed in arguments.seeds]
        for engine in ENGINES
    }
    table = compare(plays)
    print(f"{'command':22} {'falls in rapier':>18} {'in lanes':>18} {'error m/s in rapier':>24} {'in lanes':>24} {'within':>7}")
    for row in table:
        falls, error = row["falls"], row["error_xy_mps"]
        shown = [" ".join(map(str, falls[engine])) for engine in ENGINES]
        shown += [" ".join(f"{e:.3f}" for e in error[engine]) for engine in ENGINES]
        within = "yes" if falls["within"] and error["within"] else "no"
        print(f"{row['command']!s:22} {shown[0]:>18} {shown[1]:>18} {shown[2]:>24} {shown[3]:>24} {within:>7}")
    if arguments.json:
        arguments.json.write_text(json.dumps(table, indent=2) + "\n")


if __name__ == "__main__":
    main()
