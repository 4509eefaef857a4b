"""`python -m omniwalk_reference mjcf ROBOT`: the robot as a MuJoCo model on standard output."""

import argparse
import sys
from pathlib import Path

from . import mjcf, robot


def main() -> None:
    """Parses the command line and runs the command."""
    parser = argparse.ArgumentParser(prog="python -m omniwalk_reference", description=__doc__)
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("mjcf", help="print a robot as MJCF")
    command.add_argument("robot", type=Path, help="a robot folder, or a URDF")
    command.add_argument("--physics-hz", type=float, default=1000.0, help="physics rate, Hz (default: %(default)g)")
    command.add_argument("--legs", action="store_true", help="legs collide with each other, as in the cross-check")
    arguments = parser.parse_args()
    model = robot.load(arguments.robot)
    if model.beyond:
        print(f"not in this model: {', '.join(model.beyond)}", file=sys.stderr)
    print(mjcf.write(model, arguments.physics_hz, legs=arguments.legs), end="")


if __name__ == "__main__":
    main()
