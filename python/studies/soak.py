"""Trains and steps the controller for long, and looks whether memory, open files or speed change.

    cd python; python3 -m studies.soak                                    # two hours of training, then 1e7 controller steps
    python3 -m studies.soak --minutes 2 --steps 100000 --out /tmp/soak    # a trial

Needs `cargo build --release` and `cargo build --release -p omniwalk-controller --example soak`; nothing but Python's standard
library, and Linux, whose /proc is read. Writes soak-train.csv and soak-controller.csv into docs/measured, a row a minute of training
(ten in a trial) and a row a hundredth of the steps, and says whether the second half differs from the first: exits with 1 if so.
"""

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from studies.common import OMNIWALK, ROOT

EXAMPLE = os.environ.get("SOAK", str(Path(OMNIWALK).parent / "examples" / "soak"))
POLICY = ROOT / "runs" / "nimbro_op2x_omni" / "policy.omni"
MOST_GROWTH_MB = 8.0
"""Of the resident memory from the first half to the second: below it lie the allocator's own habits."""
MOST_SLOWER = 0.1
"""Share of the speed that may be missing in the second half. Training is judged by its processor time, so that programs beside it count
for little; they still share its caches."""


def resident_mb(process: int) -> float:
    """Resident memory of a process."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    raise ProcessLookupError(process)


def processor_seconds(process: int) -> float:
    """Processor time of all threads of a process, so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def open_files(process: int) -> int:
    """How many file descriptors a process has open."""
    return len(os.listdir(f"/proc/{process}/fd"))


class Table:
    """A CSV that grows by a row."""

    def __init__(self, path: Path, columns: list[str]):
        self.columns = columns
        self.rows: list[dict] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        self.file = path.open("w", newline="")
        self.writer = csv.DictWriter(self.file, columns)
        self.writer.writeheader()

    def add(self, *values: float) -> None:
        row = dict(zip(self.columns, values))
        self.rows.append(row)
        self.writer.writerow(row)
        self.file.flush()


def train(minutes: float, out: Path) -> Table:
    """Trains for so long, with a checkpoint a minute, and stops as by Ctrl-C."""
    table = Table(out / "soak-train.csv", [
        "seconds", "steps", "steps_per_second", "steps_per_processor_second", "resident_mb", "open_files"
    ])
    with tempfile.TemporaryDirectory() as folder:
        command = [OMNIWALK, "train", "--run", f"{folder}/run", "--steps", "1000000000000", "--log-format", "json"]
        command += ["--set", "train.checkpoint_minutes=1.0"]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        newest = {"steps": 0}

        def follow() -> None:
            for line in process.stdout:
                if line.startswith("{"):
                    newest.update(json.loads(line))

        reader = threading.Thread(target=follow, daemon=True)
        reader.start()
        begin, before = time.monotonic(), (0.0, 0.0, 0)
        pause = max(2.0, min(60.0, minutes * 6))
        while time.monotonic() - begin < 60 * minutes:
            time.sleep(pause)
            if process.poll() is not None:
                raise SystemExit(f"training has ended by itself with {process.returncode}")
            seconds, processor, steps = now = time.monotonic() - begin, processor_seconds(process.pid), newest["steps"]
            speeds = [round((steps - before[2]) / (now[clock] - before[clock])) for clock in (0, 1)]
            before = now
            table.add(round(seconds, 1), steps, *speeds, round(resident_mb(process.pid), 2), open_files(process.pid))
        process.send_signal(2)
        process.wait(timeout=120)
        reader.join()
    return table


def control(steps: int, out: Path) -> Table:
    """Steps the controller so often."""
    table = Table(out / "soak-controller.csv", ["steps", "mean_us", "max_us", "resident_mb", "open_files"])
    process = subprocess.Popen([EXAMPLE, str(POLICY), str(steps)], stdout=subprocess.PIPE, text=True)
    for line in process.stdout:
        done, mean, most = line.split()
        try:
            table.add(int(done), float(mean), float(most), round(resident_mb(process.pid), 2), open_files(process.pid))
        except (ProcessLookupError, FileNotFoundError):
            # It has ended behind its last line.
            break
    if process.wait():
        raise SystemExit(f"the controller has ended with {process.returncode}")
    return table


def judge(name: str, table: Table, slowness: str, is_speed: bool) -> bool:
    """Compares the halves, the first without its first rows, in which buffers are made; says what it finds."""
    rows = table.rows[max(1, len(table.rows) // 20) :]
    halves = rows[: len(rows) // 2], rows[len(rows) // 2 :]
    if not halves[0]:
        print(f"{name}: too short to judge")
        return True

    def middle(column: str) -> list[float]:
        return [statistics.median(row[column] for row in half) for half in halves]

    memory, files, speed = middle("resident_mb"), middle("open_files"), middle(slowness)
    slower = 1 - speed[1] / speed[0] if is_speed else speed[1] / speed[0] - 1
    sound = memory[1] - memory[0] < MOST_GROWTH_MB and files[1] <= files[0] and slower < MOST_SLOWER
    print(
        f"{name}: resident {memory[0]:.1f} MB then {memory[1]:.1f} MB, open files {files[0]:.0f} then {files[1]:.0f}, "
        f"{slowness} {speed[0]:.5g} then {speed[1]:.5g}: {'steady' if sound else 'NOT STEADY'}"
    )
    return sound


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--steps", type=int, default=10_000_000)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "measured")
    arguments = parser.parse_args()
    sound = judge("training", train(arguments.minutes, arguments.out), "steps_per_processor_second", True)
    sound &= judge("controller", control(arguments.steps, arguments.out), "mean_us", False)
    sys.exit(0 if sound else 1)


if __name__ == "__main__":
    main()
