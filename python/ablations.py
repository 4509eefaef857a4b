"""Trains the default with one thing changed at a time and tabulates what each change does.

    python3 python/ablations.py run      # trains and judges what is not finished yet, one run at a time; stop and go on at will
    python3 python/ablations.py table    # docs table and picture from runs/ablations/results.csv

Needs `cargo build --release`; nothing but Python's standard library. Each run is 6 M steps, three seeds a variant.
Judged by the mode in rapier under the suites' randomised conditions: the ten commands of the falls suite, two
sequences of 60 s each. A finished run is a row of results.csv; runs themselves go to target/ablations.
"""

import argparse
import csv
import json
import os
import statistics
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HERE = ROOT / "runs" / "ablations"
RESULTS = HERE / "results.csv"
RUNS = ROOT / "target" / "ablations"
OMNIWALK = os.environ.get("OMNIWALK", str(ROOT / "target" / "release" / "omniwalk"))
STEPS = 6_000_000
SEEDS = (1, 2, 3)
JUDGED_WITH_SEED = 4000

BLOCKS = [
    "joint_position", "joint_velocity", "attitude", "gyro",
    "velocity_inertial", "velocity_base", "desired_velocity", "commanded_velocity",
]
"""The observation of the thesis (7.3.1)."""

VARIANTS = {
    # name: (what it tests, configuration, changes)
    "default": ("", None, {}),
    "thesis": ("the thesis as written", "configs/thesis.toml", {}),
    "no-scheduler": ("claim: the velocity scheduler", None, {"curriculum.scheduler": False}),
    "gaussian": ("claim: Beta instead of Gaussian", None, {"ppo.policy": "gaussian"}),
    "no-velocity-factor": ("claim: C_v", None, {"curriculum.velocity_start": 1.0}),
    "no-clearance": ("claim: foot clearance", None, {"reward.foot_weight": 0.0, "curriculum.velocity_gate_foot": 0.0}),
    "no-core": ("claim: the core velocity", None, {"curriculum.core": [0.0, 0.0, 0.0]}),
    "no-previous-target": ("ours: last targets observed", None, {"observation.blocks": BLOCKS}),
    "no-clock": ("ours: phase clock", None, {"clock.enabled": False, "clock.symmetric": False, "reward.clock_swing": False}),
    "no-symmetry": ("ours: symmetric policy", None, {"clock.symmetric": False}),
    "slow-clock": ("ours: 0.6 s for two steps; here 0.8 s", None, {"clock.period": 0.8}),
    "increments": ("ours: offsets from the nominal pose", None, {"action.law": "increment_on_measured", "action.scale": 0.1}),
    "no-action-filter": ("ours: low-pass on the action", None, {"action.filter.enabled": False}),
    "no-torque-clamp": ("ours: targets within the actuators' reach", None, {"action.torque_clamp": False}),
    "frame-heading": ("ours: inertial term along the commanded heading", None, {"reward.commanded_heading": False}),
    "no-velocity-filter": ("ours: low-pass in the velocity term", None, {"reward.velocity_filter": 0.0}),
    "no-slip-term": ("ours: slip penalty", None, {"reward.slip_weight": 0.0}),
    "no-pushes": ("ours: pushes", None, {"push.enabled": False}),
    "no-mass-randomisation": ("ours: masses and centre of mass varied", None, {"randomise.mass": 0.0, "randomise.centre_of_mass": 0.0}),
    "no-gate": ("ours: curriculum gated on performance", None, {"curriculum.gated": False}),
    "fixed-rate": ("ours: learning rate adapts", None, {"ppo.schedule": {"type": "fixed"}}),
    "mirror-samples": ("not ours: mirrored samples instead of symmetry", None, {"clock.symmetric": False, "train.mirror": True}),
}

COLUMNS = [
    "variant", "seed", "steps", "train_seconds", "falls", "sequences", "error_xy_mps", "error_yaw_radps",
    "alternation", "slip_mps", "touchdowns_per_second",
]


def toml(value) -> str:
    """A value as `--set` takes it."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items()) + "}"
    return json.dumps(value)


def train(variant: str, seed: int) -> Path:
    """Trains, or goes on with, one run; returns its folder."""
    run = RUNS / f"{variant}-{seed}"
    if run.exists():
        command = [OMNIWALK, "train", "--resume", "--run", run, "--steps", STEPS]
    else:
        _, config, changes = VARIANTS[variant]
        command = [OMNIWALK, "train", *([config] if config else []), "--run", run, "--seed", seed, "--steps", STEPS]
        for key, value in changes.items():
            command += ["--set", f"{key}={toml(value)}"]
    subprocess.run([*map(str, command), "--quiet"], cwd=ROOT, check=True)
    return run


def judge(run: Path) -> dict:
    """Plays the falls suite; the figures of a row, gait measures the worst of the commands that move."""
    file = run / "falls.json"
    subprocess.run(
        [OMNIWALK, "eval", str(run), "--suite", "falls", "--episodes", "2", "--seed", str(JUDGED_WITH_SEED), "--json", str(file)],
        cwd=ROOT, check=True, stdout=subprocess.DEVNULL,
    )
    rows = json.loads(file.read_text())["falls"]["rows"]
    moving = [row["gait"] for row in rows if any(row["command"])]

    def worst(key, choose):
        values = [gait[key] for gait in moving if gait[key] is not None]
        return round(choose(values), 4) if values else ""

    def mean(key):
        values = [row[key] for row in rows if row[key] is not None]
        return round(statistics.mean(values), 4) if values else ""

    return {
        "falls": sum(row["falls"] for row in rows),
        "sequences": sum(row["episodes"] for row in rows),
        "error_xy_mps": mean("error_xy_mps"),
        "error_yaw_radps": mean("error_yaw_radps"),
        "alternation": worst("alternation", min),
        "slip_mps": worst("slip_mps", max),
        "touchdowns_per_second": worst("touchdowns_per_second", max),
    }


def seconds(run: Path) -> tuple[int, float]:
    """Steps and wall time of a run, from the last row of its metrics."""
    with (run / "metrics.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    return int(last["step"]), round(float(last["seconds"]))


def finished() -> list[dict]:
    """The rows there are."""
    if not RESULTS.exists():
        return []
    with RESULTS.open() as file:
        return list(csv.DictReader(file))


def run(only: list[str]) -> None:
    """Everything that is not finished, seed by seed, so that what there is can be compared at any time."""
    for seed in SEEDS:
        for variant in only or VARIANTS:
            if any(row["variant"] == variant and int(row["seed"]) == seed for row in finished()):
                continue
            folder = train(variant, seed)
            steps, time = seconds(folder)
            row = {"variant": variant, "seed": seed, "steps": steps, "train_seconds": time, **judge(folder)}
            rows = [*finished(), row]
            HERE.mkdir(parents=True, exist_ok=True)
            draft = RESULTS.with_suffix(".draft")
            with draft.open("w", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS)
                writer.writeheader()
                writer.writerows(rows)
            draft.replace(RESULTS)
            print(row, flush=True)


def table() -> None:
    """Prints the table in Markdown and draws `runs/ablations/ablations.svg`."""
    groups: dict[str, list[dict]] = {}
    for row in finished():
        groups.setdefault(row["variant"], []).append(row)
    print("| variant | tests | seeds | falls | error m/s | error rad/s | alternating, worst | slip m/s, worst |")
    print("|---|---|---|---|---|---|---|---|")
    for variant, rows in groups.items():
        def spread(key, digits, rows=rows):
            values = [float(row[key]) for row in rows if row[key] != ""]
            if not values:
                return "-"
            if len(values) == 1:
                return f"{values[0]:.{digits}f}"
            return f"{statistics.median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"

        falls = sum(int(row["falls"]) for row in rows)
        sequences = sum(int(row["sequences"]) for row in rows)
        print(
            f"| {variant} | {VARIANTS[variant][0]} | {len(rows)} | {falls} of {sequences} | {spread('error_xy_mps', 3)} | "
            f"{spread('error_yaw_radps', 3)} | {spread('alternation', 2)} | {spread('slip_mps', 2)} |"
        )
    (HERE / "ablations.svg").write_text(picture(groups))


def picture(groups: dict[str, list[dict]]) -> str:
    """Share of falls as bars and velocity error as points, one line a variant, as SVG."""
    line, left, width = 22, 190, 300
    height = line * (len(groups) + 2)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + 2 * width + 60}" height="{height}" font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{left}" y="15">share of sequences that fall</text>',
        f'<text x="{left + width + 30}" y="15">velocity error, m/s (a point a seed, 0 to 0.3)</text>',
    ]
    for k, (variant, rows) in enumerate(groups.items()):
        y = line * (k + 1.5)
        share = sum(int(row["falls"]) for row in rows) / sum(int(row["sequences"]) for row in rows)
        parts.append(f'<text x="{left - 8}" y="{y + 4}" text-anchor="end">{variant}</text>')
        parts.append(f'<rect x="{left}" y="{y - 6}" width="{share * width:.1f}" height="12" fill="#c0504d"/>')
        for row in rows:
            if row["error_xy_mps"] != "":
                x = left + width + 30 + min(float(row["error_xy_mps"]) / 0.3, 1.0) * width
                parts.append(f'<circle cx="{x:.1f}" cy="{y}" r="4" fill="#1f497d" fill-opacity="0.6"/>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runner = commands.add_parser("run", help="train and judge what is not finished")
    runner.add_argument("variants", nargs="*", help="only these")
    commands.add_parser("table", help="Markdown table and picture")
    arguments = parser.parse_args()
    if arguments.command == "run":
        unknown = set(arguments.variants) - set(VARIANTS)
        if unknown:
            parser.error(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(VARIANTS)}")
        run(arguments.variants)
    else:
        table()


if __name__ == "__main__":
    main()
