"""The safetensors package reads a checkpoint."""

import json

import numpy as np
from safetensors import safe_open


def test_a_checkpoint_is_a_safetensors_file(sample_run):
    names = sorted(path.name for path in (sample_run / "checkpoints").iterdir())
    assert names == ["step-000000000700.safetensors", "step-000000000800.safetensors"]
    with safe_open(sample_run / "checkpoints" / names[-1], framework="numpy") as file:
        header = json.loads(file.metadata()["omniwalk"])
        weight, step = file.get_tensor("actor.0.weight"), file.get_tensor("optimiser.step")
    assert (header["step"], header["metadata"]) == (800, {"seed": 7})
    expected = np.array([[0.5, -1.0, 0.25], [2.0, 0.0, 1e-3]], dtype=np.float32)
    assert weight.dtype == np.float32 and np.array_equal(weight, expected)
    assert step.dtype == np.uint64 and step.shape == () and step == 8
