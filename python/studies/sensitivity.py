"""How far a policy carries: the falls suite under one condition at a time, from easy to hard.

    cd python; python3 -m studies.sensitivity ../target/omni/seed-1 ../runs/nimbro_op2x_omni

Judges the run in rapier, two sequences of 30 s for each of the ten commands, everything else randomised as in the suites;
writes sensitivity.csv and sensitivity.svg into the second folder, prints the table, and goes on where it was stopped. Needs
`cargo build --release`; nothing but Python's standard library. Payload and weak motors are copies of the robot folder in a temporary
place.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from studies.common import ROOT, append, falls_suite, rows, svg

ROBOT = ROOT / "robots" / "nimbro_op2x"
JUDGED_WITH_SEED = "6000"
WORST = 0.3
"""Top of the picture's errors, m/s."""


def fixed(*keys: str):
    """Sets the keys, ranges of an episode's draws, to one value."""
    return lambda value: [f"--set={key}=[{value}, {value}]" for key in keys]


def latency(milliseconds: float) -> list[str]:
    return [f"--set=latency.{end}={milliseconds / 1e3}" for end in ("lower", "upper")]


def noise(factor: float) -> list[str]:
    deviations = {"gyro": 1e-4, "accelerometer": 1e-4, "position": 1e-3, "velocity": 1e-3}
    return [f"--set=noise.{key}={factor * value}" for key, value in deviations.items()]


CONDITIONS = {
    # name: (unit, values, options)
    "latency": ("ms", (0, 10, 20, 30, 40, 50, 60), latency),
    "friction": ("", (0.2, 0.3, 0.4, 0.6, 0.8, 1.0), fixed("friction.tangential")),
    "payload": ("kg", (0, 1, 2, 3), None),
    "noise": ("times the thesis's", (1, 10, 30, 100), noise),
    "motors": ("of their supply voltage", (1.0, 0.9, 0.8, 0.7, 0.6, 0.5), None),
}


def with_payload(robot: Path, mass: float) -> None:
    """A ball of `mass` kg and 10 cm radius, fixed to the trunk's frame."""
    file = robot / "nimbro_op2x.urdf"
    inertia = 0.4 * max(mass, 1e-6) * 0.1**2
    parts = (
        f'<link name="payload"><inertial><mass value="{max(mass, 1e-6)}"/><inertia ixx="{inertia}" ixy="0" ixz="0" '
        f'iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link>\n'
        '<joint name="payload" type="fixed"><parent link="trunk_link"/><child link="payload"/></joint>\n</robot>'
    )
    file.write_text(file.read_text().replace("</robot>", parts))


def with_weak_motors(robot: Path, share: float) -> None:
    """Every motor at `share` of its nominal voltage, which the controller does not know of: so much of its torque, speed and stiffness."""
    with (robot / "robot.toml").open("a") as file:
        file.write(f'\n[[effect]]\nid = "supply_voltage"\nmatch = ["*"]\nactual = {share}\nnominal = 1.0\n')


CHANGES = {"payload": with_payload, "motors": with_weak_motors}


def judge(run: Path, name: str, value: float) -> dict:
    """One row."""
    with tempfile.TemporaryDirectory() as folder:
        robot = Path(shutil.copytree(ROBOT, Path(folder) / ROBOT.name))
        options = ["--episodes", "2", "--seconds", "30", "--seed", JUDGED_WITH_SEED]
        if name in CHANGES:
            CHANGES[name](robot, value)
            options += ["--robot", str(robot)]
        else:
            options += CONDITIONS[name][2](value)
        return {"condition": name, "value": value, **falls_suite(run, Path(folder) / "falls.json", *options)}


def picture(table: list[dict]) -> str:
    """A panel a condition: survival (line) and velocity error (dashed)."""
    width, height, parts = 190, 150, []
    across = 80 + len(CONDITIONS) * (width + 30)
    for share in (0.0, 0.5, 1.0):
        y = 20 + height * (1 - share)
        parts.append(f'<text x="34" y="{y + 4:g}" text-anchor="end" fill="#1f497d">{share:g}</text>')
        parts.append(f'<text x="{across - 46}" y="{y + 4:g}" fill="#c0504d">{WORST * share:g}</text>')
    for k, (name, (unit, values, _)) in enumerate(CONDITIONS.items()):
        left, found = 40 + k * (width + 30), [row for row in table if row["condition"] == name]
        low, high = min(values), max(values)
        points = {"survival": [], "error": []}
        for row in found:
            x = left + width * (float(row["value"]) - low) / (high - low)
            points["survival"].append((x, 1 - int(row["falls"]) / int(row["sequences"])))
            if row["error_xy_mps"] != "":
                points["error"].append((x, min(float(row["error_xy_mps"]) / WORST, 1.0)))
        parts.append(f'<rect x="{left}" y="20" width="{width}" height="{height}" fill="none" stroke="#888"/>')
        parts.append(f'<text x="{left}" y="14">{name} {unit}</text>')
        for x, label in ((left, low), (left + width, high)):
            parts.append(f'<text x="{x}" y="{height + 36}" text-anchor="middle">{label:g}</text>')
        for style, line in (("#1f497d", points["survival"]), ('#c0504d" stroke-dasharray="4 3', points["error"])):
            path = " ".join(f"{x:.1f},{20 + height * (1 - y):.1f}" for x, y in line)
            parts.append(f'<polyline points="{path}" fill="none" stroke-width="2" stroke="{style}"/>')
    parts.append(f'<text x="40" y="{height + 56}">line: share that does not fall; dashed: velocity error, m/s</text>')
    return svg(across, height + 66, parts)


def markdown(table: list[dict]) -> str:
    """The table in Markdown."""
    lines = [
        "| condition | value | falls of 20 | error m/s | error rad/s | alternating, worst | touchdowns/s, largest | slip m/s, worst |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in table:
        alternating, taps, slip = (float(row[key]) for key in ("alternation", "touchdowns_per_second", "slip_mps"))
        errors = (row[key] for key in ("error_xy_mps", "error_yaw_radps"))
        errors = " | ".join(f"{float(error):.3f}" if error else "-" for error in errors)
        named = f"{row['condition']} {CONDITIONS[row['condition']][0]}".strip()
        gait = f"{100 * alternating:.0f} % | {taps:.1f} | {slip:.2f}"
        lines.append(f"| {named} | {float(row['value']):g} | {row['falls']} | {errors} | {gait} |")
    return "\n".join(lines)


def main() -> None:
    """Parses the command line and judges what is not finished."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("run", type=Path, help="run folder of the policy")
    parser.add_argument("out", type=Path, help="where table and picture go")
    arguments = parser.parse_args()
    table = arguments.out / "sensitivity.csv"
    for name, (_, values, _) in CONDITIONS.items():
        for value in values:
            if not any(row["condition"] == name and float(row["value"]) == value for row in rows(table)):
                append(table, judge(arguments.run.resolve(), name, value))
    print(markdown(rows(table)))
    (arguments.out / "sensitivity.svg").write_text(picture(rows(table)))


if __name__ == "__main__":
    main()
