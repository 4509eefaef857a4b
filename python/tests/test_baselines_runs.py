"""Runs of Stable-Baselines3 in both worlds: stopped, gone on with, finished. Needs PyTorch: `./test --torch`."""

import json

import pytest

pytest.importorskip("torch", reason="`./test --torch` has PyTorch")
pytest.importorskip("stable_baselines3", reason="`./test --torch` has Stable-Baselines3")

from baselines import files, sb3, settings

ROBOTS, UPDATE = 2, 64


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Updates of a moment, with a checkpoint after each."""
    arguments = {"n_steps": UPDATE // ROBOTS, "batch_size": UPDATE, "n_epochs": 1, "policy_kwargs": {"net_arch": [8]}}
    chosen = {"robots": ROBOTS, "scale": 0.02, "clip": 10.0, "ppo": arguments}
    monkeypatch.setattr(settings, "sb3", lambda name: chosen)
    monkeypatch.setattr(sb3, "CHECKPOINT_SECONDS", 0.0)


class Stopped(Exception):
    """What stops a run."""


@pytest.mark.parametrize("world", ["lanes", "mujoco"])
def test_a_run_that_was_stopped_goes_on(tmp_path, monkeypatch, world):
    written, count = sb3.Progress._on_rollout_end, 0

    def stop(progress):
        nonlocal count
        written(progress)
        count += 1
        if count == 3:
            # Not yet learned from: this update is done again.
            raise Stopped

    with monkeypatch.context() as patch:
        patch.setattr(sb3.Progress, "_on_rollout_end", stop)
        with pytest.raises(Stopped):
            sb3.train(tmp_path, world, "ours", 1, 5 * UPDATE, 1)
    before = files.read_curve(tmp_path / "curve.csv")
    assert [int(row[0]) for row in before] == [UPDATE, 2 * UPDATE, 3 * UPDATE]
    assert not (tmp_path / "result.json").exists()
    sb3.train(tmp_path, world, "ours", 1, 5 * UPDATE, 1)
    after = files.read_curve(tmp_path / "curve.csv")
    assert [int(row[0]) for row in after] == [k * UPDATE for k in range(1, 6)]
    assert after[:2] == before[:2]
    seconds = [float(row[1]) for row in after]
    assert seconds == sorted(seconds) and seconds[-1] > seconds[1]
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["steps"], result["calls"], result["world"]) == (5 * UPDATE, 2, world)
