"""The sealed walker: it walks as a body of its weight must, its faults change how, and a seed is a case."""

import json
import subprocess
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from sealed import closing, effects, generate, loop, track, walk_case
from sealed.commands import steady, tour
from sealed.effects import Case, Effect
from sealed.walk import STANDING, World


def world(*wrong: Effect) -> World:
    return World(walk_case.maker(), Case("single", list(wrong)), np.random.default_rng(0))


def walked(sealed: World, seconds: float, command=(0.3, 0.0, 0.0)):
    return sealed.walk(walk_case.policy(), steady(command), seconds, np.random.default_rng(1))


def positions(result) -> np.ndarray:
    return np.array([row["position"] for _, topic, row in result.log.rows if topic == "/joint_states"])


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_a_healthy_robot_walks_upright_on_its_own_weight_and_its_couplings_hold(monkeypatch):
    sealed, step = world(), mujoco.mj_step
    addresses = [[sealed.model.joint(f"{side}_{name}").qposadr[0] for name in names] for side in ("left", "right")
                 for names in (("knee_plate", "hip_pitch"), ("ankle_pitch", "knee_pitch"))]
    supports, strays = [], []

    def seen(model, data):
        step(model, data)
        # Constraints of joints do not act on where the base is: what is left is the ground.
        supports.append(float(data.qfrc_constraint[2]))
        strays.append(max(abs(data.qpos[follower] + data.qpos[leader]) for follower, leader in addresses))

    monkeypatch.setattr(mujoco, "mj_step", seen)
    result = walked(sealed, 4.0)
    assert not result.fell and result.seconds == 4.0
    assert result.error[0] < 0.1 and result.error[1] < 0.15
    weight = 9.81 * sealed.model.body_mass.sum()
    assert np.mean(supports[-round(3.5 * 4000) :]) == pytest.approx(weight, rel=0.02)
    assert max(supports) > 1.2 * weight and max(strays) < 2e-3


@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_world_that_comes_apart_in_its_steps_is_made_in_finer_ones(tmp_path, monkeypatch):
    monkeypatch.setattr(walk_case, "LOGS", [("fit", 1)])
    with pytest.raises(FloatingPointError, match="broke"):
        walked(walk_case.world(606), 0.4)
    truth = walk_case.write(606, tmp_path, 0.4)
    assert [effect["name"] for effect in truth["case"]["effects"]] == ["backlash", "sensor_offset"]
    assert all(walk["seconds"] == 0.4 and not walk["fell"] for walk in truth["walks"].values())


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("command_gain", {"gain": 0.9}),
        ("backlash", {"gap": 0.02}),
        ("coulomb_friction", {"torque": 2.0}),
        ("payload", {"mass": 0.8}),
        ("thermal_drift", {"torque": 4.0, "time_constant": 2.0}),
    ],
)
def test_what_is_wrong_changes_the_walk(name, parameters):
    healthy, faulty = (
        positions(walked(sealed, 0.7)) for sealed in (world(), world(Effect(name, "left_knee_pitch", parameters)))
    )
    rows = min(len(healthy), len(faulty))
    assert np.abs(healthy[:rows] - faulty[:rows]).max() > 0.01


def test_a_fall_ends_the_log():
    result = walked(world(Effect("supply_voltage", "left_knee_pitch", {"ratio": 0.05})), 6.0)
    assert result.fell and STANDING < result.seconds < 6.0
    assert max(time for time, _, _ in result.log.rows) < result.seconds + 0.05


def test_a_seed_makes_the_same_case_again_and_logs_hold_no_truth(tmp_path):
    made = [generate.generate("walk", 1, tmp_path / part, 0.4) for part in ("one", "two")]
    assert files(made[0]) == files(made[1])
    assert {str(Path(name).parent) for name in files(made[0])} == {"robot", "fit", "heldout"}
    assert all("command_delay" not in name and b"command_delay" not in content for name, content in files(made[0]).items())
    truth = json.loads((tmp_path / "one" / "truth" / "walk-0001.json").read_text())
    assert truth["case"]["effects"][0]["name"] == "command_delay"
    assert truth["walks"]["fit/00-tour"] == {"seconds": 0.4, "fell": False, "error": None}
    assert set(truth["floor"]["heldout/01-tour"]) == set(truth["servos"])
    messages = [item.ros_msg for item in read_ros2_messages(made[0] / "fit" / "00-tour.mcap", topics=["/imu"])]
    assert len(messages) == pytest.approx(0.4 * 195, abs=6)
    # It stands: specific force is up, and so is the trunk.
    force = np.mean([message.linear_acceleration.z for message in messages[:40]])
    assert force == pytest.approx(9.81, abs=0.3) and abs(messages[0].orientation.w) > 0.999
    states, sent = (
        list(read_ros2_messages(made[0] / "fit" / "00-tour.mcap", topics=[topic]))
        for topic in ("/joint_states", "/joint_commands")
    )
    assert len(states) == pytest.approx(0.4 * 195, abs=6) and len(sent) == pytest.approx(16, abs=1)


def test_faults_are_at_leg_joints_and_none_needs_friction_that_the_maker_does_not_know():
    carriers = walk_case.maker().carriers()
    assert len(carriers) == 10 and not any("shoulder" in name or "elbow" in name for name in carriers)
    scales = walk_case.typical()
    cases = [
        effects.draw_case(seed, np.random.default_rng(seed), carriers, scales, effects.WALKING) for seed in range(80)
    ]
    found = {effect.name for case in cases for effect in case.effects}
    assert found == set(effects.WALKER_INSIDE) | set(effects.WALKER_OUTSIDE) and "directional_friction" not in found
    assert {effect.joint for case in cases for effect in case.effects} <= set(carriers)


def test_tours_go_every_way_and_differ():
    times = np.arange(0.0, 8.0, 0.1)
    tours = [np.array([tour(np.random.default_rng(seed), 8.0)(time) for time in times]) for seed in (0, 1)]
    assert not np.array_equal(*tours)
    for going in tours:
        assert not going[times < 1.0].any() and (np.abs(going).max(axis=0) > 0.15).all()
        assert np.abs(going).max() <= 0.5


def test_errors_count_what_is_off_after_the_ramp_and_a_second():
    meter, desired = track.Track(40), np.array([0.4, 0.0, 0.2])
    for step in range(200):
        commanded = desired * min(step / 40, 1.0)
        sway = 0.2 * np.sin(2 * np.pi * step / 20)
        meter.add(np.array([0.37, 0.04 + sway, 0.1]), commanded, desired)
    assert meter.error() == (pytest.approx(0.05, abs=1e-9), pytest.approx(0.1, abs=1e-9))
    assert len(meter.errors) == 200 - 41 - 39
    turned = [np.cos(0.5), 0.0, 0.0, np.sin(0.5)]
    seen = track.velocity(np.array(turned), np.array([np.cos(1.0), np.sin(1.0), 0.3]), np.array([0.0, 0.0, 0.7]))
    assert seen == pytest.approx([1.0, 0.0, 0.7])


def test_plays_are_summed_up(tmp_path):
    plays = [
        loop.Play((0.0, 0.0, 0.0), 0, False, 10.0, 0.02, 0.03),
        loop.Play((0.0, 0.0, 0.0), 1, True, 2.0, None, None),
        loop.Play((0.6, 0.0, 0.0), 0, True, 4.0, 0.06, 0.05),
    ]
    table = loop.table(plays)
    assert "| 0.0, 0.0, 0.0 | 1 of 2 | 2.0 | 0.020 | 0.030 |" in table
    assert "| all | 2 of 3 | 3.0 | 0.040 | 0.040 |" in table
    content = json.loads(loop.write(plays, Path("some/policy.omni"), 1000, tmp_path).read_text())
    assert content["totals"]["falls"] == 2 and len(content["walks"]) == 3


def test_both_worn_knees_have_play_friction_and_a_delay_and_a_seed_says_how_much():
    typical = {joint: {"coulomb_friction.torque": 10.0} for joint in effects.WORN_KNEES}
    first, again, other = (effects.draw_worn(np.random.default_rng(seed), typical) for seed in (0, 0, 1))
    assert first.effects == again.effects != other.effects
    named = {(effect.name, effect.joint) for effect in first.effects}
    assert named == {(name, joint) for name in effects.WORN for joint in effects.WORN_KNEES}
    assert all(5.0 <= effect.get("torque") <= 10.0 for effect in first.effects if effect.name == "coulomb_friction")


def without_worlds(monkeypatch, called, totals):
    """Closes loops without a world: `called` for the program, `totals` for every walk."""
    monkeypatch.setattr(closing.Closing, "_call", called)
    monkeypatch.setattr(closing, "ensure", lambda machine, seed, out, walker: out / "cases" / f"{machine}-{seed:04d}")
    monkeypatch.setattr(closing.loop, "play", lambda *_, **__: [])
    monkeypatch.setattr(closing.loop, "totals", lambda _: totals)


def test_the_loop_is_closed_once_and_goes_on_where_it_stopped(tmp_path, monkeypatch):
    totals = {"walks": 20, "falls": 3, "velocity_error": 0.2, "turn_error": None}
    calls = []

    def called(self, *arguments):
        calls.append([str(argument) for argument in arguments])
        made = Path(arguments[arguments.index("--out") + 1 if "--out" in arguments else arguments.index("--run") + 1])
        if arguments[0] == "identify":
            (made / "robot").mkdir(parents=True)
            (made / "report.json").write_text(json.dumps({"verdict": "explained", "accepted": []}))
        elif arguments[0] == "train":
            made.mkdir(exist_ok=True)
            if "with" == made.name and len([call for call in calls if "train" in call]) < 3:
                raise KeyboardInterrupt
        else:
            made.touch()

    without_worlds(monkeypatch, called, totals)
    closed = closing.Closing(["omniwalk"], tmp_path / "run", tmp_path / "out", 1000)
    with pytest.raises(KeyboardInterrupt):
        closed.world(3, tmp_path / "results")
    closed.world(3, tmp_path / "results")
    closed.world(3, tmp_path / "results")
    trained = [call for call in calls if call[0] == "train"]
    robot = f'robot.path="{(tmp_path / "out/worn-0003/found/robot").resolve()}"'
    assert [robot in call for call in trained] == [False, True, False] and "--resume" in trained[2]
    assert [call[0] for call in calls].count("identify") == 1
    rows = closing.table(tmp_path / "results").splitlines()
    assert len(rows) == 5 and rows[2] == "| worn-0003 | as it was | 3 of 20 | 0.200 | - |"


def test_a_world_whose_logs_carry_no_answer_is_closed_without_one(tmp_path, monkeypatch):
    trained = []

    def called(self, *arguments):
        if arguments[0] == "identify":
            found = Path(arguments[arguments.index("--out") + 1])
            found.mkdir()
            (found / "report.json").write_text(json.dumps({"verdict": "insufficient_data"}))
            raise subprocess.CalledProcessError(2, "omniwalk")
        if arguments[0] == "train":
            trained.append(arguments)
            Path(arguments[arguments.index("--run") + 1]).mkdir()

    without_worlds(monkeypatch, called, {"walks": 20, "falls": 20, "velocity_error": None, "turn_error": None})
    closing.Closing(["omniwalk"], tmp_path / "run", tmp_path / "out", 1000).world(0, tmp_path / "results")
    assert len(trained) == 1 and "engine.physics_hz=1000" in trained[0]
    rows = closing.table(tmp_path / "results").splitlines()
    assert rows[3:] == [
        "| worn-0000 | trained on, nominal robot | 20 of 20 | - | - |",
        "| worn-0000 | trained on, identified robot | no answer | - | - |",
    ]
