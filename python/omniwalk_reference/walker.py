"""The loop of a policy from readings to joint targets in double precision, by docs/policy-file.md alone."""

from types import SimpleNamespace

import numpy as np

JOINTS = {"joint_position", "joint_velocity", "previous_target"}
"""Blocks with an entry for each joint."""

SIGNS = {
    "attitude": [-1, 1],
    "gyro": [-1, 1, -1],
    "velocity_inertial": [1, -1, 1],
    "velocity_base": [1, -1, 1],
    "desired_velocity": [1, -1, -1],
    "commanded_velocity": [1, -1, -1],
    "tracking_error": [1, -1, -1],
    "clock": [-1, -1],
}
"""What a mirror does to the other blocks."""


class Walker:
    """One robot's loop, for readings that come in time and are sound."""

    def __init__(self, policy: SimpleNamespace) -> None:
        self.policy, self.spec = policy, policy.spec
        self.reset(0.0)

    def reset(self, phase: float) -> None:
        """Starts with the clock at `phase`."""
        spec = self.spec
        self.phase = np.float32(phase)
        self.commanded, self.tracking_error = np.zeros(3), np.zeros(3)
        self.previous_target = spec.nominal.copy()
        self.velocity, self.velocity_inertial = np.zeros(3), np.zeros(3)
        self.heading, self.yaw_rate, self.age = 0.0, 0.0, None
        self.filter = None

    @property
    def mirrored(self) -> bool:
        """Whether the policy looks into a mirror in this step."""
        return self.spec.symmetry is not None and self.phase >= 0.5

    def step(self, readings: SimpleNamespace) -> np.ndarray:
        """One step: the joint targets."""
        self.observe(readings)
        return self.decode(act(self.policy, self.observation), readings.position)

    def observe(self, readings: SimpleNamespace) -> None:
        """From readings to an observation."""
        spec, gyro = self.spec, readings.gyro
        up = up_of(readings.attitude)
        self._turn(gyro[2] + (gyro[0] * up[0] + gyro[1] * up[1]) / (1.0 + up[2]))
        if readings.base_velocity is not None:
            self.velocity = readings.base_velocity
        elif spec.legs:
            self.velocity = estimate(spec.legs, readings, up, self.velocity)
        level = rotate(unit(np.array([up[1], -up[0], 0.0, 1.0 + up[2]])), self.velocity)
        if readings.base_velocity is not None or spec.legs:
            c, s = np.cos(self.heading), np.sin(self.heading)
            self.velocity_inertial = np.array([c * level[0] - s * level[1], s * level[0] + c * level[1], level[2]])
        trained = self.policy.identity
        desired = np.clip(readings.desired, trained.lower, trained.upper)
        desired = np.clip(desired, spec.command_lower, spec.command_upper)
        largest = spec.rate / spec.control_hz
        self.commanded = self.commanded + np.clip(desired - self.commanded, -largest, largest)
        error = self.commanded - np.array([level[0], level[1], self.yaw_rate])
        self.tracking_error = self.tracking_error + min(1.0 / spec.control_hz, 1.0) * (error - self.tracking_error)
        angle = 2.0 * np.pi * float(self.phase)
        blocks = {
            "joint_position": readings.position,
            "joint_velocity": readings.velocity,
            "attitude": readings.attitude,
            "gyro": gyro,
            "velocity_inertial": self.velocity_inertial,
            "velocity_base": self.velocity,
            "desired_velocity": desired,
            "commanded_velocity": self.commanded,
            "clock": np.array([np.sin(angle), np.cos(angle)]),
            "previous_target": self.previous_target - spec.nominal,
            "tracking_error": self.tracking_error,
        }
        if self.mirrored:
            blocks = {name: self._mirror(name, values) for name, values in blocks.items()}
        self.observation = np.concatenate([blocks[name] for name in spec.blocks])

    def _turn(self, rate: float) -> None:
        """Integrates the heading in the inertial frame, or sets the frame."""
        spec = self.spec
        period = max(np.round(spec.inertial_frame_period * spec.control_hz), 1.0)
        if self.age is None or self.age + 1 >= period:
            self.heading, self.age = 0.0, 0
        else:
            heading = self.heading + 0.5 * (self.yaw_rate + rate) / spec.control_hz
            self.heading, self.age = (heading + np.pi) % (2.0 * np.pi) - np.pi, self.age + 1
        self.yaw_rate = rate

    def _mirror(self, name: str, values: np.ndarray) -> np.ndarray:
        return self._mirror_joints(values) if name in JOINTS else np.array(SIGNS[name]) * values

    def _mirror_joints(self, values: np.ndarray) -> np.ndarray:
        places = [joint for joint, _ in self.spec.symmetry]
        return np.array([sign for _, sign in self.spec.symmetry]) * values[places]

    def decode(self, action: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """From an action to targets."""
        spec = self.spec
        u = 2.0 * np.clip(action, 0.0, 1.0) - 1.0
        if self.mirrored:
            u = self._mirror_joints(u)
        u = np.clip(self._filter(u), -1.0, 1.0)
        base = {
            "increment_on_measured": measured,
            "increment_on_target": self.previous_target,
            "offset_from_nominal": spec.nominal,
        }[spec.law]
        target = base + spec.action_scale * u
        if spec.torque_clamp:
            reach = spec.torque_limit / spec.kp
            target = np.clip(target, measured - reach, measured + reach)
        self.previous_target = np.clip(target, spec.lower, spec.upper)
        if spec.clock is not None:
            # In single precision, as the page says: a double would pass half a cycle one step early or late.
            step = np.float32(1.0) / (np.float32(spec.control_hz) * np.float32(spec.clock[0]))
            phase = self.phase + step
            self.phase = phase - np.floor(phase)
        return self.previous_target

    def _filter(self, u: np.ndarray) -> np.ndarray:
        if self.spec.filter is None:
            return u
        kind, value = self.spec.filter
        if kind == "exponential":
            y = u if self.filter is None else self.filter + value * (u - self.filter)
            self.filter = y
            return y
        u1, u2, y1, y2 = (u, u, u, u) if self.filter is None else self.filter
        k = np.tan(np.pi * value / self.spec.control_hz)
        m = 1.0 / (1.0 + np.sqrt(2.0) * k + k * k)
        b0, a1, a2 = k * k * m, 2.0 * (k * k - 1.0) * m, (1.0 - np.sqrt(2.0) * k + k * k) * m
        y = b0 * u + 2.0 * b0 * u1 + b0 * u2 - a1 * y1 - a2 * y2
        self.filter = (u, u1, y, y1)
        return y


def act(policy: SimpleNamespace, observation: np.ndarray) -> np.ndarray:
    """From an observation to an action."""
    actor = policy.actor
    x = np.minimum(np.maximum(observation, policy.bounds.lower), policy.bounds.upper)
    x = np.clip((x - actor.mean) / actor.deviation, -actor.clip, actor.clip)
    activation = {
        "tanh": np.tanh,
        "elu": lambda z: np.where(z > 0.0, z, np.expm1(np.minimum(z, 0.0))),
        "relu": lambda z: np.maximum(z, 0.0),
    }[actor.activation]
    for k, (weights, bias) in enumerate(actor.layers):
        x = weights @ x + bias
        if k + 1 < len(actor.layers):
            x = activation(x)
    first, second = np.split(x, 2)
    if actor.head == "gaussian":
        return (1.0 + first) / 2.0
    a, b = np.logaddexp(0.0, first), np.logaddexp(0.0, second)
    return np.where(a + b > 0.0, a / np.where(a + b > 0.0, a + b, 1.0), 0.5)


def up_of(attitude: np.ndarray) -> np.ndarray:
    """The unit vector against gravity in the base frame, from fused roll and pitch."""
    x, y = -np.sin(attitude[1]), np.sin(attitude[0])
    square = x * x + y * y
    if square > 1.0:
        return np.array([x, y, 0.0]) / np.array([np.sqrt(square), np.sqrt(square), 1.0])
    return np.array([x, y, np.sqrt(1.0 - square)])


def estimate(legs: list, readings: SimpleNamespace, up: np.ndarray, previous: np.ndarray) -> np.ndarray:
    """The velocity of the base from the corners of the soles, as if each of them stood still."""
    points, velocities = zip(*(corners(leg, readings.position, readings.velocity) for leg in legs))
    points, velocities = np.concatenate(points), np.concatenate(velocities)
    v = -(np.cross(readings.gyro, points) + velocities)
    height = points @ up
    h = height - height.min()
    d2 = ((v - previous) ** 2).sum(axis=1)
    weights = np.exp(-(h**2 / (2.0 * 0.004**2) + d2 / (2.0 * 0.05**2 + d2 / 8.0)))
    return weights @ v / weights.sum()


def corners(leg: SimpleNamespace, position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a sole in the base frame and their velocities relative to the base."""
    origin, orientation = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
    joints = []
    for segment in leg.segments:
        origin = origin + rotate(orientation, segment.translation)
        orientation = multiply(orientation, segment.rotation)
        here, rate = segment.offset, 0.0
        if segment.joint is not None:
            here = segment.multiplier * position[segment.joint] + segment.offset
            rate = segment.multiplier * velocity[segment.joint]
        axis = rotate(orientation, segment.axis)
        if segment.prismatic:
            origin = origin + here * axis
        else:
            half = 0.5 * here
            orientation = multiply(orientation, np.append(np.sin(half) * segment.axis, np.cos(half)))
        joints.append((segment.prismatic, origin, axis, rate))
    points = np.array([origin + rotate(orientation, corner) for corner in leg.corners])
    velocities = np.zeros_like(points)
    for prismatic, centre, axis, rate in joints:
        velocities += rate * (axis if prismatic else np.cross(axis, points - centre))
    return points, velocities


def unit(q: np.ndarray) -> np.ndarray:
    """A quaternion of length one."""
    return q / np.linalg.norm(q)


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """`v` turned by the unit quaternion q = (x, y, z, w)."""
    t = 2.0 * np.cross(q[:3], v)
    return v + q[3] * t + np.cross(q[:3], t)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotation b, then a."""
    return np.append(a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3]), a[3] * b[3] - a[:3] @ b[:3])
