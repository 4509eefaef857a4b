"""Calls of the package that cannot be right are refused in its own words, not in NumPy's or PyO3's."""

from functools import cache

import numpy as np
import pytest

import omniwalk
from programs import ROOT

ROBOT = {"robot.path": ROOT / "robots/nimbro_op2x"}
TRAINED = ROOT / "runs/nimbro_op2x_omni/policy.omni"
# The policy and the robot have 16 joints and 70 entries of the observation.
ROW, OBSERVATION = np.zeros(16, np.float32), np.zeros(70, np.float32)
DOUBLE = np.zeros(16)
READ_ONLY = np.zeros(16, np.float32)
READ_ONLY.flags.writeable = False


@cache
def controller() -> omniwalk.Controller:
    return omniwalk.Controller(TRAINED)


@cache
def env() -> omniwalk.Env:
    return omniwalk.Env(changes=ROBOT)


@cache
def envs() -> omniwalk.VectorEnv:
    return make(2)


@cache
def robots() -> "omniwalk.VecEnv":
    pytest.importorskip("stable_baselines3", reason="`./test --torch` has Stable-Baselines3")
    return omniwalk.VecEnv(2, changes=ROBOT)


def make(num_envs, **given) -> omniwalk.VectorEnv:
    return omniwalk.make_vec(num_envs, changes=ROBOT, **given)


def step(**given):
    zero = (0.0, 0.0, 0.0)
    still = {"position": ROW, "velocity": ROW, "attitude": (0.0, 0.0), "gyro": zero, "desired": zero}
    return controller().step(**{"now": 0, "measured": 0, **still, **given})


def act(observations=OBSERVATION, **given):
    return controller().act(observations, **given)


COUNT = "num_envs must be a whole number from 1 on, or None for as many as `train.environments` says, not "
THREADS = "threads must be a whole number from 1 to 1024, or None for all cores, not "
SEED = "seed must be a whole number from 0 on, or None, not "
VELOCITY = "velocity must be three finite numbers (m/s, m/s, rad/s), not "
THREE = "must be 3 numbers, an array of one dimension or a list, not "
JOINTS = "must be 16 numbers, an array of one dimension or a list, not "
ENVIRONMENT = "environment must be a whole number from 0 to 1, not "
ACTIONS = "actions must be numbers with shape (2, 16), not "
ACTION = "action must be numbers with shape (16,), not "
OBSERVATIONS = "observations must be 70 numbers, or rows of 70 numbers, not "
OUT = "out must be a writable array of float32 with shape (16,), in C order without gaps, not "
BATCH = "actions must be an array of float32 with shape (2, 16), in C order without gaps, not "
TIME = "must be a whole number of nanoseconds from 0 to 2^64 - 1, not "
PICTURES = "render_mode must be None (omniwalk draws no pictures while it steps; `omniwalk report` does afterwards), not "

CALLS = [
    # How many, and which.
    (lambda: make(-1), COUNT + "-1"),
    (lambda: make(2.5), COUNT + "2.5"),
    (lambda: make("2"), COUNT + "'2'"),
    (lambda: make(2, threads=-1), THREADS + "-1"),
    (lambda: make(2, threads=0), THREADS + "0"),
    (lambda: make(2, threads=1.5), THREADS + "1.5"),
    (lambda: make(2, threads=10**12), THREADS + "1000000000000"),
    (lambda: make(2, threads=10**30), THREADS + str(10**30)),
    (lambda: env().reset(seed=-1), SEED + "-1"),
    (lambda: envs().reset(seed=-1), SEED + "-1"),
    (lambda: envs().reset(seed=1.5), SEED + "1.5"),
    (lambda: robots().seed(-1), SEED + "-1"),
    (lambda: robots().seed(1.5), SEED + "1.5"),
    (lambda: envs().unwrapped._batch.reset(-1), "seed must be a whole number from 0 to 2^64 - 1, or None, not -1"),
    (lambda: envs().set_desired(-1, (0, 0, 0)), ENVIRONMENT + "-1"),
    (lambda: envs().set_desired(2, (0, 0, 0)), ENVIRONMENT + "2"),
    (lambda: envs().set_desired(0.5, (0, 0, 0)), ENVIRONMENT + "0.5"),
    *[
        call
        for bad in (-1, None, 0.5, 2**64, "now")
        for call in (
            (lambda bad=bad: step(now=bad), f"now {TIME}{bad!r}"),
            (lambda bad=bad: step(measured=bad), f"measured {TIME}{bad!r}"),
        )
    ],
    # Velocities.
    (lambda: env().set_desired((0, 0)), VELOCITY + "(0, 0)"),
    (lambda: env().set_desired(0.3), VELOCITY + "0.3"),
    (lambda: env().set_desired((0, 0, "x")), VELOCITY + "(0, 0, 'x')"),
    (lambda: env().set_desired((0, 0, np.nan)), VELOCITY + "(0, 0, nan)"),
    (lambda: envs().set_desired(0, np.zeros(2)), VELOCITY + "an array of float64 with shape (2,)"),
    (lambda: envs().set_command_range((0, 0), (1, 1, 1)), "lower must be three finite numbers (m/s, m/s, rad/s), not (0, 0)"),
    (lambda: envs().set_command_range((0, 0, 0), 1), "upper must be three finite numbers (m/s, m/s, rad/s), not 1"),
    (lambda: envs().set_factors("x", 1.0), "velocity must be a finite number, not 'x'"),
    (lambda: envs().set_factors(1.0, 1.0, -1.0), "push must be a number from 0 on, not -1.0"),
    # Readings.
    (lambda: step(desired=(0, 0)), f"desired {THREE}(0, 0)"),
    (lambda: step(desired="fast"), f"desired {THREE}'fast'"),
    (lambda: step(desired=("a", 0, 0)), f"desired {THREE}('a', 0, 0)"),
    (lambda: step(gyro=None), f"gyro {THREE}None"),
    (lambda: step(base_velocity=np.zeros((1, 3))), f"base_velocity {THREE}an array of float64 with shape (1, 3)"),
    (lambda: step(attitude=0.0), "attitude must be 2 numbers, an array of one dimension or a list, not 0.0"),
    (lambda: step(position=ROW[None]), f"position {JOINTS}an array of float32 with shape (1, 16)"),
    (lambda: step(velocity=[0.0] * 15), f"velocity {JOINTS}a list of 15"),
    (lambda: controller().take_over("x"), f"position {JOINTS}'x'"),
    (lambda: controller().reset("x"), "phase must be a finite number, not 'x'"),
    (lambda: controller().reset(np.nan), "phase must be a finite number, not nan"),
    # Actions and observations.
    (lambda: envs().step(ROW), ACTIONS + "an array of float32 with shape (16,)"),
    (lambda: envs().step([[0.0] * 15] * 2), ACTIONS + "an array of float32 with shape (2, 15)"),
    (lambda: envs().step("x"), ACTIONS + "'x'"),
    (lambda: envs().step(None), ACTIONS + "None"),
    (lambda: envs().step([["left"], ["right"]]), ACTIONS + "[['left'], ['right']]"),
    (lambda: envs().step([[0.0, 1.0], [0.0]]), ACTIONS + "[[0.0, 1.0], [0.0]]"),
    (lambda: robots().step(ROW), ACTIONS + "an array of float32 with shape (16,)"),
    (lambda: env().step(ROW[1:]), ACTION + "an array of float32 with shape (15,)"),
    (lambda: env().step(ROW[None]), ACTION + "an array of float32 with shape (1, 16)"),
    (lambda: env().step("x"), ACTION + "'x'"),
    (lambda: envs().unwrapped._batch.step(np.zeros((2, 16))), BATCH + "an array of float64 with shape (2, 16)"),
    (lambda: act("x"), OBSERVATIONS + "'x'"),
    (lambda: act(0.0), OBSERVATIONS + "0.0"),
    (lambda: act(OBSERVATION[1:]), OBSERVATIONS + "an array of float32 with shape (69,)"),
    # Places for results.
    *[
        call
        for out, found in (
            (DOUBLE, "an array of float64 with shape (16,)"),
            (READ_ONLY, "an array of float32 with shape (16,) that is read-only"),
            (ROW[1:], "an array of float32 with shape (15,)"),
            (np.zeros(32, np.float32)[::2], "an array of float32 with shape (16,) and gaps or another order"),
            ([0.0, 0.0], "[0.0, 0.0]"),
        )
        for call in ((lambda out=out: act(out=out), OUT + found), (lambda out=out: step(out=out), OUT + found))
    ],
    (
        lambda: act(np.zeros((2, 70), np.float32), out=np.zeros((2, 16), np.float32, order="F")),
        "out must be a writable array of float32 with shape (2, 16), in C order without gaps,"
        " not an array of float32 with shape (2, 16) and gaps or another order",
    ),
    # Files, settings, names.
    (lambda: omniwalk.Env(3), "config must be the path of a TOML file or None, not 3"),
    (lambda: omniwalk.make_vec(2, 3), "config must be the path of a TOML file or None, not 3"),
    (lambda: omniwalk.Env(changes=3), "changes must be a mapping of settings by their dotted key, or None, not 3"),
    (lambda: omniwalk.Env(render_mode="human"), PICTURES + "'human'"),
    (lambda: omniwalk.Robot(3), "path must be the path of a folder or a URDF, not 3"),
    (lambda: omniwalk.Controller(3), "policy must be the path of a policy file, or its bytes, not 3"),
    (lambda: controller().check_joints("knee"), "names must be a list of the names of joints, not 'knee'"),
    (lambda: controller().joint_map([1, 2]), "names must be a list of the names of joints, not [1, 2]"),
]


@pytest.mark.parametrize(("call", "message"), CALLS, ids=[message for _, message in CALLS])
def test_a_wrong_call_is_told_which_argument_must_be_what_and_what_it_was(call, message):
    with pytest.raises(omniwalk.Error) as found:
        call()
    assert str(found.value) == message
    assert isinstance(found.value, ValueError)
