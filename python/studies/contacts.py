"""What makes MuJoCo walk otherwise than the engines: gate 3 of the cross-check under one changed setting at a time.

    cd python; python3 -m studies.contacts contacts.csv --python ../target/python/bin/python

Walks ten commands, ten sequences of 10 s each with the same seeds, in rapier, lanes and MuJoCo; a row for each
setting, with the difference that it makes to MuJoCo's own error and that difference's standard error over the commands. Prints
the table, and goes on where it was stopped. Needs `cargo build --release` and a Python with MuJoCo.
"""

import argparse
import json
import os
import statistics
import subprocess
import tempfile
from pathlib import Path

from studies.common import OMNIWALK, ROOT, append, rows

POLICY = ROOT / "runs" / "nimbro_op2x_omni" / "policy.omni"
COMMANDS = "[[0,0,0],[0.3,0,0],[0.6,0,0],[-0.3,0,0],[0,0.3,0],[0,0.6,0],[0,-0.6,0],[0,0,0.3],[0,0,0.6],[0.3,0.3,0.3]]"

SETTINGS: dict[str, tuple[list[str], list[tuple[str, str]]]] = {
    # name: (what changes in all engines, what changes in MuJoCo's model alone)
    "as it is": ([], []),
    "no torsional friction": (["friction.torsional=[0,0]"], []),
    "no rolling friction": (["friction.rolling=[0,0]"], []),
    "neither": (["friction.torsional=[0,0]", "friction.rolling=[0,0]"], []),
    "steps of 1 ms": (["engine.physics_hz=1000"], []),
    "MuJoCo: contacts of 50 ms instead of 10 ms": ([], [('solref="0.01 1.0" density', 'solref="0.05 1.0" density')]),
    "MuJoCo: pyramidal cones": ([], [('cone="elliptic"', 'cone="pyramidal"')]),
    "MuJoCo: friction without slip between steps": ([], [("<option ", '<option noslip_iterations="20" ')]),
}

PATCH = """
import json, os, sys
# Importing MuJoCo starts interpreters, which must not do this too.
os.environ.pop("PYTHONPATH")
if any("omniwalk_reference" in word for word in sys.orig_argv):
    import mujoco
    from_text = mujoco.MjModel.from_xml_string
    def changed(text, *rest):
        for old, new in json.loads(os.environ["OMNIWALK_STUDY"]):
            assert old in text, old
            text = text.replace(old, new)
        return from_text(text, *rest)
    mujoco.MjModel.from_xml_string = staticmethod(changed)
"""
"""What Python runs before the cross-check's server."""


def walk(python: Path, settings: list[str], model: list[tuple[str, str]]) -> dict:
    """Gate 3 of all three engines."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "sitecustomize.py").write_text(PATCH)
        file = Path(folder) / "result.json"
        command = [OMNIWALK, "crosscheck", str(POLICY), "--gate", "closed_loop", "--suite", "commands"]
        command += ["--episodes", "10", "--seconds", "10", "--python", str(python), "--out", folder, "--json", str(file)]
        for setting in [f"eval.commands={COMMANDS}", *settings]:
            command += ["--set", setting]
        environment = {**os.environ, "PYTHONPATH": folder, "OMNIWALK_STUDY": json.dumps(model)}
        # FAIL, exit code 1, is a result too.
        done = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
        if done.returncode not in (0, 1):
            raise SystemExit(f"crosscheck ended with {done.returncode}")
        return json.loads(file.read_text())["gates"]


def errors(gates: dict, engine: str, kind: str) -> list[float]:
    """The error of each command in an engine; `kind` is xy_mps or yaw_radps."""
    gate = gates["closed_loop_lanes" if engine == "lanes" else "closed_loop"]
    return [row[f"error_{kind}"] for row in gate["details"][engine]["commands"]["rows"]]


def row(name: str, gates: dict, base: dict | None) -> dict:
    """A row of the table; `base` holds MuJoCo's errors as it is."""
    found = {"setting": name}
    for kind in ("xy_mps", "yaw_radps"):
        for engine in ("rapier", "lanes", "mujoco"):
            found[f"{engine}_{kind}"] = round(statistics.mean(errors(gates, engine, kind)), 5)
        ours = errors(gates, "mujoco", kind)
        changes = [now - then for now, then in zip(ours, base[kind] if base else ours)]
        found[f"change_{kind}"] = round(statistics.mean(changes), 5)
        found[f"change_se_{kind}"] = round(statistics.stdev(changes) / len(changes) ** 0.5, 5)
    found["mujoco_by_command"] = json.dumps({kind: errors(gates, "mujoco", kind) for kind in ("xy_mps", "yaw_radps")})
    return found


def markdown(table: list[dict]) -> str:
    """The table in Markdown."""
    lines = [
        "| setting | rapier m/s | lanes | MuJoCo | change | rapier rad/s | lanes | MuJoCo | change |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for found in table:
        cells = [found["setting"]]
        for kind in ("xy_mps", "yaw_radps"):
            cells += [f"{float(found[f'{engine}_{kind}']):.4f}" for engine in ("rapier", "lanes", "mujoco")]
            cells.append(f"{float(found[f'change_{kind}']):+.4f} ± {float(found[f'change_se_{kind}']):.4f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Parses the command line and walks what is not finished."""
    parser = argparse.ArgumentParser(prog="python -m studies.contacts", description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path, help="where the table grows")
    parser.add_argument("--python", type=Path, required=True, help="interpreter with MuJoCo")
    given = parser.parse_args()
    for name, (settings, model) in SETTINGS.items():
        table = rows(given.table)
        if any(found["setting"] == name for found in table):
            continue
        base = json.loads(table[0]["mujoco_by_command"]) if table else None
        append(given.table, row(name, walk(given.python.absolute(), settings, model), base))
    print(markdown(rows(given.table)))


if __name__ == "__main__":
    main()
