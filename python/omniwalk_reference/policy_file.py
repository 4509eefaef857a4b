"""Reads a policy file, by docs/policy-file.md alone."""

import struct
import zlib
from types import SimpleNamespace

import numpy as np

MAGIC, VERSION, LARGEST = b"OMNIWALK", 1, 16 << 20
TAGS = [b"spec", b"actr", b"bnds", b"iden", b"gold"]
TABLE, ENTRY, HEADER = 20, 12, 84

BLOCKS = {
    "joint_position": (None, "rad or m", "joint"),
    "joint_velocity": (None, "rad/s or m/s", "joint"),
    "attitude": (2, "rad", "fused roll and pitch of the base against gravity"),
    "gyro": (3, "rad/s", "base"),
    "velocity_inertial": (3, "m/s", "inertial: level, at a former heading of the base"),
    "velocity_base": (3, "m/s", "base"),
    "desired_velocity": (3, "m/s, m/s, rad/s", "base, level: forward, left, turn about the vertical"),
    "commanded_velocity": (3, "m/s, m/s, rad/s", "base, level: forward, left, turn about the vertical"),
    "clock": (2, "1", "sine and cosine of the phase"),
    "previous_target": (None, "rad or m", "joint, relative to the nominal pose"),
    "tracking_error": (3, "m/s, m/s, rad/s", "base, level: forward, left, turn about the vertical"),
}
"""Length (None: one for each joint), unit and frame of each block."""


def read(data: bytes) -> SimpleNamespace:
    """A policy: spec, actor, bounds, identity, golden vectors; numbers are float64 arrays."""
    sections = _sections(data)
    readers = [_spec, _actor, _bounds, _identity, _golden]
    parts = []
    for section, reader in zip(sections, readers):
        source = Reader(section)
        parts.append(reader(source))
        if source.at != len(section):
            raise ValueError("bytes are left over in a section")
    return SimpleNamespace(**dict(zip(["spec", "actor", "bounds", "identity", "golden"], parts)))


def _sections(data: bytes) -> list[bytes]:
    version, count, length = struct.unpack_from("<III", data, 8)
    if data[:8] != MAGIC or version != VERSION or count != len(TAGS) or length != len(data) or length > LARGEST:
        raise ValueError("not a policy file of version 1, or another length")
    if zlib.crc32(data[: HEADER - 4]) != struct.unpack_from("<I", data, HEADER - 4)[0]:
        raise ValueError("the header is damaged")
    at, found = HEADER, []
    for k, tag in enumerate(TAGS):
        name, length, checksum = struct.unpack_from("<4sII", data, TABLE + ENTRY * k)
        section = data[at : at + length]
        if name != tag or zlib.crc32(section) != checksum:
            raise ValueError(f"section {tag.decode()} is damaged")
        found.append(section)
        at += length
    if at != len(data):
        raise ValueError("bytes are left over")
    return found


class Reader:
    """The types of the format."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def number(self, kind: str) -> int | float:
        """A number: B, H, I, Q, f of the module struct."""
        (value,) = struct.unpack_from("<" + kind, self.data, self.at)
        self.at += struct.calcsize("<" + kind)
        return value

    def array(self, kind: str, count: int) -> np.ndarray:
        """`count` numbers of a NumPy type, as float64."""
        size = count * np.dtype(kind).itemsize
        if self.at + size > len(self.data):
            raise ValueError("a list is longer than its section")
        values = np.frombuffer(self.data, "<" + kind, count, self.at)
        self.at += size
        return values.astype(np.float64)

    def floats(self) -> np.ndarray:
        """A list of f32."""
        return self.array("f4", self.number("I"))

    def text(self) -> str:
        """A text."""
        length = self.number("I")
        self.at += length
        return self.data[self.at - length : self.at].decode("utf-8")

    def items(self, read) -> list:
        """A list of what `read` reads."""
        return [read(self) for _ in range(self.number("I"))]

    def option(self, read):
        """A value, or None."""
        return read(self) if self.boolean() else None

    def boolean(self) -> bool:
        """A truth value."""
        value = self.number("B")
        if value > 1:
            raise ValueError("a truth value is 0 or 1")
        return bool(value)


def _spec(source: Reader) -> SimpleNamespace:
    spec = SimpleNamespace(control_hz=source.number("f"))
    joints = source.items(_joint)
    spec.names = [joint.name for joint in joints]
    for field in ("nominal", "lower", "upper", "kp", "kd", "torque_limit", "action_scale"):
        setattr(spec, field, np.array([getattr(joint, field) for joint in joints]))
    spec.blocks = [_block(name, words, len(joints)) for name, *words in source.items(_words)]
    spec.law = source.text()
    spec.filter = source.option(_filter)
    spec.torque_clamp = source.boolean()
    spec.clock = source.option(lambda it: it.array("f4", 2))
    spec.symmetry = source.option(lambda it: it.items(lambda entry: (entry.number("H"), entry.number("f"))))
    spec.rate, spec.command_lower, spec.command_upper = (source.array("f4", 3) for _ in range(3))
    spec.legs = source.items(_leg)
    spec.inertial_frame_period = source.number("f")
    spec.upright = source.array("f4", 2)
    return spec


def _joint(source: Reader) -> SimpleNamespace:
    fields = ["nominal", "lower", "upper", "kp", "kd", "torque_limit", "action_scale"]
    return SimpleNamespace(name=source.text(), **dict(zip(fields, source.array("f4", 7))))


def _words(source: Reader) -> tuple[str, int, str, str]:
    return source.text(), source.number("I"), source.text(), source.text()


def _block(name: str, words: list, joints: int) -> str:
    length, unit, frame = BLOCKS[name]
    if words != [length or joints, unit, frame]:
        raise ValueError(f"block {name} has another length, unit or frame")
    return name


def _filter(source: Reader) -> tuple[str, float]:
    name, order, value, start = source.text(), source.number("B"), source.number("f"), source.text()
    if (name, order) not in [("exponential", 1), ("butterworth", 2)] or start != "first_action":
        raise ValueError(f"unknown filter {name}")
    return name, value


def _leg(source: Reader) -> SimpleNamespace:
    leg = SimpleNamespace(name=source.text(), segments=source.items(_segment))
    leg.corners = source.array("f4", 12).reshape(4, 3)
    leg.sole_rotation = source.array("f4", 4)
    return leg


def _segment(source: Reader) -> SimpleNamespace:
    return SimpleNamespace(
        translation=source.array("f4", 3),
        rotation=source.array("f4", 4),
        axis=source.array("f4", 3),
        prismatic=source.boolean(),
        joint=source.option(lambda it: it.number("H")),
        multiplier=source.number("f"),
        offset=source.number("f"),
    )


def _actor(source: Reader) -> SimpleNamespace:
    actor = SimpleNamespace(mean=source.floats(), deviation=source.floats(), clip=source.number("f"))
    actor.activation, actor.head = source.text(), source.text()
    actor.layers = source.items(_layer)
    return actor


def _layer(source: Reader) -> tuple[np.ndarray, np.ndarray]:
    inputs, kind = source.number("I"), source.text()
    if kind == "f32":
        weights = source.floats().reshape(-1, inputs)
    elif kind == "f16":
        weights = source.array("f2", source.number("I")).reshape(-1, inputs)
    elif kind == "int8":
        scale = source.floats()
        weights = scale[:, None] * source.array("i1", source.number("I")).reshape(-1, inputs)
    else:
        raise ValueError(f"unknown weights {kind}")
    return weights, source.floats()


def _bounds(source: Reader) -> SimpleNamespace:
    return SimpleNamespace(lower=source.floats(), upper=source.floats())


def _identity(source: Reader) -> SimpleNamespace:
    identity = SimpleNamespace(config_hash=source.array("u1", 32), seed=source.number("Q"), steps=source.number("Q"))
    identity.program = source.text()
    identity.latency, identity.lower, identity.upper = source.array("f4", 2), source.array("f4", 3), source.array("f4", 3)
    identity.velocity_factor, identity.foot_factor = source.array("f4", 2)
    return identity


def _golden(source: Reader) -> SimpleNamespace:
    actions = source.items(lambda it: (it.floats(), it.floats()))
    return SimpleNamespace(actions=actions, clock_phase=source.number("f"), steps=source.items(_step))


def _step(source: Reader) -> SimpleNamespace:
    return SimpleNamespace(
        position=source.floats(),
        velocity=source.floats(),
        attitude=source.array("f4", 2),
        gyro=source.array("f4", 3),
        base_velocity=source.option(lambda it: it.array("f4", 3)),
        desired=source.array("f4", 3),
        observation=source.floats(),
        targets=source.floats(),
    )
