"""The forward task as MuJoCo's users would write it is the task of the project's environments: the same numbers along the walk of the
repository's policy, which `omniwalk eval` wrote down without noise and latency."""

import itertools
import json
import shutil
import subprocess
import warnings
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from baselines import files, page, settings
from baselines.judge import Judge, Truth, heading
from baselines.walk import Tracking, Walk
from programs import ROOT, program

POLICY = ROOT / "runs/nimbro_op2x_omni/policy.omni"
COMMAND = (0.3, 0.2, -0.3)
STILL = {
    "noise": {"enabled": False},
    "latency": {"enabled": False},
    "push": {"enabled": False},
    "friction": {"enabled": False},
    "randomise": {"pd_noise": 0.0, "mass": 0.0, "centre_of_mass": 0.0, "start_position": 0.0},
    "reward": {"tap_weight": 0.0},
}
"""A walk without anything random but its command. Taps, which the forward task does not price, are not judged."""

READINGS = 1e-6
"""Readings are in single precision: some roundings of numbers of order one. The velocity estimate weights corners by their height on
a scale of 4 mm, so that"""

VELOCITY = 1e-4
"""m/s is what 1e-7 m of height may change where corners move by some m/s against each other."""

REWARD = 2e-4
"""Terms are of order one a step and change by less than 100 per rad, m or m/s; joints are known to 1e-7 rad, so soles at the end of
a leg and their speed over a step to some 1e-6 m/s."""


@pytest.fixture(scope="module")
def walked(tmp_path_factory) -> SimpleNamespace:
    """States, observations, actions, targets and rewards of a walk in rapier, an entry a control step."""
    folder = tmp_path_factory.mktemp("walked")
    (folder / "policy.omni").write_bytes(POLICY.read_bytes())
    command = ["eval", str(folder / "policy.omni"), "--nominal", "--episodes", "1", "--seconds", "8"]
    command += ["--set", f"eval.commands=[{list(COMMAND)}]"]
    subprocess.run([*program("omniwalk"), *command], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    (rollout,) = folder.glob("**/*.mcap")
    found = {"/joint_states": [], "/joint_commands": [], "/odom": [], "/policy": []}
    with rollout.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, content in reader.iter_decoded_messages(topics=[topic for topic in found if topic != "/policy"]):
            found[channel.topic].append(content)
        for _, _, message in reader.iter_messages(topics=["/policy"]):
            found["/policy"].append(json.loads(message.data))
    return SimpleNamespace(joints=found["/joint_states"], targets=found["/joint_commands"], odometry=found["/odom"], steps=found["/policy"])


@pytest.fixture(scope="module")
def walk() -> Walk:
    """The environment under the configuration that the policy was trained with."""
    return Walk(ROOT / "runs/nimbro_op2x_omni/seed-1/config.toml", STILL)


def states(walked: SimpleNamespace, walk: Walk):
    """The true states, and what sensors without noise say of them."""
    data, layout = walk.data, walk.observer.layout
    for joints, odometry in zip(walked.joints, walked.odometry):
        assert list(joints.name) == layout.joints
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        data.qpos[:7] = place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z
        data.qpos[7:] = layout.ratios @ np.array(joints.position) + layout.offsets
        data.qvel[6:] = layout.ratios @ np.array(joints.velocity)
        mujoco.mj_kinematics(walk.model, data)
        linear, angular = odometry.twist.twist.linear, odometry.twist.twist.angular
        rotation = data.xmat[1].reshape(3, 3)
        data.qvel[:3] = rotation @ [linear.x, linear.y, linear.z]
        data.qvel[3:6] = angular.x, angular.y, angular.z
        truth = walk.truth_now()
        yield truth, walk.measure(truth)


def first_phase(walked: SimpleNamespace, walk: Walk) -> float:
    """Where the clock started: the policy that looks into the mirror is told to walk to the other side."""
    desired = sum(len(part) for part in walk.observer.parts[: walk.observer.blocks.index("desired_velocity")])
    return 0.0 if walked.steps[0]["observation"][desired + 1] * COMMAND[1] > 0.0 else 0.5


def test_observation_and_targets_are_those_of_the_controller(walked, walk):
    observer = walk.observer
    observer.reset(first_phase(walked, walk))
    velocities = [observer.blocks.index(name) for name in ("velocity_inertial", "velocity_base")]
    mirrored = 0
    for step, target, (_, readings) in zip(walked.steps, walked.targets, states(walked, walk)):
        mirrored += observer.mirrored
        found = observer.observe(readings, np.array(COMMAND))
        bounds = np.full(observer.width, READINGS * 10.0)
        starts = np.cumsum([0, *(len(block) for block in observer.parts)])
        for block in velocities:
            bounds[starts[block] : starts[block + 1]] = VELOCITY
        error = np.abs(found - step["observation"])
        assert (error <= bounds).all(), f"entry {np.argmax(error / bounds)} differs by {error.max()}"
        targets = observer.decode(2.0 * np.array(step["action"]) - 1.0)
        assert np.abs(targets - target.position).max() < READINGS
    assert 100 < mirrored < 220, "the policy looked into the mirror in every second half of a cycle"


def test_rewards_are_those_of_the_environment(walked, walk):
    observer, found = walk.observer, states(walked, walk)
    judge = Judge(walk.config, observer.layout.nominal, walk.base_height)
    observer.reset(first_phase(walked, walk))
    truth, readings = next(found)
    judge.reset(heading(truth.rotation))
    observer.observe(readings, np.array(COMMAND))
    slipped = 0
    for step, (after, readings) in zip(walked.steps, found):
        commanded = observer.commanded
        observer.decode(2.0 * np.array(step["action"]) - 1.0)
        observer.observe(readings, np.array(COMMAND))
        moved = (((after.soles - truth.soles)[:, :2] * walk.hz) ** 2).sum(axis=1)
        terms = judge.terms(after, commanded, observer.frame_was_set, float(observer.phase), 0.0)
        truth = after
        for name in ("velocity", "pose", "alive", "foot"):
            assert abs(terms[name] - step["reward"][name]) < REWARD, f"{name}: {terms[name]} for {step['reward'][name]}"
        # Which soles were loaded is not written down: one of the four cases it is.
        price = walk.config["reward"]["slip_weight"] / walk.hz
        cases = [-price * float(np.dot(loaded, moved)) for loaded in itertools.product((0, 1), repeat=2)]
        assert min(abs(case - step["reward"]["slip"]) for case in cases) < REWARD * (1.0 + moved.max())
        slipped += step["reward"]["slip"] < 0.0
    assert slipped > 100


def test_velocity_errors_are_those_of_the_evaluation(walked, walk):
    meter, observer = Tracking(walk.hz), walk.observer
    observer.reset(0.0)
    for k, (truth, readings) in enumerate(states(walked, walk)):
        if k:
            meter.step(truth, commanded, bool(np.abs(commanded - COMMAND).max() < 1e-4))
        observer.observe(readings, np.array(COMMAND))
        commanded = observer.commanded
    errors = meter.errors()
    # The walk follows its command: an error of the whole command would be some 0.4.
    assert 0.0 < errors["error_xy_mps"] < 0.15 and 0.0 < errors["error_yaw_radps"] < 0.15


def test_the_environment_in_mujoco_passes_gymnasiums_checks():
    with warnings.catch_warnings():
        # Observations have no bounds, which the checker takes for unwise.
        warnings.simplefilter("ignore")
        check_env(Walk(), skip_render_check=True)


def test_what_is_not_written_twice_is_refused():
    with pytest.raises(ValueError, match=r"\[action\].*increment_on_target"):
        Walk(changes={"action": {"law": "increment_on_target"}})
    with pytest.raises(ValueError, match="action_rate_weight"):
        Walk(changes={"reward": {"action_rate_weight": 1.0}})


def test_episodes_in_mujoco_end_as_the_task_says():
    walk = Walk(changes={"task": {"random_first_length": False, "episode_seconds": 2.0}, "push": {"enabled": False}})
    walk.reset(seed=1)
    for step in range(1, 81):
        *_, terminated, truncated, info = walk.step(np.zeros(walk.action_space.shape))
        assert not terminated and truncated == (step == 80)
    assert info["episode_end"]["end"] == "time_out" and info["episode_end"]["steps"] == 80
    random, ends = np.random.default_rng(1), set()
    walk.reset()
    for _ in range(600):
        *_, terminated, truncated, info = walk.step(random.uniform(-1.0, 1.0, walk.action_space.shape))
        if terminated or truncated:
            ends.add(info["episode_end"]["end"])
            walk.reset()
    assert ends & {"fallen", "leg_overlap"}


def test_a_checkpoint_is_whole_whenever_its_writer_is_stopped(tmp_path):
    folder = tmp_path / "checkpoint"
    assert files.load(folder) is None

    def fill(number: int):
        return lambda draft: (draft / "model").write_text(str(number)) and {"number": number}

    def interrupted(draft):
        (draft / "model").write_text("half")
        raise KeyboardInterrupt

    files.save(folder, fill(1))
    with pytest.raises(KeyboardInterrupt):
        files.save(folder, interrupted)
    assert files.load(folder) == {"number": 1} and (folder / "model").read_text() == "1"
    # Stopped between the two renamings: the draft is whole.
    shutil.rmtree(tmp_path / "checkpoint.draft")
    files.save(tmp_path / "other", fill(2))
    (tmp_path / "other").rename(tmp_path / "checkpoint.draft")
    assert files.load(folder) == {"number": 2} and (folder / "model").read_text() == "2"


def test_the_hyper_parameters_are_read_from_the_configuration():
    config = settings.task()
    assert config["command"]["upper"] == [0.5, 0.0, 0.0] and config["command"]["rate"] == [0.5, 0.5, 1.0]
    assert config["train"]["environments"] * config["train"]["steps_per_update"] % config["ppo"]["minibatch"] == 0


def test_the_page_is_what_its_command_makes_of_the_results(tmp_path, monkeypatch):
    committed = page.PAGE.read_text(), page.PICTURE.read_text()
    monkeypatch.setattr(page, "PAGE", tmp_path / "baselines.md")
    monkeypatch.setattr(page, "PICTURE", tmp_path / "baselines.svg")
    page.main()
    assert (page.PAGE.read_text(), page.PICTURE.read_text()) == committed, "make it anew: python3 -m baselines.page"
