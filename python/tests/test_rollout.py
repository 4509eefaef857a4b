"""What `omniwalk eval` writes is read by the Python packages for MCAP and ROS 2."""

import json
import math

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

SECONDS, CONTROL_HZ = 2, 40


@pytest.fixture(scope="module")
def messages(trained_run):
    """Decoded messages of a rollout by topic, each with its log time in seconds."""
    by_topic = {}
    with open(trained_run / "rollouts" / "eval_0.20_0.00_0.00.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(
            topics=["/joint_states", "/joint_commands", "/imu", "/cmd_vel", "/odom"]
        ):
            by_topic.setdefault(channel.topic, []).append((message.log_time * 1e-9, decoded))
        steps = reader.iter_messages(topics=["/policy"])
        by_topic["/policy"] = [(message.log_time * 1e-9, json.loads(message.data)) for _, _, message in steps]
    return by_topic


def test_every_topic_has_a_message_a_control_step(messages):
    counts = {topic: len(entries) for topic, entries in messages.items()}
    steps = counts["/policy"]
    assert 1 <= steps <= SECONDS * CONTROL_HZ
    assert counts == dict.fromkeys(counts, steps) and len(counts) == 6
    for entries in messages.values():
        assert [time for time, _ in entries] == pytest.approx([step / CONTROL_HZ for step in range(steps)])


def test_joints_are_named_and_within_reach(messages):
    _, states = messages["/joint_states"][0]
    _, commands = messages["/joint_commands"][0]
    assert len(states.name) == 16 and "left_knee_pitch" in states.name and list(commands.name) == list(states.name)
    assert len(states.position) == len(states.velocity) == len(states.effort) == len(commands.position) == 16
    for topic in ("/joint_states", "/joint_commands"):
        assert all(abs(angle) < math.pi for _, joints in messages[topic] for angle in joints.position)


def test_the_base_starts_upright_at_the_height_of_the_robot(messages):
    _, odom = messages["/odom"][0]
    assert 0.5 < odom.pose.pose.position.z < 1.2
    assert odom.pose.pose.orientation.w == pytest.approx(1.0, abs=1e-6)
    for _, odom in messages["/odom"]:
        q = odom.pose.pose.orientation
        assert math.hypot(q.w, q.x, q.y, q.z) == pytest.approx(1.0, abs=1e-6)
    _, imu = messages["/imu"][0]
    assert imu.linear_acceleration.z == pytest.approx(9.81, abs=0.5)


def test_the_command_is_the_one_that_was_asked_for(messages):
    for _, command in messages["/cmd_vel"]:
        assert (command.linear.x, command.linear.y, command.angular.z) == (0.2, 0.0, 0.0)


def test_the_policy_saw_its_whole_layout_and_was_judged(messages):
    for _, step in messages["/policy"]:
        # 49 numbers of the thesis, the last targets, the tracking error and the clock's two.
        assert (len(step["observation"]), len(step["action"])) == (49 + 16 + 3 + 2, 16)
        assert all(0.0 <= action <= 1.0 for action in step["action"])
        assert {"velocity", "pose", "alive", "foot"} <= set(step["reward"])


def test_the_evaluation_is_json_of_the_same_run(trained_run):
    result = json.loads((trained_run / "eval.json").read_text())
    assert (result["engine"], result["robot"], result["conditions"]) == ("rapier", "nimbro_op2x", "randomised")
    (row,) = result["forward"]["rows"]
    assert (row["command"], row["episodes"]) == ([0.2, 0.0, 0.0], 1)
