"""An exported ONNX model is valid, says what the policy file says, and does step after step what the controller does."""

import json
import subprocess
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

import omniwalk
from omniwalk_reference.walker import SIGNS
from programs import ROOT, program

STEPS = 1000
# Two correct single-precision evaluations differ by some 1e-6; the bound is the one the project promises.
TOLERANCE = 1e-5

VARIANTS = {
    "default": [],
    "thesis": ["configs/thesis.toml"],
    "increments": [
        *("--set", "action.law=increment_on_target", "--set", "action.scale=0.1", "--set", "action.torque_clamp=false"),
        *("--set", "clock.symmetric=false", "--set", "clock.period=0.7", "--set", "ppo.activation=elu"),
    ],
    "offsets": [
        *("--set", "action.filter.kind=butterworth", "--set", "ppo.policy=gaussian", "--set", "ppo.activation=relu"),
    ],
    "plain": [
        *("--set", "action.law=increment_on_measured", "--set", "action.filter.enabled=false", "--set", "action.scale=0.2"),
    ],
}
"""Runs that differ in law, filter, clamp, clock, mirror, activation and distribution."""

@pytest.fixture(scope="module", params=VARIANTS)
def exported(request, tmp_path_factory) -> tuple[Path, Path]:
    """A hardly trained policy, as a policy file and as a model."""
    folder = tmp_path_factory.mktemp("exported")
    policy, model, run = folder / "policy.omni", folder / "policy.onnx", folder / "run"
    small = ["--steps", "160", "--quiet", "--set", "train.environments=4", "--set", "train.steps_per_update=20"]
    train = ["train", *VARIANTS[request.param], "--run", str(run), "--set", "ppo.hidden=[16]", *small]
    export = ["export", str(run), "--out", str(policy), "--onnx", str(model)]
    for command in (train, export):
        subprocess.run([*program("omniwalk"), *command], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return policy, model


def metadata(model: onnx.ModelProto) -> dict:
    return {entry.key: json.loads(entry.value) for entry in model.metadata_props}


class Runtime:
    """The model in its loop: every `next_x` of a step is the `x` of the next one."""

    def __init__(self, path: Path, nominal: np.ndarray):
        self.session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        shapes = {entry.name: entry.shape[1] for entry in self.session.get_inputs()}
        self.outputs = [entry.name for entry in self.session.get_outputs()]
        self.state = {name: np.zeros((1, shapes[name]), np.float32) for name in shapes.keys() - {"observation"}}
        self.state["previous_target"][:] = nominal

    def step(self, observation: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if "measured_position" in self.state:
            self.state["measured_position"][:] = position
        found = dict(zip(self.outputs, self.session.run(self.outputs, {"observation": observation[None], **self.state})))
        self.state["previous_target"] = found["target"]
        for name in self.state:
            if f"next_{name}" in found:
                self.state[name] = found[f"next_{name}"]
        return found["target"][0], found["action"][0]


def mirror(observation: np.ndarray, about: dict) -> np.ndarray:
    """The observation in the mirror, which is its own inverse."""
    joints = about["spec"]["symmetry"]
    of_joints, signs = [entry["joint"] for entry in joints], [entry["sign"] for entry in joints]
    found, first = [], 0
    for block in about["layout"]:
        entries = observation[first : first + block["len"]]
        first += block["len"]
        signed = SIGNS.get(block["name"])
        found.append(entries[of_joints] * signs if signed is None else entries * signed)
    return np.concatenate(found).astype(np.float32)


def readings(controller: omniwalk.Controller, random: np.random.Generator, size: float) -> dict:
    """Readings from what training saw to far beyond it, where bounds and normaliser clip."""
    n = len(controller.joints)
    share = random.random(n, np.float32)
    return {
        "position": controller.lower + share * (controller.upper - controller.lower),
        "velocity": (size * random.standard_normal(n)).astype(np.float32),
        "attitude": (0.3 * random.standard_normal(2)).clip(-0.5, 0.5).astype(np.float32),
        "gyro": (size * random.standard_normal(3)).astype(np.float32),
        "desired": random.uniform(-1.0, 1.0, 3).astype(np.float32),
        "base_velocity": (size * random.standard_normal(3)).astype(np.float32),
    }


def test_the_targets_are_those_of_the_controller_over_a_thousand_steps(exported):
    policy, path = exported
    about = metadata(onnx.load(path))
    controller = omniwalk.Controller(policy)
    controller.reset(0.0)
    runtime, random = Runtime(path, controller.nominal), np.random.default_rng(1)
    targets, actions, mirrored = [], [], 0
    for k in range(STEPS):
        now = k * controller.period
        phase = runtime.state.get("clock_phase", np.zeros((1, 1)))[0, 0]
        given = readings(controller, random, 10.0 ** random.uniform(-1.0, 2.0))
        lost = k % 100 == 57
        if lost:
            # What is no number holds the targets, and the clock goes on.
            given["gyro"][1] = np.nan
        expected, status = controller.step(now, now, **given)
        assert (status.mode, status.fault) == (("holding", "not_finite") if lost else ("walking", None))
        observation = controller.observation.copy()
        if about["spec"]["symmetry"] and phase >= 0.5:
            observation, mirrored = mirror(observation, about), mirrored + 1
        if lost:
            observation[-1] = np.nan
        target, action = runtime.step(observation, given["position"])
        assert np.abs(target - expected).max() < TOLERANCE, f"step {k}"
        if not lost:
            assert np.abs(action - controller.action).max() < TOLERANCE, f"step {k}"
            targets.append(target)
            actions.append(action)
    assert np.ptp(actions, axis=0).min() > 1e-3 and np.ptp(targets, axis=0).min() > 1e-3, "the policy does something"
    assert mirrored > 400 or not about["spec"]["symmetry"]


def test_the_model_is_valid_and_takes_what_its_policy_remembers_and_no_more(exported):
    policy, path = exported
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    spec = metadata(model)["spec"]
    expected = {"observation", "previous_target"}
    if spec["action"]["torque_clamp"] or spec["action"]["law"] == "increment_on_measured":
        expected.add("measured_position")
    if spec["action"]["filter"]:
        expected |= {"filter_state", "filter_started"}
    if spec["clock"]:
        expected.add("clock_phase")
    assert {entry.name for entry in model.graph.input} == expected
    state = expected - {"observation", "previous_target", "measured_position"}
    assert {entry.name for entry in model.graph.output} == {"target", "action"} | {f"next_{name}" for name in state}


def test_rows_of_a_batch_are_robots_of_their_own(exported):
    _, path = exported
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    random = np.random.default_rng(2)
    given = {entry.name: random.random((5, entry.shape[1]), np.float32) for entry in session.get_inputs()}
    together = session.run(None, given)
    for row in range(5):
        alone = session.run(None, {name: values[row : row + 1] for name, values in given.items()})
        for one, all_ in zip(alone, together):
            assert np.abs(one[0] - all_[row]).max() < TOLERANCE


def test_the_metadata_are_those_of_the_policy(exported):
    policy, path = exported
    about = metadata(onnx.load(path))
    controller = omniwalk.Controller(policy)
    assert about["identity"]["steps"] == 160
    assert len(about["identity"]["config_hash"]) == 64
    assert about["spec"]["control_hz"] == controller.control_hz
    assert [joint["name"] for joint in about["spec"]["joints"]] == controller.joints
    for key in ("nominal", "lower", "upper", "kp", "kd"):
        assert np.allclose([joint[key] for joint in about["spec"]["joints"]], getattr(controller, key))
    assert sum(block["len"] for block in about["layout"]) == len(controller.observation_names)
