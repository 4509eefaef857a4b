"""Makes, runs and judges sealed cases, and lets policies walk in them.

    python -m sealed generate rig --seeds 0-7 --out DIR [--logs 8]
    python -m sealed run fixed --out DIR --results DIR [--program omniwalk]
    python -m sealed baseline fixed --out DIR --results DIR --program PROGRAM
    python -m sealed summary --out DIR --results DIR
    python -m sealed walk POLICY.omni --machine walk --seed 1000 --out DIR
    python -m sealed close --seeds 0-4 --from RUN --out DIR --results DIR [--program omniwalk]
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from . import cases, generate, loop, runner, summary
from .closing import Closing, table


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
    make.add_argument("--logs", type=int, default=len(generate.FIT), help="to fit, of a machine that does not walk [8]")
    make.set_defaults(run=_generate)
    run = commands.add_parser("run", help="identifies the cases of a list; what is done is skipped")
    run.add_argument("cases", choices=cases.LISTS)
    run.add_argument("--out", type=Path, required=True, help="where cases are, or are made")
    run.add_argument("--results", type=Path, required=True)
    run.add_argument("--program", default="omniwalk", help="the command [omniwalk]")
    run.add_argument("--limit", type=float, default=1800.0, help="time for one case, s [1800]")
    run.set_defaults(run=_run)
    every = commands.add_parser("baseline", help="fits every effect at once to cases that have a result, to compare with")
    every.add_argument("cases", choices=cases.LISTS)
    every.add_argument("--out", type=Path, required=True, help="where cases are, or are made")
    every.add_argument("--results", type=Path, required=True)
    every.add_argument("--program", required=True, help="`cargo build --release -p omniwalk-sim2real --example all_effects` makes it")
    every.set_defaults(run=_baseline)
    judge = commands.add_parser("summary", help="compares results with truths")
    judge.add_argument("--out", type=Path, required=True)
    judge.add_argument("--results", type=Path, required=True)
    judge.set_defaults(run=_summary)
    walk = commands.add_parser("walk", help="lets a policy walk in the sealed world of a case: falls and velocity errors")
    walk.add_argument("policy", type=Path)
    walk.add_argument("--machine", choices=["walk", "worn"], required=True)
    walk.add_argument("--seed", type=int, required=True)
    walk.add_argument("--out", type=Path, required=True, help="folder for the same as JSON")
    walk.set_defaults(run=_walk)
    close = commands.add_parser("close", help="the whole loop over worlds with worn knees: walk, identify, train on, walk again")
    close.add_argument("--seeds", type=seeds, required=True)
    close.add_argument("--from", dest="run_before", type=Path, required=True, help="the run whose policy walks")
    close.add_argument("--out", type=Path, required=True, help="where logs, robots and runs are made")
    close.add_argument("--results", type=Path, required=True, help="folder for a small file a world")
    close.add_argument("--program", default="omniwalk", help="the command [omniwalk]")
    close.add_argument("--steps", type=int, default=4_000_000, help="of the training that goes on [4,000,000]")
    close.set_defaults(run=_close)
    arguments = parser.parse_args()
    arguments.run(arguments)


def _generate(arguments) -> None:
    for seed in arguments.seeds:
        print(generate.generate(arguments.machine, seed, arguments.out, count=arguments.logs))


def _run(arguments) -> None:
    program = shlex.split(arguments.program)
    runner.run(cases.LISTS[arguments.cases], program, arguments.out, arguments.results, arguments.limit)


def _baseline(arguments) -> None:
    runner.baseline(cases.LISTS[arguments.cases], shlex.split(arguments.program), arguments.out, arguments.results)


def _summary(arguments) -> None:
    print(summary.tables(summary.load(arguments.out, arguments.results)))


def _walk(arguments) -> None:
    plays = loop.play(arguments.policy, arguments.seed, machine=arguments.machine)
    loop.write(plays, arguments.policy, arguments.seed, arguments.out)
    print(loop.table(plays))


def _close(arguments) -> None:
    closing = Closing(shlex.split(arguments.program), arguments.run_before, arguments.out, arguments.steps)
    for seed in arguments.seeds:
        closing.world(seed, arguments.results)
    print(table(arguments.results))


if __name__ == "__main__":
    main()
