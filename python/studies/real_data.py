"""Identifies what the models of measured machines lack, tabulates it and keeps a picture of the first log that was held out.

    OMNIWALK_SHARED=FOLDER python3 -m studies.real_data [RESULTS]     (in `python/`)

FOLDER holds the published logs that `docs/maps` is for, under `data/`. What is in RESULTS already
(`docs/measured/real-data` without it) is not done again; with all of it there no FOLDER is needed. Nothing but Python's
standard library.
"""

import base64
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from studies.common import OMNIWALK, ROOT

KEPT = (
    *("verdict", "nominal", "refit", "final", "noise_floor", "gap_closed", "accepted", "indistinguishable"),
    *("unexplained", "retuned", "heldout", "folds", "physics_hz"),
)
"""Keys of `report.json` that a result keeps."""


def header(log: Path) -> dict:
    """What a log of the servo benches says of itself."""
    return {key: value for key, value in json.loads(log.read_text()).items() if key != "entries"}


def cases(data: Path) -> dict[str, tuple[list[str], str, list[Path], list[Path]]]:
    """By name: robot and how it stands, column map, logs to fit, logs held out (none: `identify` sets some aside)."""
    xl330 = {log: header(log) for log in sorted((data / "bam_xl330").glob("*.json"))}
    sts3250 = {log: header(log) for log in sorted((data / "bam_sts3250").glob("*.json"))}

    def rig(name: str) -> list[str]:
        return ["--robot", str(ROOT / "robots" / name)]

    def split(logs: dict[Path, dict], out) -> tuple[list[Path], list[Path]]:
        return [log for log in logs if not out(logs[log])], [log for log in logs if out(logs[log])]

    found = {
        "xl330, gain 400 and slow swings held out": (
            *(rig("xl330_rig"), "bam_xl330.toml"),
            *split(xl330, lambda own: own["kp"] == 400 or own["trajectory"] == "up_and_down"),
        ),
        "xl330, gain 100 and drops held out": (
            *(rig("xl330_rig"), "bam_xl330.toml"),
            *split(xl330, lambda own: own["kp"] == 100 or own["trajectory"] == "lift_and_drop"),
        ),
    }
    for shape in sorted({own["trajectory"] for own in sts3250.values()}):
        logs = split(sts3250, lambda own, shape=shape: own["trajectory"] == shape)
        found[f"sts3250, {shape} held out"] = (rig("sts3250_rig"), "bam_sts3250.toml", *logs)
    found["emps, last quarter held out"] = (rig("emps"), "emps.toml", [data / "emps" / "DATA_EMPS.csv"], [])
    poppy = data / "poppy"
    robot = ["--robot", str(poppy / "poppy_humanoid.urdf"), "--stand"]
    found["poppy, last quarter held out"] = (robot, "poppy.toml", [poppy / "poppy_step_real.csv"], [])
    return found


def identify(robot: list[str], column_map: str, fit: list[Path], held_out: list[Path], picture: Path) -> dict:
    """The report of `omniwalk identify`, and how long it took; the first picture of its page goes to `picture`."""
    with tempfile.TemporaryDirectory() as folder:
        command = [OMNIWALK, "identify", *map(str, fit), *robot, "--out", folder]
        command += ["--map", str(ROOT / "docs" / "maps" / column_map)]
        command += ["--heldout", *map(str, held_out)] if held_out else []
        start = time.monotonic()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        report = json.loads((Path(folder) / "report.json").read_text())
        picture.write_bytes(first_picture((Path(folder) / "report.html").read_text()))
    return {"seconds": round(time.monotonic() - start), **{key: report[key] for key in KEPT}}


def first_picture(page: str) -> bytes:
    """The first picture of a page: measured and simulated motion in a log."""
    found = re.search(r'src="data:image/png;base64,([A-Za-z0-9+/=]+)"', page)
    assert found, "the page has no picture"
    return base64.b64decode(found.group(1))


def number(value: float | None) -> str:
    """A length or angle in thousandths."""
    return "-" if value is None else f"{1000 * value:.3g}"


def row(name: str, result: dict) -> str:
    """A result's row of the table."""
    named = [
        effect["effect"] + " " + ", ".join(f"{key} {value['value']:.3g}" for key, value in effect["parameters"].items())
        for effect in result["accepted"]
    ]
    named += ["one of " + "/".join(alike) for alike in result["indistinguishable"]]
    left = result["unexplained"]["depends_on"] if result["verdict"] == "unexplained" else []
    errors = [number(result[which]["heldout"]["rmse"].get("overall")) for which in ("nominal", "refit", "final")]
    closed = "-" if result["gap_closed"] is None else f"{100 * result['gap_closed']:.0f} %"
    cells = [name, result["verdict"], "; ".join(named) or "-", ", ".join(left) or "-", *errors]
    return "| " + " | ".join([*cells, number(result["noise_floor"]["value"]), closed]) + " |"


def main() -> None:
    results = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "measured" / "real-data"
    results.mkdir(parents=True, exist_ok=True)
    if "OMNIWALK_SHARED" in os.environ:
        for name, task in cases(Path(os.environ["OMNIWALK_SHARED"]) / "data").items():
            target = results / (name.replace(",", "").replace(" ", "-") + ".json")
            if target.exists():
                print(f"{target} is there already", file=sys.stderr)
            else:
                draft = target.with_suffix(".draft")
                result = identify(*task, target.with_suffix(".png"))
                draft.write_text(json.dumps({"name": name, **result}, indent=1) + "\n")
                draft.replace(target)
    print("| logs | verdict | missing | what is left depends on | nominal | re-tuned | final | floor | gap closed |")
    print("|---|---|---|---|---|---|---|---|---|")
    for file in sorted(results.glob("*.json")):
        result = json.loads(file.read_text())
        print(row(result.pop("name"), result))


if __name__ == "__main__":
    main()
