"""The controller through the binding does what the policy file says: the golden vectors, and a second implementation in double
precision that was written from the page on the format."""

import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import omniwalk
from omniwalk_reference import policy_file
from omniwalk_reference.walker import Walker, act
from programs import ROOT, program

STEPS = 1000
# What the project promises; single precision takes some 1e-6 of it.
TOLERANCE = 1e-5
TRAINED = ROOT / "runs/nimbro_op2x_omni/policy.omni"

VARIANTS = {
    "thesis": ["configs/thesis.toml"],
    "increments": [
        *("--set", "action.law=increment_on_target", "--set", "action.scale=0.1", "--set", "action.filter.enabled=false"),
        *("--set", "clock.symmetric=false", "--set", "clock.period=0.7", "--set", "ppo.activation=elu"),
    ],
    "gaussian": ["--set", "ppo.policy=gaussian", "--set", "ppo.activation=relu", "--set", "observation.true_velocity=true"],
}
"""Runs that differ in what the walk of the repository has one of."""


@pytest.fixture(scope="module")
def policies(tmp_path_factory) -> dict[str, Path]:
    """Policy files: one that walks, the same in int8, and hardly trained ones of other kinds."""
    folder = tmp_path_factory.mktemp("policies")

    def call(*arguments) -> None:
        subprocess.run([*program("omniwalk"), *map(str, arguments)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)

    files = {"trained": TRAINED, "int8": folder / "int8.omni"}
    call("export", TRAINED, "--format", "int8", "--out", files["int8"])
    small = ["--steps", "160", "--quiet", "--set", "train.environments=4", "--set", "train.steps_per_update=20"]
    for name, arguments in VARIANTS.items():
        run, files[name] = folder / name, folder / f"{name}.omni"
        call("train", *arguments, "--run", run, *small)
        call("export", run, "--out", files[name])
    return files


def readings(policy: SimpleNamespace, given: bool) -> list[SimpleNamespace]:
    """Readings of a robot that moves all its joints, sways and turns, under changing commands; the velocity of its base is
    `given` or to be estimated."""
    spec, random = policy.spec, np.random.default_rng(7)
    n = len(spec.names)
    middle, half = 0.5 * (spec.lower + spec.upper), 0.5 * (spec.upper - spec.lower)
    amplitude = np.minimum(0.4, 0.9 * half)
    centre = np.clip(spec.nominal, middle - half + amplitude, middle + half - amplitude)
    rate, phase = random.uniform(0.5, 12.0, n), random.uniform(0.0, 6.0, n)
    found = []
    for k in range(STEPS):
        if k % 90 == 0:
            desired = random.uniform(-0.9, 0.9, 3)
        t = k / spec.control_hz
        row = SimpleNamespace(
            position=centre + amplitude * np.sin(rate * t + phase) + random.normal(0.0, 1e-3, n),
            velocity=amplitude * rate * np.cos(rate * t + phase) + random.normal(0.0, 1e-2, n),
            attitude=0.9 * spec.upright * np.sin([3.0 * t, 2.0 * t + 1.0]),
            gyro=np.array([0.5, 0.4, 1.5]) * np.sin([5.0 * t, 4.0 * t, 0.3 * t + 0.5]),
            base_velocity=random.normal(0.0, 0.4, 3) if given else None,
            desired=desired,
        )
        found.append(SimpleNamespace(**{key: single(value) for key, value in vars(row).items()}))
    return found


def single(value):
    """Numbers that single precision has, so that both sides read the same ones."""
    return None if value is None else value.astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("given", [False, True], ids=["estimated", "given"])
@pytest.mark.parametrize("name", ["trained", "int8", *VARIANTS])
def test_a_second_implementation_gives_the_same_targets_over_a_thousand_steps(policies, name, given):
    controller = omniwalk.Controller(policies[name])
    policy = policy_file.read(policies[name].read_bytes())
    walker = Walker(policy)
    walker.reset(0.0)
    controller.reset(0.0)
    misses, targets = [], []
    for k, row in enumerate(readings(policy, given)):
        now = k * controller.period
        found, status = controller.step(now, now, **vars(row))
        assert (status.mode, status.fault) == ("walking", None)
        expected = walker.step(row)
        misses.append(np.abs(found - expected).max())
        targets.append(expected)
    assert np.ptp(targets, axis=0).min() > 1e-2, "every joint is moved"
    assert max(misses) < TOLERANCE, f"step {int(np.argmax(misses))}"


@pytest.mark.parametrize("name", ["trained", "int8", *VARIANTS])
def test_the_golden_vectors_come_out(policies, name):
    controller = omniwalk.Controller(policies[name])
    controller.verify()
    golden = controller.golden()
    policy = policy_file.read(policies[name].read_bytes())
    for observation, action in golden["actions"]:
        # The bound that the page gives to readers.
        assert np.allclose(controller.act(observation), action, rtol=1e-4, atol=1e-4)
        assert np.allclose(act(policy, observation.astype(float)), action, rtol=1e-4, atol=1e-4)
    controller.reset(golden["clock_phase"])
    for k, step in enumerate(golden["steps"]):
        observation, targets = step.pop("observation"), step.pop("targets")
        found, _ = controller.step(k * controller.period, k * controller.period, **step)
        assert np.allclose(controller.observation, observation, rtol=1e-4, atol=1e-4)
        assert np.allclose(found, targets, rtol=1e-4, atol=1e-4)


def test_a_damaged_file_is_refused_by_both_readers():
    data = bytearray(TRAINED.read_bytes())
    data[len(data) // 2] ^= 1
    with pytest.raises(omniwalk.Error, match="damaged"):
        omniwalk.Controller(bytes(data))
    with pytest.raises(ValueError, match="damaged"):
        policy_file.read(bytes(data))


def still(controller: omniwalk.Controller) -> dict:
    """A robot that stands in the nominal pose."""
    zeros = np.zeros(len(controller.joints), np.float32)
    return {
        "position": controller.nominal,
        "velocity": zeros,
        "attitude": [0.0, 0.0],
        "gyro": (0.0, 0.0, 0.0),
        "desired": np.array([0.2, 0.0, 0.0]),
    }


def test_readings_by_name_give_targets_by_name_in_whatever_order_they_are():
    ordered, named = omniwalk.Controller(TRAINED), omniwalk.Controller(TRAINED)
    readings = still(ordered)
    readings["position"] = readings["position"] + np.linspace(-0.05, 0.05, len(ordered.joints), dtype=np.float32)
    targets, _ = ordered.step(0, 0, **readings)
    for reading in ("position", "velocity"):
        values = dict(zip(reversed(named.joints), reversed(readings[reading].tolist())))
        readings[reading] = {**values, "head_pan": 0.3}
    by_name, status = named.step(0, 0, **readings)
    assert status.ok
    assert list(by_name) == named.joints
    assert np.array_equal(np.array(list(by_name.values()), np.float32), targets)


def test_joints_that_do_not_fit_are_named():
    controller = omniwalk.Controller(TRAINED)
    names = controller.joints
    controller.check_joints(names)
    shuffled = [names[-1], *names[:-1]]
    with pytest.raises(omniwalk.Error, match=f"joint `{names[0]}` expected at index 0, robot has it at 1"):
        controller.check_joints(shuffled)
    assert [shuffled[place] for place in controller.joint_map(shuffled)] == names
    with pytest.raises(omniwalk.Error, match=f"joint `{names[2]}`, which the robot does not have"):
        controller.joint_map(names[:2] + names[3:])
    readings = still(controller)
    readings["position"] = dict.fromkeys(names[1:], 0.0)
    with pytest.raises(omniwalk.Error, match=f"position has no entry for joint `{names[0]}`"):
        controller.step(0, 0, **readings)


def test_a_position_that_is_no_number_is_refused_with_its_joint():
    controller = omniwalk.Controller(TRAINED)
    readings = still(controller)
    readings["position"] = dict.fromkeys(controller.joints, "bent")
    with pytest.raises(omniwalk.Error, match=f"position of joint `{controller.joints[0]}` must be a number, not 'bent'"):
        controller.step(0, 0, **readings)


def test_the_policy_fits_its_robot_and_no_other():
    controller = omniwalk.Controller(TRAINED)
    robot = omniwalk.Robot(ROOT / "robots/nimbro_op2x")
    controller.check_robot(robot)
    assert robot.joints == controller.joints
    assert np.allclose(robot.kp, controller.kp) and np.allclose(robot.nominal, controller.nominal)
    with pytest.raises(omniwalk.Error, match="the policy"):
        controller.check_robot(omniwalk.Robot(ROOT / "robots/nimbro_op2x_small"))


def test_a_status_says_what_is_wrong():
    controller = omniwalk.Controller(TRAINED)
    readings, period = still(controller), controller.period
    targets, status = controller.step(0, 0, **readings)
    assert status.ok and status.mode == "walking" and status.fault is None
    again, status = controller.step(period // 4, period // 4, **readings)
    assert status.fault == "over_rate" and np.array_equal(again, targets)
    held, status = controller.step(period, period, **{**readings, "gyro": [0.0, np.nan, 0.0]})
    assert (status.mode, status.fault, status.message) == ("holding", "not_finite", "gyro[y] is not a finite number")
    assert np.array_equal(held, targets)
    _, status = controller.step(2 * period, 2 * period, **{**readings, "desired": [5.0, 0.0, 0.0]})
    assert status.command == "clipped" and status.mode == "walking"
    assert status.message == "the desired velocity is clipped to what was trained"
    _, status = controller.step(3 * period, 3 * period, **{**readings, "gyro": [0.0, 0.0, 500.0]})
    assert status.out_of_range.name.startswith("gyro") and status.out_of_range.excess > 400.0
    _, status = controller.step(5 * period, 0, **readings)
    assert (status.fault, status.message) == ("stale", "the newest reading is 0.125 s old; the step came 0.025 s late")
    _, status = controller.step(6 * period, 6 * period, **{**readings, "attitude": [2.0, 0.0]})
    assert status.fault == "fallen" and not status.ok
    controller.take_over(controller.nominal + 0.1)
    _, status = controller.step(7 * period, 7 * period, **readings)
    assert status.mode == "ramping"


@pytest.mark.parametrize("position", [np.nan, np.inf, 1e9])
def test_positions_that_cannot_be_are_not_taken_over(position):
    controller = omniwalk.Controller(TRAINED)
    readings, period = still(controller), controller.period
    before, _ = controller.step(0, 0, **readings)
    lost = readings["position"].copy()
    lost[3] = position
    with pytest.raises(omniwalk.Error, match=rf"^position\[{controller.joints[3]}\] is "):
        controller.take_over(lost)
    for k in range(1, 40):
        targets, status = controller.step(k * period, k * period, **{**readings, "position": lost})
        assert status.mode == "holding" and status.fault in ("not_finite", "absurd")
        assert np.array_equal(targets, before), "what was told last"
    away = readings["position"] + 0.1
    targets, status = controller.step(40 * period, 40 * period, **{**readings, "position": away})
    assert status.mode == "ramping" and np.abs(targets - away).max() < 0.02


def test_results_are_written_where_they_are_wanted():
    controller = omniwalk.Controller(TRAINED)
    out = np.zeros(len(controller.joints), np.float32)
    targets, _ = controller.step(0, 0, **still(controller), out=out)
    assert targets is out and np.any(out)
    observations = np.random.default_rng(1).standard_normal((3, 4, len(controller.observation_names))).astype(np.float32)
    actions = np.empty((3, 4, len(out)), np.float32)
    assert controller.act(observations, out=actions) is actions
    assert np.array_equal(controller.act(observations[1, 2]), actions[1, 2])
    assert np.array_equal(controller.act(observations[:, ::2]), actions[:, ::2]), "also of arrays with gaps"
    assert np.array_equal(controller.act(np.asfortranarray(observations)), actions), "and in another order"
    portable = omniwalk.Controller(TRAINED, portable=True)
    assert np.allclose(portable.act(observations), actions, atol=1e-5)
