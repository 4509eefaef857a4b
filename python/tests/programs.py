"""The Rust side's programs and examples, built with the same packages and features as `cargo test --workspace` builds
them: what it has compiled is not compiled again."""

import json
import subprocess
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@cache
def executables() -> dict[str, str]:
    """Path of every program and example by its name."""
    build = ["cargo", "build", "--workspace", "--release", "--bins", "--examples", "--message-format", "json", "--quiet"]
    result = subprocess.run(build, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    messages = [json.loads(line) for line in result.stdout.splitlines() if line.startswith("{")]
    built = [message for message in messages if message.get("executable")]
    return {message["target"]["name"]: message["executable"] for message in built}


def program(name: str) -> list[str]:
    """The command that runs the program or example `name`."""
    return [executables()[name]]
