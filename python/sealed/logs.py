"""Logs as a robot writes them: MCAP of ROS 2 messages, by the packages robots use."""

from __future__ import annotations

from pathlib import Path

from mcap_ros2.writer import Writer

EPOCH = 1_700_000_000_000_000_000
"""When logs start, ns."""

SEPARATOR = "=" * 80
HEADER = f"""{SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{HEADER}"""


class Log:
    """One MCAP file; rows may be given in any order of time."""

    def __init__(self, names: list[str]) -> None:
        self.names = names
        self.rows: list[tuple[float, str, dict]] = []

    def states(self, time: float, position: list[float], velocity: list[float]) -> None:
        self._joints("/joint_states", time, position, velocity)

    def commands(self, time: float, position: list[float]) -> None:
        self._joints("/joint_commands", time, position, [])

    def enabled(self, time: float, on: bool) -> None:
        self._joints("/actuator_enabled", time, [float(on)] * len(self.names), [])

    def _joints(self, topic: str, time: float, position: list[float], velocity: list[float]) -> None:
        message = {"name": self.names, "position": position, "velocity": velocity, "effort": []}
        self.rows.append((time, topic, message))

    def write(self, path: Path, groups: dict[str, str], overrides: dict[str, float], lateness) -> None:
        """Writes the file; `lateness()` is how long after its stamp a message is logged, s."""
        path.parent.mkdir(parents=True, exist_ok=True)
        logged = [(time + lateness(), time, topic, message) for time, topic, message in self.rows]
        with open(path, "wb") as file, Writer(file) as writer:
            schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
            for log_time, stamp, topic, message in sorted(logged, key=lambda row: row[0]):
                nanoseconds = EPOCH + round(stamp * 1e9)
                stamped = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
                header = {"stamp": stamped, "frame_id": "base"}
                writer.write_message(topic, schema, {"header": header, **message}, EPOCH + round(log_time * 1e9))
            metadata = {"groups": groups, "robot_overrides": {key: repr(value) for key, value in overrides.items()}}
            for name, entries in metadata.items():
                if entries:
                    writer._writer.add_metadata(name, entries)
