"""The environments through the binding are what Gymnasium and Stable-Baselines3 take them for."""

import gc
import threading
import time
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import omniwalk
from conftest import ROOT

ROBOT = {"robot.path": ROOT / "robots/nimbro_op2x"}
WALK = ROOT / "runs/nimbro_op2x_omni"
TORCH = "`./test --torch` has Stable-Baselines3"
SMALL = {**ROBOT, "task.episode_seconds": 1.0}
"""Episodes of a second, so that some end."""


def play(envs: omniwalk.VectorEnv, steps: int, seed: int = 5) -> list[np.ndarray]:
    """Observations and rewards under random actions."""
    random = np.random.default_rng(1)
    found = [envs.reset(seed=seed)[0]]
    for _ in range(steps):
        actions = random.uniform(-1.0, 1.0, envs.action_space.shape).astype(np.float32)
        found += envs.step(actions)[:4]
    return found


@pytest.mark.parametrize("make", [omniwalk.Env, lambda **given: gymnasium.make("omniwalk.gym:omniwalk/Walk-v0", **given)])
def test_the_environment_passes_gymnasiums_checks(make):
    env = make(changes=ROBOT)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        check_env(env.unwrapped, skip_render_check=True)
    # Observations have no bounds, which the checker takes for unwise, and `make` is what it would rather be called with.
    accepted = ("infinity", "different from the unwrapped version")
    others = [str(each.message) for each in found if not any(word in str(each.message) for word in accepted)]
    assert not others


def test_the_environment_passes_the_checks_of_stable_baselines():
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason=TORCH)
    checker.check_env(omniwalk.Env(changes=SMALL))


def test_stable_baselines_trains_on_many_robots():
    ppo = pytest.importorskip("stable_baselines3", reason=TORCH).PPO
    from stable_baselines3.common.vec_env import VecMonitor

    envs = omniwalk.VecEnv(8, changes=SMALL)
    assert envs.env_method("set_desired", (0.2, 0.0, 0.0)) == [None] * 8
    envs.seed(3)
    first = envs.reset()
    envs.seed(3)
    assert np.array_equal(envs.reset(), first)
    ended = []
    for _ in range(45):
        before = first
        first, rewards, dones, infos = envs.step(np.zeros((8, len(envs.joints))))
        assert not np.shares_memory(first, before)
        ended += [info for info, done in zip(infos, dones) if done]
        assert all(bool(info) == bool(done) for info, done in zip(infos, dones))
    assert ended and all(info["terminal_observation"].shape == first[0].shape for info in ended)
    assert any(info["TimeLimit.truncated"] for info in ended)
    model = ppo("MlpPolicy", VecMonitor(envs), n_steps=32, batch_size=64, n_epochs=1, seed=1, device="cpu")
    model.learn(512)
    assert model.num_timesteps == 512
    assert np.isfinite(model.ep_info_buffer[0]["r"])


def test_the_same_seed_gives_the_same_bits_with_any_number_of_threads():
    runs = [play(omniwalk.make_vec(20, changes=SMALL, threads=threads), 60) for threads in (1, 2)]
    assert all(np.array_equal(one, two) for one, two in zip(*runs))
    other = play(omniwalk.make_vec(20, changes=SMALL), 1, seed=6)
    assert not np.array_equal(other[0], runs[0][0])


def test_a_robot_alone_walks_as_among_others():
    changes = {**ROBOT, "task.random_first_length": False}
    env, envs = omniwalk.Env(changes=ROBOT), omniwalk.make_vec(3, changes=changes)
    (alone, _), (row, _) = env.reset(seed=9), envs.reset(seed=9)
    for _ in range(30):
        assert np.array_equal(alone, row[0])
        alone, reward, *_ = env.step(np.full(len(env.joints), 0.2))
        row, rewards, *_ = envs.step(np.full((3, len(env.joints)), 0.2))
        assert np.float32(reward) == rewards[0]


def test_a_reset_without_a_seed_starts_another_episode():
    env = omniwalk.Env(changes=ROBOT)
    seeded = [env.reset(seed=4)[0], env.reset()[0]]
    assert not np.array_equal(*seeded)
    again = [env.reset(seed=4)[0], env.reset()[0]]
    assert np.array_equal(seeded, again)


def test_episodes_end_in_the_step_that_begins_the_next():
    envs = gymnasium.make_vec("omniwalk.gym:omniwalk/Walk-v0", num_envs=6, changes=SMALL)
    assert isinstance(envs.unwrapped, omniwalk.VectorEnv)
    envs.reset(seed=1)
    ends = 0
    for _ in range(60):
        observations, _, terminated, truncated, infos = envs.step(np.ones(envs.action_space.shape, np.float32))
        ended = terminated | truncated
        ends += ended.sum()
        if ended.any():
            assert np.array_equal(infos["_final_obs"], ended)
            for e in np.flatnonzero(ended):
                assert not np.array_equal(infos["final_obs"][e], observations[e])
                assert (infos["final_info"]["end"][e] == "time_out") == truncated[e]
                assert infos["final_info"]["steps"][e] <= 40
        else:
            assert not infos
    assert ends >= 6


def test_the_policy_of_the_repository_walks_in_the_environment():
    controller = omniwalk.Controller(WALK / "policy.omni")
    env = omniwalk.Env(WALK / "seed-1/config.toml", {**ROBOT, "push.enabled": False})
    env.reset(seed=2)
    env.set_desired((0.3, 0.0, 0.0))
    observation, _ = env.reset()
    total = 0.0
    for step in range(400):
        observation, reward, terminated, truncated, info = env.step(2.0 * controller.act(observation) - 1.0)
        total += reward
        assert not terminated, f"fell in step {step}"
        assert np.isclose(reward, sum(info[name] for name in ("velocity", "pose", "alive", "foot", "action_rate", "slip", "tap")))
        assert np.array_equal(info["desired_velocity"], [0.3, 0.0, 0.0])
    # Standing still earns the pose and the alive term, 8 a second; walking as asked the velocity term, 42, too.
    assert total / 10.0 > 25.0


def test_nothing_is_copied_where_nothing_needs_to_be():
    envs = omniwalk.make_vec(4, changes=SMALL, copy=False)
    observations, _ = envs.reset(seed=1)
    before = observations.copy()
    actions = np.zeros(envs.action_space.shape, np.float32)
    again, rewards, *_ = envs.step(actions)
    assert np.shares_memory(observations, again) and not np.array_equal(before, observations)
    for array in (again, rewards):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    del envs, again, rewards
    gc.collect()
    assert np.isfinite(observations).all(), "the memory lives as long as its last array"
    kept = omniwalk.make_vec(4, changes=SMALL)
    first, _ = kept.reset(seed=1)
    second = kept.step(actions)[0]
    assert not np.shares_memory(first, second) and np.array_equal(first, before)


def test_python_goes_on_while_the_robots_are_stepped():
    envs = omniwalk.make_vec(64, changes={**ROBOT, "engine.kind": "rapier"}, threads=1)
    envs.reset(seed=1)
    actions = np.zeros(envs.action_space.shape, np.float32)
    beats, stepping, done = [], threading.Event(), threading.Event()

    def step() -> None:
        stepping.set()
        envs.unwrapped._batch.step(actions)
        done.set()

    thread = threading.Thread(target=step)
    thread.start()
    stepping.wait()
    began = time.perf_counter()
    while not done.is_set():
        beats.append(time.perf_counter() - began)
    thread.join()
    # With the lock held there would be no beat between the first moments and the end of the step.
    took = beats[-1]
    middle = [beat for beat in beats if 0.25 * took < beat < 0.75 * took]
    assert len(middle) > 10, f"{len(middle)} of {len(beats)} in the middle of {took:.3f} s"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: omniwalk.Env("missing.toml"), "cannot read missing.toml"),
        (lambda: omniwalk.Env(changes={"engine.kin": "lanes"}), "unknown key `engine.kin`.*did you mean `engine.kind`"),
        (lambda: omniwalk.Env(changes={"engine.kind": "mujoco"}), "the choices are"),
        (lambda: omniwalk.Env(changes={"ppo.gamma": 2.0}), r"`ppo.gamma` must be .*\[--set:1"),
        (lambda: omniwalk.Env(changes={"robot.path": "nowhere"}), "nowhere"),
        (lambda: omniwalk.Env(changes={"robot.path": str(ROOT / "robots/pendulum")}), "fixed base"),
        (lambda: omniwalk.make_vec(0, changes=ROBOT), "`train.environments` must be 1 to"),
        (lambda: omniwalk.Robot(ROOT / "configs"), "configs"),
        (lambda: omniwalk.Controller("missing.omni"), "cannot read missing.omni"),
        (lambda: omniwalk.Controller(b"OMNI"), "not a policy file"),
    ],
)
def test_errors_are_those_of_the_command_line(call, message):
    with pytest.raises(omniwalk.Error, match=f"(?s){message}") as found:
        call()
    assert "\x1b" not in str(found.value), "no colours"


def test_numbers_that_cannot_be_are_refused():
    envs = omniwalk.make_vec(2, changes=ROBOT)
    envs.reset(seed=1)
    actions = np.zeros(envs.action_space.shape, np.float32)
    actions[1, 3] = np.nan
    with pytest.raises(omniwalk.Error, match=f"the action of environment 1 for joint `{envs.joints[3]}` is NaN"):
        envs.step(actions)
    with pytest.raises(omniwalk.Error, match="above upper"):
        envs.set_command_range((0.5, 0.0, 0.0), (0.1, 0.0, 0.0))


def test_a_robot_tells_what_it_is():
    robot = omniwalk.Robot(ROBOT["robot.path"])
    assert robot.floating and len(robot.feet) == 2 and set(robot.joints) <= set(robot.all_joints)
    assert robot.mass > 1.0 and (robot.lower <= robot.nominal).all() and (robot.nominal <= robot.upper).all()
    assert robot.name in robot.describe() and all(name in robot.describe() for name in robot.joints)
