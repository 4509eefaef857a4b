"""`omniwalk view`: who may ask, what a request may reach, the robot that is driven, its recordings, and Foxglove."""

import http.client
import io
import json
import math
import socket
import struct
import subprocess
import xml.etree.ElementTree as ElementTree

import pytest
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from programs import ROOT, program
from viewing import POLICY, viewing

SCHEMAS = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_commands": "sensor_msgs/msg/JointState",
    "/imu": "sensor_msgs/msg/Imu",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/robot_description": "std_msgs/msg/String",
}


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    with viewing(POLICY, "--out", tmp_path_factory.mktemp("recordings")) as view:
        yield view


def status(view, path: str) -> int:
    """The status of a request for `path` exactly as it is written."""
    connection = http.client.HTTPConnection(view.host, view.port, timeout=60)
    connection.putrequest("GET", path, skip_accept_encoding=True)
    connection.endheaders()
    response = connection.getresponse()
    response.read()
    connection.close()
    return response.status


def test_only_who_has_the_token_gets_anything_but_the_page(view):
    assert status(view, "/") == status(view, "/three.js") == 200
    for path in ("robot", "clips", "clips/0", "clips/0/log", "drive"):
        for query in ("", "?token=", "?token=" + "0" * 32, f"?token={view.token}0", f"?tok={view.token}"):
            assert status(view, f"/api/{path}{query}") == 403, path + query
    assert status(view, f"/api/robot?token={view.token}") == 200
    with pytest.raises(WebSocketException), connect(view.url("drive", "ws")[:-1]):
        pass


def test_no_request_leaves_the_page_and_its_logs(view):
    token = f"?token={view.token}"
    for path in (
        *("/../Cargo.toml", "/..%2f..%2fCargo.toml", "/%2e%2e/Cargo.toml", "//etc/passwd", "/web/index.html", "/vendor/LICENSE"),
        *(f"/api/clips/{index}{token}" for index in ("0", "-1", "99999999999999999999", "..%2f..", "../robot", "0%00")),
        *(f"/api/clips/0/{name}{token}" for name in ("..", "log", "%2e%2e%2flog", "log/../../../../etc/passwd")),
    ):
        assert status(view, path) in (400, 404), path


def test_it_listens_on_this_machine_alone(view):
    others = {entry[4][0] for entry in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        # No packet is sent: the system says which of its addresses it would use.
        probe.connect(("192.0.2.1", 9))
        others.add(probe.getsockname()[0])
    except OSError:
        pass
    for address in (other for other in others if not other.startswith("127.")):
        for port in (view.port, int(view.foxglove.rsplit(":", 1)[1])):
            with pytest.raises(OSError):
                socket.create_connection((address, port), timeout=5).close()


def test_orders_that_are_none_are_answered_and_harm_nothing(view):
    with view.drive() as drive:
        for order in ("", "{", "[]", '{"type": "walk"}', '{"type": "push", "force": [1e6, 0]}', '{"type": "set"}', "é" * 200):
            drive.socket.send(order)
            assert drive.next("error")["why"], order
        drive.socket.send(b"\0" * 100)
        assert "texts" in drive.next("error")["why"]
        drive.next("row")
        # One that is too long ends its own connection.
        with view.drive() as other:
            with pytest.raises(WebSocketException):
                other.socket.send("x" * 100_000)
                while True:
                    other.socket.recv(timeout=60)
        assert drive.next("report")["falls"] == 0
        row = drive.next("row")
        assert drive.next("row", lambda later: later["time"] > row["time"])["z"] > 0.5


def test_a_request_that_is_too_long_or_too_slow_is_ended_and_keeps_nobody_out(view):
    with socket.create_connection((view.host, view.port), timeout=60) as long:
        long.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"x" * 100_000)
        try:
            answer = long.recv(100)
        except ConnectionResetError:
            answer = b""
        assert answer == b"" or b" 431 " in answer
    slow = [socket.create_connection((view.host, view.port), timeout=60) for _ in range(100)]
    try:
        for connection in slow:
            connection.sendall(b"GET / HTTP/1.1\r\n")
        # More than may be open at a time: others wait until those are ended.
        assert status(view, "/") == 200
        # It says why, or nothing, and hangs up.
        answers = slow[0].recv(1000)
        assert answers == b"" or b" 408 " in answers
    finally:
        for connection in slow:
            connection.close()


def test_rows_come_at_each_control_step(view):
    with view.drive() as drive:
        # Rows that this machine was too busy for are left out.
        rows = [drive.next("row") for _ in range(60)]
        steps = [round((b["time"] - a["time"]) / 0.025) for a, b in zip(rows, rows[1:])]
        assert steps.count(1) > len(steps) / 2 and min(steps) == 1, steps


def test_it_walks_where_it_is_told_recovers_from_a_push_and_the_recording_says_so(view):
    with view.drive() as drive:
        drive.send("stand")
        start = drive.walk([0.0, 0.0, 0.0], 1.0)
        before = drive.next("report")
        drive.send("record", on=True)
        drive.next("report", lambda report: report["recording"] is not None)
        drive.walk([0.3, 0.0, 0.0], 4.0)
        drive.send("push", force=[0.0, 40.0])
        pushed = drive.next("row", lambda row: row["push_y"] != 0.0)
        assert pushed["push_y"] == 40.0
        end = drive.walk([0.3, 0.0, 0.0], 3.0)
        drive.send("record", on=False)
        after = drive.next("report", lambda report: report["clips"] > before["clips"])
        assert (after["falls"], after["mode"], after["fault"]) == (before["falls"], "walking", None)
        walked = distance(start, end)
        assert 0.8 < walked < 3.0
    rows = view.rows(after["clips"] - 1)
    assert 6.0 < rows[-1]["time"] < 20.0
    # What is recorded is what was shown.
    assert distance(rows[0], rows[-1]) == pytest.approx(walked, abs=0.3)
    assert max(abs(row["position/left_knee_pitch"]) for row in rows) > 0.3
    check_log(view.get(f"clips/{after['clips'] - 1}/log"), len(rows))


def distance(a: dict[str, float], b: dict[str, float]) -> float:
    return math.hypot(b["x"] - a["x"], b["y"] - a["y"])


def test_conditions_change_while_it_walks(view):
    with view.drive() as drive:
        for condition, value in (("friction", 0.5), ("latency", 0.03), ("payload", 1.5)):
            drive.send("set", condition=condition, value=value)
            drive.next("report", lambda report: report[condition] == value)
            limits = drive.limits[condition]
            drive.send("set", condition=condition, value=limits["upper"] * 1.01)
            assert condition in drive.next("error")["why"]
            drive.send("set", condition=condition, value=limits["start"])


def transforms_of(message) -> dict[str, str]:
    """Parent of each frame."""
    return {entry.child_frame_id: entry.header.frame_id for entry in message.transforms}


def check_log(data: bytes, steps: int | None = None):
    """Foxglove and PlotJuggler know the schemas of the log's topics, and every frame hangs on one tree."""
    reader = make_reader(io.BytesIO(data), validate_crcs=True, decoder_factories=[DecoderFactory()])
    summary, messages = reader.get_summary(), {}
    schemas = {c.topic: summary.schemas[c.schema_id] for c in summary.channels.values()}
    for topic, name in SCHEMAS.items():
        assert (schemas[topic].name, schemas[topic].encoding) == (name, "ros2msg")
    for _, channel, message, decoded in reader.iter_decoded_messages(topics=list(SCHEMAS)):
        messages.setdefault(channel.topic, []).append((message.log_time, decoded))
    check_frames(messages["/tf"][0][1], messages["/robot_description"][0][1].data)
    for topic in ("/joint_states", "/imu", "/odom"):
        times = [(time, message.header.stamp.sec * 10**9 + message.header.stamp.nanosec) for time, message in messages[topic]]
        assert all(time == stamp for time, stamp in times) and times == sorted(times)
        assert steps is None or len(times) == steps
    (_, odom), (_, imu) = messages["/odom"][0], messages["/imu"][0]
    assert (odom.header.frame_id, odom.child_frame_id, imu.header.frame_id) == ("odom", "base", "base")


def check_frames(message, urdf: str):
    parents = transforms_of(message)
    robot = ElementTree.fromstring(urdf)
    fixed = {j.find("child").get("link"): j.find("parent").get("link") for j in robot.iter("joint")}
    for link in (link.get("name") for link in robot.iter("link")):
        # Links on joints that never move hang where the description says.
        while link not in parents:
            link = fixed[link]
        while link in parents:
            link = parents[link]
        assert link == "odom"
    for entry in message.transforms:
        q = entry.transform.rotation
        assert q.x**2 + q.y**2 + q.z**2 + q.w**2 == pytest.approx(1.0, abs=1e-9)


def test_rollouts_of_an_evaluation_open_elsewhere_and_in_the_page(trained_run):
    rollout = trained_run / "rollouts" / "eval_0.20_0.00_0.00.mcap"
    check_log(rollout.read_bytes())
    with viewing(rollout) as view:
        assert view.json("clips") == ["eval_0.20_0.00_0.00"]
        assert status(view, f"/api/drive?token={view.token}") in (400, 404)
        rows = view.rows(0)
    assert len(rows) > 1 and rows[1]["time"] == pytest.approx(0.025)
    assert 0.5 < rows[0]["z"] < 1.2 and rows[0]["command_x"] == pytest.approx(0.2)
    # The same folder with its policy.
    with viewing(trained_run) as view:
        assert view.json("clips") == ["eval_0.20_0.00_0.00"] and view.json("robot")["drives"]


def test_foxglove_sees_the_robot_and_may_not_drive_it(view):
    with connect(view.foxglove, subprotocols=["foxglove.sdk.v1"]) as client:
        assert client.subprotocol == "foxglove.sdk.v1"
        info = json.loads(client.recv(timeout=60))
        assert info["op"] == "serverInfo" and "clientPublish" not in info.get("capabilities", [])
        channels = {}
        while len(channels) < len(SCHEMAS):
            message = json.loads(client.recv(timeout=60))
            assert message["op"] == "advertise"
            channels |= {channel["topic"]: channel for channel in message["channels"]}
        assert {topic: channel["schemaName"] for topic, channel in channels.items()} == SCHEMAS
        topics = ["/tf", "/robot_description", "/joint_states"]
        subscriptions = [{"id": i, "channelId": channels[topic]["id"]} for i, topic in enumerate(topics)]
        client.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        found = {}
        while len(found) < len(topics):
            message = client.recv(timeout=60)
            if isinstance(message, bytes):
                code, subscription, _ = struct.unpack_from("<BIQ", message)
                assert code == 1
                found[topics[subscription]] = message[13:]
        decoded = {}
        for topic, data in found.items():
            channel = channels[topic]
            schema = Schema(id=1, name=channel["schemaName"], encoding=channel["schemaEncoding"], data=channel["schema"].encode())
            decoded[topic] = DecoderFactory().decoder_for(channel["encoding"], schema)(data)
    check_frames(decoded["/tf"], decoded["/robot_description"].data)
    assert len(decoded["/joint_states"].name) == 16


def test_what_cannot_be_shown_is_said_before_anything_listens(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "cut.mcap").write_bytes(b"\x89MCAP0\r\n")
    for arguments, part in (
        ([tmp_path / "none"], "cannot read"),
        ([tmp_path / "empty"], "holds no run"),
        ([tmp_path / "cut.mcap"], "cut.mcap"),
        ([POLICY, "--robot", ROOT / "robots" / "pendulum"], "does not fit robot"),
        ([POLICY, "--listen", "192.0.2.1:8040"], "cannot listen at 192.0.2.1:8040"),
    ):
        command = [*program("omniwalk"), "view", *map(str, arguments)]
        result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
        assert (result.returncode, result.stdout) == (2, ""), arguments
        assert part in " ".join(word for word in result.stderr.split() if word != "│"), result.stderr
