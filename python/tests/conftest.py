"""What the tests share: files written by the Rust side."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def sample_run(tmp_path_factory) -> Path:
    """A small run folder with one of every file that other programs read (see examples/sample_run.rs)."""
    folder = tmp_path_factory.mktemp("sample") / "run"
    command = ["cargo", "run", "--quiet", "--release", "--example", "sample_run", "--", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True)
    return folder
