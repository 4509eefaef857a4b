"""Breaks training runs on purpose and looks whether anything is lost.

    cd python; python3 -m studies.faults kill          # SIGKILL at random moments, resumed until the run is done
    python3 -m studies.faults disk                     # a disk that is full, a folder that is gone, a second process

Needs `cargo build --release`; nothing but Python's standard library, and for `disk` the right to mount a tmpfs (it is left out
otherwise). Prints a line a fault and writes docs/measured/faults.json.
"""

import argparse
import json
import os
import random
import re
import shutil
import signal
import struct
import subprocess
import tempfile
import time
from pathlib import Path

from studies.common import OMNIWALK, ROOT

RESULTS = ROOT / "docs" / "measured" / "faults.json"
SETTINGS = {
    # A checkpoint after every update and networks of 1.6 MB, so that many kills fall into the writing of one.
    "train.checkpoint_minutes": 1e-6,
    "train.environments": 16,
    "train.steps_per_update": 32,
    "train.steps": 15_360,
    "ppo.hidden": [512, 256],
    "ppo.epochs": 1,
    "ppo.minibatch": 256,
}


def omniwalk(*words: object, **options) -> subprocess.CompletedProcess:
    """Runs the program to its end."""
    return subprocess.run([OMNIWALK, *map(str, words)], cwd=ROOT, capture_output=True, text=True, **options)


def training(run: Path) -> list[str]:
    """The command that starts a run."""
    return [OMNIWALK, "train", "--run", str(run), "--quiet", *(f"--set={key}={json.dumps(value)}" for key, value in SETTINGS.items())]


def resuming(run: Path) -> list[str]:
    """The command that goes on with a run, or starts it again if it was killed before it had begun."""
    return [OMNIWALK, "train", "--resume", "--run", str(run), "--quiet"] if (run / "config.toml").exists() else training(run)


def checkpoints(run: Path) -> list[Path]:
    """The checkpoints, oldest first."""
    return sorted((run / "checkpoints").glob("*.safetensors"))


def weights(checkpoint: Path) -> tuple[str, bytes]:
    """Names, shapes and bytes of everything in a checkpoint but its record of wall time."""
    data = checkpoint.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    header.pop("__metadata__")
    return json.dumps(header, sort_keys=True), data[8 + length :]


def whole(checkpoint: Path) -> bool:
    """Whether the program reads it."""
    return omniwalk("inspect", checkpoint).returncode == 0


def await_writing(process: subprocess.Popen, run: Path) -> None:
    """Returns when a file of the run is being written, or the process has ended."""
    while process.poll() is None and not any((run / "checkpoints").glob("*.unfinished")):
        pass


def kill(count: int, seed: int) -> dict:
    """SIGKILL at `count` random moments, half of them while a checkpoint is written, of runs that are resumed until they are done."""
    chance = random.Random(seed)
    report = dict.fromkeys(("kills", "while_writing", "before_begun", "runs", "no_checkpoint", "other_bits", "not_resumed"), 0)
    with tempfile.TemporaryDirectory() as folder:
        reference = Path(folder) / "reference"
        started = time.monotonic()
        subprocess.run(training(reference), cwd=ROOT, check=True, capture_output=True)
        length = time.monotonic() - started
        expected = weights(checkpoints(reference)[-1])
        while report["kills"] < count:
            run = Path(folder) / f"run-{report['runs']}"
            report["runs"] += 1
            while report["kills"] < count:
                process = subprocess.Popen(resuming(run), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
                try:
                    process.wait(chance.uniform(0.0, 0.4 * length))
                except subprocess.TimeoutExpired:
                    if chance.random() < 0.5:
                        await_writing(process, run)
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                    report["kills"] += 1
                    report["while_writing"] += any(run.rglob("*.unfinished"))
                    begun = (run / "config.toml").exists()
                    report["before_begun"] += not begun
                    report["no_checkpoint"] += begun and not any(map(whole, checkpoints(run)))
                    continue
                if process.returncode != 0:
                    report["not_resumed"] += 1
                    print(process.stderr.read())
                break
            else:
                subprocess.run(resuming(run), cwd=ROOT, check=True, capture_output=True)
            report["other_bits"] += weights(checkpoints(run)[-1]) != expected
            print(report, flush=True)
            shutil.rmtree(run)
    return report


def started(run: Path, **options) -> subprocess.Popen:
    """A run that has written two checkpoints."""
    process = subprocess.Popen(training(run) + ["--steps=1000000000"], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **options)
    while process.poll() is None and len(checkpoints(run)) < 2:
        time.sleep(0.01)
    return process


def said(error: str, run: Path) -> str:
    """A message on one line without its frame, the run's folder called RUN."""
    line = " ".join(word for word in error.split() if not re.fullmatch("[×│╰─▶├]+", word))
    return line.replace("step- ", "step-").replace(str(run), "RUN")


def ended(process: subprocess.Popen, run: Path) -> dict:
    """How a run that met a fault ended: its exit code and message, and whether its newest checkpoint is whole."""
    _, error = process.communicate(timeout=120)
    kept = checkpoints(run)
    return {"exit": process.returncode, "says": said(error, run), "checkpoints_whole": all(map(whole, kept)), "checkpoints": len(kept)}


def disk() -> dict:
    """A full disk, a folder that is deleted or may not be written to, a second process on the same folder."""
    report = {}
    with tempfile.TemporaryDirectory() as folder:
        tmpfs = Path(folder) / "small"
        tmpfs.mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=48m", "omniwalk", tmpfs], capture_output=True).returncode == 0:
            try:
                process = started(tmpfs / "run")
                (tmpfs / "ballast").write_bytes(bytes(1 << 20))
                with (tmpfs / "ballast").open("ab", buffering=0) as file:
                    try:
                        while True:
                            file.write(bytes(4096))
                    except OSError:
                        pass
                report["full disk"] = ended(process, tmpfs / "run")
                (tmpfs / "ballast").unlink()
                again = omniwalk("train", "--resume", "--run", tmpfs / "run", "--quiet", "--steps", 100_000)
                report["full disk"]["resumes_with_room"] = again.returncode == 0
            finally:
                subprocess.run(["umount", tmpfs], check=True)
        endings = []
        for _ in range(20):
            run = Path(folder) / "deleted"
            process = started(run)
            # In one go: files that are written meanwhile would keep a folder from being removed.
            run.rename(run.with_name("gone"))
            shutil.rmtree(run.with_name("gone"))
            endings.append({**ended(process, run), "left_behind": run.exists()})
            shutil.rmtree(run, ignore_errors=True)
        report["folder deleted"] = {"count": len(endings), "endings": [end for i, end in enumerate(endings) if end not in endings[:i]]}
        run = Path(folder) / "twice"
        process = started(run)
        second = omniwalk("train", "--resume", "--run", run)
        report["second process"] = {"exit": second.returncode, "says": said(second.stderr, run)}
        process.kill()
        process.wait()
        third = omniwalk("train", "--resume", "--run", run, "--quiet", "--steps", 100_000)
        report["second process"]["resumes_after_a_kill"] = third.returncode == 0
        if os.geteuid() != 0:
            run.chmod(0o555)
            refused = omniwalk("train", "--resume", "--run", run, "--steps", 200_000)
            run.chmod(0o755)
            report["read only"] = {"exit": refused.returncode, "says": said(refused.stderr, run)}
    return report


def main() -> None:
    """Parses the command line, does it, and keeps what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("fault", choices=("kill", "disk"))
    parser.add_argument("--count", type=int, default=100, help="kills")
    parser.add_argument("--seed", type=int, default=1, help="of the moments")
    arguments = parser.parse_args()
    report = kill(arguments.count, arguments.seed) if arguments.fault == "kill" else disk()
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    RESULTS.write_text(json.dumps({**known, arguments.fault: report}, indent=2, ensure_ascii=False) + "\n")
    print(json.dumps(report, indent=2, ensure_ascii=False))


if __name__ == "__main__":
    main()
