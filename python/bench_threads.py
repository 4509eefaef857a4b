"""What a second core brings: `python bench_threads.py --omniwalk target/release/omniwalk`.

Measures `omniwalk bench env` with one thread, with two, and in two processes of one thread each at the same time, in turn. The
last is what the machine's cores have to give together. Rounds in which other programs took more than a tenth of the processors are
shown and left out of the medians.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path
from statistics import median

BUSY = 0.1
"""Share of idle processor time with two threads from which on a round is taken for disturbed."""


def measure(arguments: argparse.Namespace, threads: int, processes: int) -> tuple[float, float]:
    """Policy steps a second of all processes together, and the largest idle share."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{process}.json" for process in range(processes)]
        command = [str(arguments.omniwalk), "bench", "env", "--engine", "lanes", "--threads", str(threads)]
        command += ["--seconds", str(arguments.seconds), "--json"]
        running = [subprocess.Popen([*command, str(file)], stdout=subprocess.DEVNULL) for file in files]
        if any([process.wait() for process in running]):
            raise SystemExit(f"{' '.join(command)} failed")
        results = [json.loads(file.read_text()) for file in files]
    return sum(result["policy_steps_per_second"] for result in results), max(result["idle_share"] for result in results)


def main() -> None:
    """Parses the command line, measures, prints."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--omniwalk", type=Path, default=Path("target/release/omniwalk"), help="the program")
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--seconds", type=int, default=2, help="of a measurement")
    parser.add_argument("--json", type=Path, help="write the rounds to this file too")
    arguments = parser.parse_args()
    rounds = []
    for _ in range(arguments.rounds):
        one, other_idle = measure(arguments, 1, 1)
        two, idle = measure(arguments, 2, 1)
        apart, apart_idle = measure(arguments, 1, 2)
        disturbed = max(other_idle, idle, apart_idle) > BUSY
        rounds.append({"one": one, "two": two, "apart": apart, "idle": idle, "disturbed": disturbed})
        print(
            f"one {one:.0f}, two {two:.0f} ({two / one:.2f}), apart {apart:.0f} ({apart / one:.2f}), idle {idle:.3f}",
            "disturbed" if disturbed else "",
            flush=True,
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(rounds, indent=2) + "\n")
    sound = [entry for entry in rounds if not entry["disturbed"]]
    if not sound:
        raise SystemExit("other programs disturbed every round")
    for kind in ("two", "apart"):
        ratios = [entry[kind] / entry["one"] for entry in sound]
        rate = median(entry[kind] for entry in sound)
        print(f"{kind}: {rate:.0f} policy steps/s, {median(ratios):.2f} of one ({min(ratios):.2f} to {max(ratios):.2f})")
    print(f"one: {median(entry['one'] for entry in sound):.0f} policy steps/s, {len(sound)} rounds of {len(rounds)}")


if __name__ == "__main__":
    main()
