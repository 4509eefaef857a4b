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
IMU = f"""std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
{HEADER}{SEPARATOR}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{SEPARATOR}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
SCHEMAS = {"/imu": ("sensor_msgs/msg/Imu", IMU)}
"""Of topics that hold no joint states."""


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

    def imu(self, time: float, orientation: list[float], turning: list[float], force: list[float]) -> None:
        """Orientation (x, y, z, w) of the base in the world, its angular velocity (rad/s) and specific force (m/s^2) in its own
        frame."""
        message = {
            "orientation": dict(zip("xyzw", orientation)),
            "orientation_covariance": [0.0] * 9,
            "angular_velocity": dict(zip("xyz", turning)),
            "angular_velocity_covariance": [0.0] * 9,
            "linear_acceleration": dict(zip("xyz", force)),
            "linear_acceleration_covariance": [0.0] * 9,
        }
        self.rows.append((time, "/imu", message))

    def _joints(self, topic: str, time: float, position: list[float], velocity: list[float]) -> None:
        message = {"name": self.names, "position": position, "velocity": velocity, "effort": []}
        self.rows.append((time, topic, message))

    def write(self, path: Path, groups: dict[str, str], overrides: dict[str, float], lateness) -> None:
        """Writes the file; `lateness()` is how long after its stamp a message is logged, s."""
        path.parent.mkdir(parents=True, exist_ok=True)
        logged = [(time + lateness(), time, topic, message) for time, topic, message in self.rows]
        with open(path, "wb") as file, Writer(file) as writer:
            schemas: dict[str, object] = {}
            for log_time, stamp, topic, message in sorted(logged, key=lambda row: row[0]):
                nanoseconds = EPOCH + round(stamp * 1e9)
                stamped = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
                header = {"stamp": stamped, "frame_id": "base"}
                name, definition = SCHEMAS.get(topic, ("sensor_msgs/msg/JointState", JOINT_STATE))
                if name not in schemas:
                    schemas[name] = writer.register_msgdef(name, definition)
                writer.write_message(topic, schemas[name], {"header": header, **message}, EPOCH + round(log_time * 1e9))
            metadata = {"groups": groups, "robot_overrides": {key: repr(value) for key, value in overrides.items()}}
            for name, entries in metadata.items():
                if entries:
                    writer._writer.add_metadata(name, entries)
