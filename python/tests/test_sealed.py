"""The sealed generator: deterministic by seed, independent of what it judges, truth apart from the logs."""

import ast
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from sealed import effects, generate, machine
from sealed.actuator import Bristle

# The walking machine stands on the reference, which is written from the documents.
PACKAGES = [Path(__file__).resolve().parents[1] / name for name in ("sealed", "omniwalk_reference")]
SECONDS = 1.2


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """A case of each machine on a stand, with its truth."""
    out = tmp_path_factory.mktemp("sealed")
    folders = [generate.generate(machine, 1, out, SECONDS) for machine in ("rig", "leg")]
    return out, folders


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def series(path: Path, topic: str) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and positions of a topic's messages."""
    messages = [item.ros_msg for item in read_ros2_messages(path, topics=[topic])]
    times = [message.header.stamp.sec + message.header.stamp.nanosec * 1e-9 for message in messages]
    return np.array(times), np.array([list(message.position) for message in messages])


def test_a_seed_makes_the_same_bytes_again(cases, tmp_path):
    out, folders = cases
    generate.generate("rig", 1, tmp_path, SECONDS)
    assert files(tmp_path / "cases" / folders[0].name) == files(folders[0])
    assert (tmp_path / "truth" / "rig-0001.json").read_bytes() == (out / "truth" / "rig-0001.json").read_bytes()


def test_nothing_of_omniwalk_is_imported():
    paths = [path for package in PACKAGES for path in package.rglob("*.py")]
    assert {path.parent for path in paths} == set(PACKAGES)
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, (ast.Import, ast.ImportFrom)) else []
            module = getattr(node, "module", None) or ""
            roots = {name.split(".")[0] for name in [*names, module]}
            assert "omniwalk" not in roots, path


def test_what_is_identified_does_not_hold_the_truth(cases):
    out, folders = cases
    for folder in folders:
        truth = json.loads((out / "truth" / f"{folder.name}.json").read_text())
        names = [effect["name"].encode() for effect in truth["case"]["effects"]]
        assert names
        for name, content in files(folder).items():
            assert not any(word in content or word.decode() in name for word in names), name


def test_logs_have_commands_jitter_and_repeats(cases):
    _, folders = cases
    times, positions = series(folders[0] / "fit" / "01-multisine.mcap", "/joint_states")
    steps = np.diff(times)
    assert 150 < 1 / steps.mean() < 210 and steps.std() > 1e-4 and steps.min() > 0
    counts = positions / (2 * np.pi / 4096)
    assert np.abs(counts - counts.round()).max() < 1e-6
    commanded, _ = series(folders[0] / "fit" / "01-multisine.mcap", "/joint_commands")
    assert 1 / np.diff(commanded).mean() == pytest.approx(100, rel=0.02)
    switched, on = series(folders[0] / "fit" / "03-steps.mcap", "/actuator_enabled")
    assert on[:, 0].tolist() == [1.0, 0.0] and switched[1] > switched[0]


def test_a_quarter_of_the_seeds_is_healthy_and_the_rest_walks_through_all_effects():
    draw = lambda seed: effects.draw_case(seed, np.random.default_rng(seed), ["hinge"], {"hinge": {}})
    drawn = [draw(seed) for seed in range(80)]
    kinds = [case.kind for case in drawn]
    assert kinds.count("none") == 20
    assert {effect.name for case in drawn if case.kind == "single" for effect in case.effects} == set(effects.INSIDE)
    outside = [case for case in drawn if case.kind == "outside"]
    assert {case.effects[0].name for case in outside} == set(effects.OUTSIDE)
    assert all(case.leading for case in outside)


def test_bristles_slide_at_the_level_of_friction_and_hold_below_it():
    bristle = Bristle(0.1)
    for _ in range(1000):
        sliding = bristle.torque(0.5, 0.1, 1e-3)
    assert sliding == pytest.approx(0.1, rel=1e-3)
    # Pushed with half of it, the joint moves by a fraction of the bristles' bend and stops.
    bristle, position, velocity = Bristle(0.1), 0.0, 0.0
    for _ in range(8000):
        velocity += (0.05 - bristle.torque(velocity, 0.1, 2.5e-4)) / 0.01 * 2.5e-4
        position += velocity * 2.5e-4
    assert abs(velocity) < 1e-4 and position < 1.5e-3


def test_motions_go_round_where_more_logs_are_asked_for(tmp_path):
    folder = generate.generate("rig", 1, tmp_path, 0.5, count=len(generate.FIT) + 1)
    names = sorted(log.stem for log in (folder / "fit").glob("*.mcap"))
    assert [name[3:] for name in names] == [*generate.FIT, generate.FIT[0]]


def test_a_rotor_loads_its_joint_and_not_what_carries_it():
    def masses(rotors: dict[str, float]) -> tuple[mujoco.MjModel, np.ndarray]:
        """The mass matrix about a bent pose."""
        model = mujoco.MjModel.from_xml_string(leg.mjcf(1e-3, rotors, {}))
        data = mujoco.MjData(model)
        data.qpos[:] = 0.3
        mujoco.mj_forward(model, data)
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
        return model, matrix

    leg = machine.leg(lambda low, high: 0.5 * (low + high))
    armature = leg.joint("knee").servo.armature
    model, split = masses({"knee": armature})
    _, whole = masses({})
    rotor = int(model.joint("knee_rotor").dofadr[0])
    knee = int(model.joint("knee").dofadr[0])
    beside = np.delete(split[rotor], rotor)
    assert split[rotor, rotor] == pytest.approx(armature, rel=1e-4) and np.abs(beside).max() < 1e-3 * armature
    rest = np.delete(np.delete(split, rotor, 0), rotor, 1)
    at = knee - (knee > rotor)
    rest[at, at] += armature
    assert np.abs(rest - whole).max() < 1e-3 * armature
