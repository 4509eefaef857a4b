"""What the tests share: files written by the Rust side."""

import subprocess
from pathlib import Path

import pytest

from programs import ROOT, program


def pytest_addoption(parser):
    parser.addoption("--pictures", metavar="DIR", help="keep the screenshots of the viewer in DIR")


@pytest.fixture(scope="session")
def sample_run(tmp_path_factory) -> Path:
    """A small run folder with one of every file that other programs read (see examples/sample_run.rs)."""
    folder = tmp_path_factory.mktemp("sample") / "run"
    command = [*program("sample_run"), str(folder)]
    subprocess.run(command, cwd=ROOT, check=True)
    return folder


@pytest.fixture(scope="session")
def trained_run(tmp_path_factory) -> Path:
    """A run that `omniwalk train` and `omniwalk eval` wrote; too short to have learned anything."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    small = [
        *("--set", "train.environments=4"),
        *("--set", "train.steps_per_update=20"),
        *("--set", "ppo.hidden=[16]"),
        *("--set", "eval.commands=[[0.2, 0.0, 0.0]]"),
    ]
    train = ["train", "--run", str(folder), "--steps", "160", "--engine", "lanes", "--quiet", *small]
    for command in (train, ["eval", str(folder), "--episodes", "1", "--seconds", "2"]):
        subprocess.run([*program("omniwalk"), *command], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return folder
