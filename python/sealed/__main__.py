"""`python -m sealed generate rig --seeds 0-7 --out DIR`"""

from __future__ import annotations

import argparse
from pathlib import Path

from . import generate


def seeds(text: str) -> list[int]:
    """`3`, `0-7` or `1,4,8-9`."""
    numbers: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        numbers += range(int(first), int(last or first) + 1)
    return numbers


def main() -> None:
    parser = argparse.ArgumentParser(prog="sealed", description="Logs of machines with sealed faults.")
    commands = parser.add_subparsers(required=True)
    make = commands.add_parser("generate", help="writes robot folders and logs, and the truth elsewhere")
    make.add_argument("machine", choices=generate.MACHINES)
    make.add_argument("--seeds", type=seeds, required=True, help="such as 0-7 or 1,4,8")
    make.add_argument("--out", type=Path, required=True)
    make.set_defaults(run=_generate)
    arguments = parser.parse_args()
    arguments.run(arguments)


def _generate(arguments) -> None:
    for seed in arguments.seeds:
        print(generate.generate(arguments.machine, seed, arguments.out))


if __name__ == "__main__":
    main()
