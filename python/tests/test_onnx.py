"""An exported ONNX model is valid, says what the policy file says, and does what the controller does."""

import json
import subprocess
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

from programs import ROOT, program

ROWS = 1000
# Two correct single-precision evaluations differ by some 1e-6; the bound is the one the project promises.
TOLERANCE = 1e-5


@pytest.fixture(scope="module")
def exported(trained_run, tmp_path_factory) -> tuple[Path, Path]:
    """The policy of a run, as a policy file and as a model."""
    folder = tmp_path_factory.mktemp("exported")
    policy, model = folder / "policy.omni", folder / "policy.onnx"
    export = ["export", str(trained_run), "--out", str(policy), "--onnx", str(model)]
    subprocess.run([*program("omniwalk"), *export], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return policy, model


def controller(policy: Path, observations: np.ndarray, joints: int) -> np.ndarray:
    """Actions of the Rust controller for each row."""
    given, found = policy.with_suffix(".observations"), policy.with_suffix(".actions")
    given.write_bytes(observations.astype("<f4").tobytes())
    subprocess.run([*program("policy_actions"), str(policy), str(given), str(found)], cwd=ROOT, check=True)
    return np.frombuffer(found.read_bytes(), "<f4").reshape(len(observations), joints)


def test_the_model_is_valid_and_does_what_the_controller_does(exported):
    policy, path = exported
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    metadata = {entry.key: json.loads(entry.value) for entry in model.metadata_props}
    spec = metadata["spec"]
    width = sum(block["len"] for block in metadata["layout"])
    joints = len(spec["joints"])

    random = np.random.default_rng(1)
    # From what training saw to far beyond it, where bounds and normaliser clip.
    size = np.geomspace(0.1, 100.0, ROWS)[:, None]
    observations = (size * random.standard_normal((ROWS, width))).astype(np.float32)

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    action, displacement = session.run(["action", "displacement"], {"observation": observations})
    expected = controller(policy, observations, joints)
    assert np.ptp(expected, axis=0).min() > 1e-3, "the policy does something"
    assert np.abs(action - expected).max() < TOLERANCE
    scale = np.array([joint["action_scale"] for joint in spec["joints"]])
    assert np.abs(displacement - scale * (2.0 * expected - 1.0)).max() < 2.0 * TOLERANCE


def test_the_metadata_are_those_of_the_policy(exported, trained_run):
    _, path = exported
    metadata = {entry.key: json.loads(entry.value) for entry in onnx.load(path).metadata_props}
    assert metadata["identity"]["steps"] == 160
    assert len(metadata["identity"]["config_hash"]) == 64
    assert metadata["spec"]["control_hz"] == 40.0
    names = [block["name"] for block in metadata["layout"]]
    assert names[:2] == ["joint_position", "joint_velocity"] and names[-1] == "clock"
    assert {"nominal", "lower", "upper", "kp", "kd", "name"} <= set(metadata["spec"]["joints"][0])
