"""The engines side by side on one core: `python bench_engines.py --omniwalk target/release/omniwalk --rounds 5`.

MuJoCo in both settings of `bench_mujoco`, `lanes` and `rapier` take turns, a few seconds each, on the same robot at the
same rates with random targets every 25 ms and a new start after every fall. Every figure is steps per second of
processor time, so that other work on the machine counts for nobody. `engine` is physics alone with the actuators' law, as
MuJoCo's figures are; `whole` has sensors, estimator, observation, reward and starts of episodes too. Ratios are medians
over the rounds, with the smallest and the largest: within a round all engines meet the same machine. `--dry-friction`
and `--rough` give every joint dry friction and the robot a height field to stand on, in every engine.
"""

import argparse
import json
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path
from statistics import median

import mujoco

from bench_mujoco import SETTINGS, Bench, Run
from omniwalk_reference.robot import load

ENGINES = ("lanes", "rapier")


def with_dry_friction(robot: Path, torque: float, folder: Path) -> Path:
    """The robot in `folder` with dry friction of `torque` (N m; N) in every joint."""
    copy = Path(shutil.copytree(robot, folder / robot.resolve().name))
    with (copy / "robot.toml").open("a") as file:
        file.write(f'\n[[joint]]\nmatch = ["*"]\nfriction = {torque}\n')
    return copy


def mujoco_rate(run: Run, seconds: float) -> float:
    """Policy steps per second of processor time over the next `seconds` of it."""
    fresh = Run(run.bench)
    while fresh.full.seconds < seconds:
        fresh.block()
    return fresh.figures()["policy_steps_per_second"]


def omniwalk_rates(arguments: argparse.Namespace, robot: Path, engine: str) -> dict[str, float]:
    """Policy steps per second of processor time in the engine and in the whole environment."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bench.json"
        settings = {
            "robot.path": f'"{robot}"',
            "ground.kind": "rough" if arguments.rough else "plane",
            "engine.physics_hz": str(arguments.physics_hz),
            "train.environments": str(arguments.worlds),
        }
        command = [str(arguments.omniwalk), "bench", "env", "--engine", engine, "--threads", "1", "--json", str(file)]
        command += ["--seconds", str(arguments.seconds)]
        for key, value in settings.items():
            command += ["--set", f"{key}={value}"]
        subprocess.run(command, check=True, capture_output=True)
        figures = json.loads(file.read_text())
    return {
        f"{engine} engine": figures["engine_policy_steps_per_processor_second"],
        f"{engine} whole": figures["policy_steps_per_processor_second"],
    }


def measure(arguments: argparse.Namespace, robot: Path) -> list[dict[str, float]]:
    """The rates of every round."""
    model = load(robot)
    runs = {
        f"mujoco {name}": Run(Bench(model, arguments.physics_hz, arguments.worlds, 0, settings, arguments.rough))
        for name, settings in SETTINGS.items()
    }
    for run in runs.values():
        run.block()
    rounds = []
    for _ in range(arguments.rounds):
        rates = {name: mujoco_rate(run, arguments.seconds) for name, run in runs.items()}
        for engine in ENGINES:
            rates |= omniwalk_rates(arguments, robot, engine)
        rounds.append(rates)
    return rounds


def processor() -> str:
    """The processor's name where the system tells it."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.processor())


def main() -> None:
    """Parses the command line, measures, prints."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--robot", type=Path, default=Path("robots/nimbro_op2x"), help="a robot folder")
    parser.add_argument("--omniwalk", type=Path, default=Path("target/release/omniwalk"), help="the program")
    parser.add_argument("--physics-hz", type=int, default=200)
    parser.add_argument("--worlds", type=int, default=64, help="robots in the batch")
    parser.add_argument("--seconds", type=int, default=2, help="of each engine in each round")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--dry-friction", type=float, default=0.0, help="in every joint of every engine, N m")
    parser.add_argument("--rough", action="store_true", help="a height field instead of the plane, in every engine")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    arguments = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        robot = arguments.robot
        if arguments.dry_friction:
            robot = with_dry_friction(robot, arguments.dry_friction, Path(folder))
        rounds = measure(arguments, robot)
    names = list(rounds[0])
    print(f"mujoco {mujoco.__version__}, {arguments.worlds} worlds, {arguments.physics_hz} Hz, {arguments.rounds} rounds")
    print(f"{'':16} {'policy steps/s':>15} {'/ fastest':>22} {'/ thesis':>9} {'/ rapier engine':>22}")
    record = {}
    for name in names:
        ratios = {other: sorted(r[name] / r[other] for r in rounds) for other in names}
        spread = {other: f"{median(all):.2f} ({all[0]:.2f}-{all[-1]:.2f})" for other, all in ratios.items()}
        print(
            f"{name:16} {median(r[name] for r in rounds):15.0f} {spread['mujoco fastest']:>22} "
            f"{median(ratios['mujoco thesis']):9.2f} {spread['rapier engine']:>22}"
        )
        record[name] = {
            "policy_steps_per_second": median(r[name] for r in rounds),
            "ratios": {other: median(all) for other, all in ratios.items()},
        }
    if arguments.json:
        loads = {key: getattr(arguments, key) for key in ("physics_hz", "worlds", "seconds", "dry_friction", "rough")}
        about = {"robot": arguments.robot.name, **loads, "mujoco": mujoco.__version__, "processor": processor()}
        arguments.json.write_text(json.dumps({**about, "rounds": rounds, "medians": record}, indent=2) + "\n")


if __name__ == "__main__":
    main()
