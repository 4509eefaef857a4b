"""Stable-Baselines3's PPO on the forward task.

    python3 -m baselines.sb3 --world lanes --settings ours --seed 1 --work DIR

in `python/`. `--world lanes` (or `rapier`) is this project's environment through its binding, `mujoco` that of `walk.py`, a process each.
There is no curriculum: every command is drawn from the first episode on, and the reward has its full weights. DIR gets
`curve.csv` with a row for each update, and a checkpoint every two minutes; the same command goes on from there, with new episodes. Of a
finished run there is `result.json`, and nothing is done.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import time
from collections import deque
from functools import partial
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import SubprocVecEnv, VecEnv, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvWrapper

from . import files, settings

CHECKPOINT_SECONDS = 120.0


class Scaled(VecEnvWrapper):
    """Rewards times a factor."""

    def __init__(self, envs: VecEnv, factor: float) -> None:
        super().__init__(envs)
        self.factor = factor

    def reset(self):
        return self.venv.reset()

    def step_wait(self):
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, self.factor * rewards, dones, infos


def robots(world: str, count: int, threads: int) -> VecEnv:
    """`count` robots side by side."""
    if world == "mujoco":
        from .walk import Walk

        # Processes that begin as copies of one that has imported everything share its memory.
        multiprocessing.get_context("forkserver").set_forkserver_preload(["baselines.sb3", "baselines.walk"])
        return SubprocVecEnv([partial(Walk, settings.CONFIG)] * count, start_method="forkserver")
    import omniwalk

    changes = {"engine.kind": world, "robot.path": settings.ROOT / settings.task()["robot"]["path"]}
    return omniwalk.VecEnv(count, settings.CONFIG, changes, threads=threads)


def wrapped(envs: VecEnv, chosen: dict, normaliser: Path | None = None) -> VecNormalize:
    """The robots with observations and rewards as the settings have them, with the statistics in `normaliser`."""
    scale, clip = chosen["scale"], chosen["clip"]
    inner = envs if scale is None else Scaled(envs, scale)
    if normaliser is not None:
        return VecNormalize.load(str(normaliser), inner)
    return VecNormalize(inner, norm_reward=scale is None, clip_obs=clip)


class Progress(BaseCallback):
    """Keeps the curve and the checkpoints of a run in the folder `work`."""

    def __init__(self, work: Path, state: dict) -> None:
        super().__init__()
        self.work, self.state = work, state
        self.rows = files.read_curve(work / "curve.csv")[: state["rows"]]
        self.episodes = deque(state["episodes"], maxlen=100)
        self.saved = time.monotonic()
        # The first episodes of a call that goes on are cut short, so that robots are not in step: they say nothing of the policy.
        self.passed_over: set[int] = set()

    def _on_training_start(self) -> None:
        if self.state["calls"] > 1:
            self.passed_over = set(range(self.training_env.num_envs))

    def processor_seconds(self) -> float:
        """Of this run, with the calls before this one."""
        robots = getattr(self.training_env.unwrapped, "processes", [])
        processes = [os.getpid(), *(process.pid for process in robots)]
        return self.state["processor_seconds"] + files.processor_seconds(processes)

    def _on_step(self) -> bool:
        for robot, info in enumerate(self.locals["infos"]):
            if "episode_end" in info and robot in self.passed_over:
                self.passed_over.discard(robot)
            elif "episode_end" in info:
                end = info["episode_end"]
                errors = [float(end[key]) for key in ("error_xy_mps", "error_yaw_radps")]
                fallen = end["end"] in ("fallen", "leg_overlap")
                self.episodes.append([float(end["return"]), int(end["steps"]), float(fallen), *errors])
        return True

    def _on_rollout_end(self) -> None:
        columns = np.array(self.episodes).T if self.episodes else np.full((5, 1), np.nan)
        known = [column[np.isfinite(column)] for column in columns]
        means = [round(float(column.mean()), 5) if column.size else "" for column in known]
        self.rows.append([self.num_timesteps, round(self.processor_seconds(), 2), *means])
        files.write_curve(self.work / "curve.csv", self.rows)

    def _on_rollout_start(self) -> None:
        # The update with all that was collected so far is done.
        if time.monotonic() - self.saved > CHECKPOINT_SECONDS:
            files.save(self.work / "checkpoint", self.fill)
            self.saved = time.monotonic()

    def fill(self, draft: Path) -> dict:
        """Writes a checkpoint's files; its state."""
        self.model.save(draft / "model.zip")
        self.training_env.save(str(draft / "normaliser.pkl"))
        return self.state | {
            "rows": len(self.rows),
            "episodes": list(self.episodes),
            "processor_seconds": self.processor_seconds(),
        }


def train(work: Path, world: str, name: str, seed: int, steps: int, threads: int) -> None:
    """Trains, or goes on with, the run in `work`."""
    torch.set_num_threads(threads)
    chosen = settings.sb3(name)
    envs = robots(world, chosen["robots"], threads)
    checkpoint = work / "checkpoint"
    state = files.load(checkpoint)
    if state is None:
        state = {"rows": 0, "episodes": [], "processor_seconds": 0.0, "calls": 1}
        model = PPO("MlpPolicy", wrapped(envs, chosen), seed=seed, device="cpu", **chosen["ppo"])
    else:
        state["calls"] += 1
        envs = wrapped(envs, chosen, checkpoint / "normaliser.pkl")
        # Another seed, for episodes that were not had yet.
        model = PPO.load(checkpoint / "model.zip", envs, device="cpu", seed=seed + 1000 * (state["calls"] - 1))
    progress = Progress(work, state)
    try:
        model.learn(steps - model.num_timesteps, callback=progress, reset_num_timesteps=False)
        seconds = progress.processor_seconds()
    finally:
        envs.close()
    result = {
        "world": world,
        "settings": name,
        "seed": seed,
        "steps": model.num_timesteps,
        "processor_seconds": round(seconds, 1),
        "calls": state["calls"],
    }
    files.write(work / "result.json", json.dumps(result, indent=2) + "\n")


def main() -> None:
    """Parses the command line and trains."""
    parser = argparse.ArgumentParser(prog="python -m baselines.sb3", description=__doc__.splitlines()[0])
    parser.add_argument("--world", choices=["lanes", "rapier", "mujoco"], default="lanes")
    parser.add_argument("--settings", choices=["recommended", "ours"], default="recommended")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=settings.STEPS)
    parser.add_argument("--threads", type=int, default=1, help="of PyTorch and of our engine (default: %(default)s)")
    parser.add_argument("--work", type=Path, required=True, help="the folder of the run")
    given = parser.parse_args()
    if not (given.work / "result.json").exists():
        train(given.work, given.world, given.settings, given.seed, given.steps, given.threads)


if __name__ == "__main__":
    main()
