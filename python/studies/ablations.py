"""Trains the default with one thing changed at a time and tabulates what each change does.

    cd python; python3 -m studies.ablations run      # trains and judges what is not finished yet, one run at a time; stop and go on at will
    python3 -m studies.ablations table    # docs table and picture from runs/ablations/results.csv
    python3 -m studies.ablations full     # the three closest to the default, in full, into runs/ablations/full

Needs `cargo build --release`; nothing but Python's standard library. Each run is 6 M steps, three seeds a variant.
Judged by the mode in rapier under the suites' randomised conditions: the ten commands of the falls suite, two
sequences of 60 s each. A finished run is a row of results.csv; runs themselves go to target/ablations. In full means as
many steps as the configuration says, and judged like the default's own seeds (`runs/nimbro_op2x_omni/make.sh`).
"""

import argparse
import csv
import json
import math
import shutil
import statistics
import subprocess
from pathlib import Path

from studies.common import OMNIWALK, ROOT, append, falls_suite, rows, svg

RESULTS = ROOT / "runs" / "ablations" / "results.csv"
RUNS = ROOT / "target" / "ablations"
STEPS = 6_000_000
SEEDS = (1, 2, 3)
JUDGED_WITH_SEED = "4000"
WORST = 0.4
"""Right edge of the picture's errors, m/s: about what standing is off by."""

FULL = RESULTS.with_name("full")
CLOSEST = 3
ERRORS = ("error_xy_mps", "error_yaw_radps")
FULL_SEED, FULL_JUDGED_WITH_SEED = 1, "9000"
"""As the reference run and its evaluation."""

BLOCKS = [
    "joint_position", "joint_velocity", "attitude", "gyro",
    "velocity_inertial", "velocity_base", "desired_velocity", "commanded_velocity",
]
"""The observation of the thesis (7.3.1)."""

TARGET, ERROR = "previous_target", "tracking_error"
"""What the default observes beyond it."""

INCREMENTS = {"action.law": "increment_on_measured", "action.scale": 0.1}
"""The action of the thesis (7.3.2)."""

VARIANTS = {
    # name: (what it tests, configuration, changes)
    "default": ("", None, {}),
    "thesis": ("the thesis as written", "configs/thesis.toml", {}),
    "thesis-no-filter": ("claim: 10 Hz Butterworth on the increment", "configs/thesis.toml", {"action.filter.enabled": False}),
    "no-scheduler": ("claim: the velocity scheduler", None, {"curriculum.scheduler": False}),
    "gaussian": ("claim: Beta instead of Gaussian", None, {"ppo.policy": "gaussian"}),
    "no-velocity-factor": ("claim: C_v", None, {"curriculum.velocity_start": 1.0}),
    "no-clearance": ("claim: foot clearance", None, {"reward.foot_weight": 0.0, "curriculum.velocity_gate_foot": 0.0}),
    "no-core": ("claim: the core velocity", None, {"curriculum.core": [0.0, 0.0, 0.0]}),
    "no-previous-target": ("ours: last targets observed", None, {"observation.blocks": [*BLOCKS, ERROR]}),
    "no-tracking-error": ("ours: mean tracking error observed", None, {"observation.blocks": [*BLOCKS, TARGET]}),
    "no-clock": ("ours: phase clock", None, {"clock.enabled": False, "clock.symmetric": False, "reward.clock_swing": False}),
    "no-symmetry": ("ours: symmetric policy", None, {"clock.symmetric": False}),
    "slow-clock": ("ours: 0.5 s for two steps; here 0.8 s", None, {"clock.period": 0.8}),
    "increments": ("ours: offsets from the nominal pose", None, INCREMENTS),
    "increments-butterworth": ("as increments, through the thesis's filter", None, {**INCREMENTS, "action.filter.kind": "butterworth"}),
    "increments-no-filter": ("as increments, through none", None, {**INCREMENTS, "action.filter.enabled": False}),
    "no-action-filter": ("ours: low-pass on the action", None, {"action.filter.enabled": False}),
    "no-torque-clamp": ("ours: targets within the actuators' reach", None, {"action.torque_clamp": False}),
    "frame-heading": ("ours: inertial term along the commanded heading", None, {"reward.commanded_heading": False}),
    "no-velocity-filter": ("ours: low-pass in the velocity term", None, {"reward.velocity_filter": 0.0}),
    "no-slip-term": ("ours: slip penalty", None, {"reward.slip_weight": 0.0}),
    "no-tap-term": ("ours: a price on touchdowns that do not alternate", None, {"reward.tap_weight": 0.0}),
    "no-pushes": ("ours: pushes", None, {"push.enabled": False}),
    "no-push-curriculum": ("ours: pushes that grow with the region", None, {"curriculum.push_start": 1.0}),
    "no-mass-randomisation": ("ours: masses and centre of mass varied", None, {"randomise.mass": 0.0, "randomise.centre_of_mass": 0.0}),
    "no-margin": ("ours: legs kept apart while training", None, {"task.overlap_margin": 0.0}),
    "no-gate": ("ours: curriculum gated on performance", None, {"curriculum.gated": False}),
    "no-mode-term": ("ours: the mode kept near the mean", None, {"ppo.mode_weight": 0.0}),
    "fixed-rate": ("ours: learning rate adapts", None, {"ppo.schedule": {"type": "fixed"}}),
    "no-dual-clip": ("ours: dual clip", None, {"ppo.dual_clip": 0.0}),
    "plain-commands": (
        "ours: commands at zero, along one axis, and new ones within an episode", None,
        {"command.zero_share": 0.0, "command.axis_share": 0.0, "command.resample_seconds": 0.0},
    ),
    "plain-starts": ("ours: first lengths and starting joints vary", None, {"task.random_first_length": False, "randomise.start_position": 0.0}),
    "mirror-samples": ("not ours: mirrored samples instead of symmetry", None, {"clock.symmetric": False, "train.mirror": True}),
}


def toml(value) -> str:
    """A value as `--set` takes it."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items()) + "}"
    return json.dumps(value)


def train(variant: str, seed: int, run: Path, steps: int | None) -> Path:
    """Trains, or goes on with, one run, `steps` long or as long as its configuration says; returns its folder."""
    length = ["--steps", steps] if steps else []
    if run.exists():
        command = [OMNIWALK, "train", "--resume", "--run", run, *length]
    else:
        _, config, changes = VARIANTS[variant]
        command = [OMNIWALK, "train", *([config] if config else []), "--run", run, "--seed", seed, *length]
        for key, value in changes.items():
            command += ["--set", f"{key}={toml(value)}"]
    subprocess.run([*map(str, command), "--quiet"], cwd=ROOT, check=True)
    return run


def effort(run: Path) -> dict:
    """Steps and wall time of a run, from the last row of its metrics."""
    with (run / "metrics.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    return {"steps": int(last["step"]), "train_seconds": round(float(last["seconds"]))}


def run(only: list[str]) -> None:
    """Everything that is not finished, seed by seed, so that what there is can be compared at any time."""
    for seed in SEEDS:
        for variant in only or VARIANTS:
            if any(row["variant"] == variant and int(row["seed"]) == seed for row in rows(RESULTS)):
                continue
            folder = train(variant, seed, RUNS / f"{variant}-{seed}", STEPS)
            judged = falls_suite(folder, folder / "falls.json", "--episodes", "2", "--seed", JUDGED_WITH_SEED)
            append(RESULTS, {"variant": variant, "seed": seed, **effort(folder), **judged})


def closest() -> list[str]:
    """The variants whose median errors are nearest to the default's, by their logarithms: nearest first. Those that are not finished, or
    that held no command in a seed, are not among them."""

    def known(group: list[dict]) -> bool:
        return len(group) == len(SEEDS) and all(row[key] != "" for row in group for key in ERRORS)

    groups = {name: group for name, group in by_variant().items() if known(group)}

    def errors(name: str) -> list[float]:
        return [math.log(statistics.median(float(row[key]) for row in groups[name])) for key in ERRORS]

    others = sorted(groups.keys() - {"default"}, key=lambda name: math.dist(errors(name), errors("default")))
    return others[:CLOSEST]


def full(only: list[str]) -> None:
    """The closest variants, or `only` those, in full: configuration, evaluation and thinned metrics of each, where not yet there."""
    for variant in only or closest():
        kept = FULL / variant
        if (kept / "eval.json").exists():
            continue
        folder = train(variant, FULL_SEED, RUNS / f"full-{variant}", None)
        command = [OMNIWALK, "eval", folder, "--suite", "falls,changes,push", "--seed", FULL_JUDGED_WITH_SEED]
        subprocess.run(list(map(str, command)), cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        kept.mkdir(parents=True, exist_ok=True)
        shutil.copy(folder / "config.toml", kept)
        metrics = (folder / "metrics.csv").read_text().splitlines(keepends=True)
        (kept / "metrics.csv").write_text("".join([metrics[0], *metrics[40::40]]))
        judged = (folder / "eval.json").read_text().replace(str(folder), variant)
        (kept / "eval.json").write_text(judged)


def by_variant() -> dict[str, list[dict]]:
    """The results so far."""
    groups: dict[str, list[dict]] = {}
    for row in rows(RESULTS):
        groups.setdefault(row["variant"], []).append(row)
    return groups


def spread(group: list[dict], key: str, digits: int) -> str:
    """Median and range over the seeds."""
    values = [float(row[key]) for row in group if row[key] != ""]
    if len(values) < 2:
        return "".join(f"{value:.{digits}f}" for value in values) or "-"
    return f"{statistics.median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def fallen(group: list[dict]) -> tuple[int, int]:
    """Falls and sequences over the seeds."""
    return sum(int(row["falls"]) for row in group), sum(int(row["sequences"]) for row in group)


def table() -> None:
    """Prints the table in Markdown and draws it beside the results."""
    print("| variant | tests | seeds | falls | error m/s | error rad/s | alternating, worst | slip m/s, worst |")
    print("|---|---|---|---|---|---|---|---|")
    for variant, group in by_variant().items():
        falls, sequences = fallen(group)
        columns = [
            variant, VARIANTS[variant][0], str(len(group)), f"{falls} of {sequences}",
            spread(group, "error_xy_mps", 3), spread(group, "error_yaw_radps", 3),
            spread(group, "alternation", 2), spread(group, "slip_mps", 2),
        ]
        print("| " + " | ".join(columns) + " |")
    RESULTS.with_name("ablations.svg").write_text(picture())


def picture() -> str:
    """Share of falls as bars and velocity error as points, one line a variant."""
    groups, line, left, width = by_variant(), 22, 190, 300
    right, bottom = left + width + 30, line * (len(groups) + 1.5)
    parts = [
        f'<text x="{left}" y="15">share of sequences that fall</text>',
        f'<text x="{right}" y="15">velocity error, m/s, a point a seed</text>',
    ]
    for x, top in ((left, 1.0), (right, WORST)):
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            at = x + share * width
            parts.append(f'<path d="M{at:g} 20V{bottom:g}" stroke="#ddd"/>')
            parts.append(f'<text x="{at:g}" y="{bottom + 14:g}" text-anchor="middle">{share * top:.2g}</text>')
    for k, (variant, group) in enumerate(groups.items()):
        y = line * (k + 1.5)
        falls, sequences = fallen(group)
        parts.append(f'<text x="{left - 8}" y="{y + 4}" text-anchor="end">{variant}</text>')
        parts.append(f'<rect x="{left}" y="{y - 6}" width="{falls / sequences * width:.1f}" height="12" fill="#c0504d"/>')
        for row in group:
            if row["error_xy_mps"] != "":
                x = right + min(float(row["error_xy_mps"]) / WORST, 1.0) * width
                parts.append(f'<circle cx="{x:.1f}" cy="{y}" r="4" fill="#1f497d" fill-opacity="0.6"/>')
    return svg(right + width + 30, line * (len(groups) + 2.5), parts)


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runner = commands.add_parser("run", help="train and judge what is not finished")
    runner.add_argument("variants", nargs="*", choices=[[], *VARIANTS], help="only these")
    commands.add_parser("table", help="Markdown table and picture")
    longer = commands.add_parser("full", help="the closest to the default in full, where not yet there")
    longer.add_argument("variants", nargs="*", choices=[[], *VARIANTS], help="these instead")
    arguments = parser.parse_args()
    if arguments.command == "run":
        run(arguments.variants)
    elif arguments.command == "full":
        full(arguments.variants)
    else:
        table()


if __name__ == "__main__":
    main()
