"""The cross-check in small: the walk of the repository transfers to MuJoCo, what never learned does not, and training chooses
among its checkpoints."""

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from omniwalk import crosscheck
from programs import ROOT, program

TRAINED = ROOT / "runs/nimbro_op2x_omni/policy.omni"
SHORT = ["--gate", "closed_loop", "--episodes", "1", "--seconds", "4"]


def call(*arguments) -> subprocess.CompletedProcess:
    """`omniwalk` with the MuJoCo of this interpreter."""
    command = [*program("omniwalk"), *map(str, arguments), "--python", sys.executable]
    return subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)


def test_a_walk_that_was_learned_transfers(tmp_path: Path) -> None:
    result = call("crosscheck", TRAINED, *SHORT, "--suite", "commands,falls", "--out", tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    report = json.loads((tmp_path / "crosscheck.json").read_text())
    gate = report["gates"]["closed_loop"]
    assert report["pass"] and gate["pass"]
    assert gate["mujoco"]["sequences"] == gate["rapier"]["sequences"] == 6 + 10
    # Another physics, not the same one twice.
    assert gate["mujoco"]["error_xy_mps"] != gate["rapier"]["error_xy_mps"]
    page = (tmp_path / "crosscheck.html").read_text()
    assert "PASS" in page and "http" not in page.replace("http://www.w3.org", "")


def test_the_second_reader_and_the_physics_agree(tmp_path: Path) -> None:
    result = call("crosscheck", TRAINED, "--gate", "network,physics", "--out", tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    gates = json.loads((tmp_path / "crosscheck.json").read_text())["gates"]
    assert gates["network"]["max_abs_error"] < 1e-5
    checks = {check["check"]: check for check in gates["physics"]["checks"]}
    # Two programs that agree to the last bit would be one.
    assert all(check["found"] > 0 for name, check in checks.items() if not name.startswith("observation"))
    for engine in ("lanes", "rapier"):
        assert any(name.startswith(f"{engine}: dropped") for name in checks)


EFFECTS = {
    "backlash": 'match = ["*_knee_pitch", "*_ankle_*"]\ngap = 0.01',
    "elasticity": 'match = ["*_knee_pitch", "*_hip_*"]\ncompliance = 0.002',
    "sensor_offset": 'match = ["*_hip_pitch"]\noffset = 0.02',
    "payload": 'match = ["trunk_link"]\nmass = 1.5\nx = 0.05',
}
"""One of a joint, one of a link with couplings in it, one of encoders and one of bodies."""


def with_effects(folder: Path, effects: list[str]) -> Path:
    """The robot with `effects`."""
    robot = folder / "robot"
    shutil.copytree(ROOT / "robots/nimbro_op2x", robot)
    with (robot / "robot.toml").open("a") as file:
        for effect in effects:
            file.write(f'\n[[effect]]\nid = "{effect}"\n{EFFECTS[effect]}\n')
    return robot


def gates_of(result: subprocess.CompletedProcess, folder: Path) -> dict:
    """The gates of a cross-check into `folder`, failed ones among them."""
    assert result.returncode in (0, 1), result.stderr
    return json.loads((folder / "crosscheck.json").read_text())["gates"]


def test_a_robot_with_effects_and_soles_that_were_guessed_moves_as_in_mujoco(tmp_path: Path) -> None:
    robot = with_effects(tmp_path, list(EFFECTS))
    toml = robot / "robot.toml"
    toml.write_text(re.sub(r"\[\[foot\]\]\n(?:\w.*\n)*", "", toml.read_text()))
    run = tmp_path / "run"
    small = ["--set", "train.environments=4", "--set", "train.steps_per_update=20", "--set", "ppo.hidden=[16]"]
    train = ["train", "--run", run, "--steps", "160", "--quiet", "--set", f"robot.path={str(robot)!r}", *small]
    subprocess.run([*program("omniwalk"), *map(str, train)], cwd=ROOT, check=True)
    result = call("crosscheck", run, "--gate", "physics", "--out", tmp_path)
    physics = gates_of(result, tmp_path)["physics"]
    assert physics["pass"] and "dropped from 2 cm" in result.stdout, result.stdout
    assert {name.split()[0] for name in physics["left_out"]} == EFFECTS.keys() - {"payload"}


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_robot_with_effects_walks_as_in_mujoco(tmp_path: Path, effect: str) -> None:
    robot = with_effects(tmp_path, [effect])
    result = call("crosscheck", TRAINED, "--robot", robot, *SHORT, "--suite", "commands", "--out", tmp_path)
    # A single sequence of each command says nothing of errors; a walk that falls apart does.
    for gate in ("closed_loop", "closed_loop_lanes"):
        mujoco = gates_of(result, tmp_path)[gate]["mujoco"]
        assert mujoco["survived"] == mujoco["sequences"], result.stdout


def test_the_printed_model_has_real_stiffness_and_names_what_it_lacks(tmp_path: Path) -> None:
    robot = tmp_path / "robot"
    shutil.copytree(ROOT / "robots/nimbro_op2x", robot)
    print_model = [sys.executable, "-m", "omniwalk_reference", "mjcf", str(robot), "--legs"]
    gain = re.compile('name="left_ankle_roll" joint="left_ankle_roll" kp="([^"]*)"')
    run = lambda: subprocess.run(print_model, cwd=ROOT / "python", check=True, capture_output=True, text=True)
    before = run()
    assert not before.stderr and "<pair" in before.stdout
    with (robot / "robot.toml").open("a") as file:
        file.write('\n[[joint]]\nmatch = ["left_ankle_roll"]\nkp_scale = 0.8\n')
        file.write('\n[[effect]]\nid = "backlash"\nmatch = ["left_ankle_roll"]\ngap = 0.01\n')
    after = run()
    stiffness = [float(gain.search(model.stdout)[1]) for model in (before, after)]
    assert stiffness[1] == pytest.approx(0.8 * stiffness[0])
    for said in (after.stdout, after.stderr):
        assert "ot in this model: backlash (left_ankle_roll)" in said


def test_a_policy_that_falls_fails_with_exit_code_one(trained_run: Path, tmp_path: Path) -> None:
    # Its soles sink in by more than that.
    falls = ["--set", "task.min_height=0.9999", "--engine", "lanes", "--suite", "commands", "--out", str(tmp_path)]
    assert crosscheck.main([str(trained_run), *SHORT, *falls]) == 1
    gate = json.loads((tmp_path / "crosscheck.json").read_text())["gates"]["closed_loop"]
    assert gate["pass"] is False and gate["engine"] == "lanes"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same training without and with a cross-check beside it."""
    folder = tmp_path_factory.mktemp("transfer")
    small = [
        *("--steps", "320", "--engine", "lanes", "--quiet", "--set", "train.environments=4"),
        *("--set", "train.steps_per_update=20", "--set", "ppo.hidden=[16]"),
        *("--set", "eval.commands=[[0.0, 0.0, 0.0]]"),
        # Whoever falls at once is measured soon.
        *("--set", "task.min_height=0.9999"),
    ]
    alone, beside = folder / "alone", folder / "beside"
    subprocess.run([*program("omniwalk"), "train", "--run", alone, *small], cwd=ROOT, check=True)
    result = call("train", "--run", beside, *small, "--crosscheck-every", "160")
    assert result.returncode == 0 and "warning" not in result.stderr, result.stderr
    return alone, beside


def test_training_is_not_changed_by_what_measures_it(runs: tuple[Path, Path]) -> None:
    alone, beside = (load_file(run / "checkpoints/step-000000000320.safetensors") for run in runs)
    assert alone.keys() == beside.keys()
    for name, tensor in alone.items():
        # The trainer's own counters have the wall time among them.
        assert name == "progress" or np.array_equal(tensor, beside[name]), name


def test_the_checkpoint_that_transfers_best_is_kept_and_exported(runs: tuple[Path, Path], tmp_path: Path) -> None:
    run = runs[1]
    with open(run / "crosscheck.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    # The last one always; those before as far as the background has kept up.
    assert rows[-1]["step"] == "320"
    order = lambda row: (float(row["transfer/survival_mujoco"]), -float(row["transfer/error_xy_mps_mujoco"] or "inf"))
    best = max(reversed(rows), key=order)
    kept = [path.name for path in (run / "crosscheck").glob("*.safetensors")]
    assert kept == [f"step-{int(best['step']):012}.safetensors"]
    out = tmp_path / "best.omni"
    export = [*program("omniwalk"), "export", run, "--best-transfer", "--out", out]
    said = subprocess.run(export, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert f"step {best['step']}," in said and out.exists()


def test_the_transfer_is_among_tensorboards_scalars(runs: tuple[Path, Path]) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(runs[1]))
    events.Reload()
    assert events.Scalars("transfer/survival_mujoco")[-1].step == 320
