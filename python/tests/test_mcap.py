"""The Python packages for MCAP and ROS 2 read a rollout."""

import json
import math

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

STEPS = 80


@pytest.fixture(scope="module")
def rollout(sample_run):
    return sample_run / "rollouts" / "swing.mcap"


@pytest.fixture(scope="module")
def messages(rollout):
    """Decoded ROS messages by topic, each with its log time in seconds."""
    by_topic = {}
    with open(rollout, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        topics = ["/joint_states", "/joint_commands", "/imu", "/cmd_vel", "/odom"]
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=topics):
            by_topic.setdefault(channel.topic, []).append((message.log_time * 1e-9, decoded))
    return by_topic


def test_the_file_says_what_it_is(rollout):
    with open(rollout, "rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    channels = {channel.topic: channel for channel in summary.channels.values()}
    schemas = {topic: summary.schemas[channel.schema_id] for topic, channel in channels.items()}
    assert {topic: (schema.name, schema.encoding) for topic, schema in schemas.items()} == {
        "/joint_states": ("sensor_msgs/msg/JointState", "ros2msg"),
        "/joint_commands": ("sensor_msgs/msg/JointState", "ros2msg"),
        "/imu": ("sensor_msgs/msg/Imu", "ros2msg"),
        "/cmd_vel": ("geometry_msgs/msg/Twist", "ros2msg"),
        "/odom": ("nav_msgs/msg/Odometry", "ros2msg"),
        "/policy": ("omniwalk.PolicyStep", "jsonschema"),
    }
    assert all(channel.message_encoding == "cdr" for topic, channel in channels.items() if topic != "/policy")
    assert set(summary.statistics.channel_message_counts.values()) == {STEPS}
    assert metadata == {"omniwalk": {"seed": "7"}}


def test_joints_come_back(messages):
    assert len(messages["/joint_states"]) == STEPS
    for time, joints in messages["/joint_states"]:
        assert joints.header.frame_id == "base"
        assert joints.header.stamp.sec + joints.header.stamp.nanosec * 1e-9 == pytest.approx(time, abs=1e-9)
        assert joints.name == ["left_hip_pitch", "right_hip_pitch"]
        assert joints.position == pytest.approx([math.sin(time), -math.sin(time)], abs=1e-9)
        assert joints.velocity == pytest.approx([math.cos(time), -math.cos(time)], abs=1e-9)
        assert list(joints.effort) == []
    _, commands = messages["/joint_commands"][-1]
    assert (list(commands.position), list(commands.velocity)) == ([0.1, -0.1], [])


def test_base_and_command_come_back(messages):
    time, odom = messages["/odom"][-1]
    assert (odom.header.frame_id, odom.child_frame_id) == ("world", "base")
    assert odom.pose.pose.position.x == pytest.approx(0.4 * time)
    assert odom.pose.pose.orientation.w == 1.0
    assert list(odom.pose.covariance) == [0.0] * 36
    assert odom.twist.twist.linear.x == 0.4
    _, imu = messages["/imu"][0]
    assert (imu.orientation.w, imu.linear_acceleration.z) == (1.0, 9.81)
    _, command = messages["/cmd_vel"][0]
    assert (command.linear.x, command.angular.z) == (0.4, 0.0)


def test_policy_steps_are_json_of_their_schema(rollout):
    with open(rollout, "rb") as file:
        steps = [
            (json.loads(schema.data), json.loads(message.data))
            for schema, _, message in make_reader(file).iter_messages(topics=["/policy"])
        ]
    assert len(steps) == STEPS
    schema, step = steps[0]
    assert schema["type"] == "object"
    assert set(step) == set(schema["properties"])
    assert step == {"observation": [0.0, -0.0], "action": [0.5, 0.75], "reward": {"velocity": 0.9}}
