"""`python -m omniwalk.crosscheck POLICY_OR_RUN`: `omniwalk crosscheck` with the MuJoCo of this Python."""

from __future__ import annotations

import signal
import sys

from . import _native


def main(arguments: list[str] | None = None) -> int:
    """Runs the command with `arguments`, by default those of the command line; its exit code: 0, 1 if a gate fails, 2 for
    what is wrong, which it has said. Without `--python` or `--venv` MuJoCo is that of this interpreter."""
    arguments = sys.argv[1:] if arguments is None else arguments
    chosen = any(argument.split("=")[0] in ("--python", "--venv") for argument in arguments)
    return _native.crosscheck(arguments if chosen else [*arguments, "--python", sys.executable])


if __name__ == "__main__":
    # The compiled code does not come back to Python to hear of Ctrl-C.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(main())
