"""Writes the URDF of NimbRo-OP2X from published masses and offsets.

The makers publish link masses and joint offsets, but no centres of mass. Here every link is a homogeneous solid of
its published mass: the solid's centre is the link's centre of mass. Where it lies follows the smaller igus Humanoid
Open Platform of the same makers, whose published centres of mass are scaled by the ratio of the link lengths (legs
0.29835 / 0.200, trunk 0.2355 / 0.1875, arms 0.2489 / 0.159). The published masses sum to 16.62 kg, the published
total is 19 kg: the difference is battery and computer, and sits in the trunk.

Only the left half is written down; the right half is its mirror image, number by number.

    python3 python/make_nimbro_op2x.py robots/nimbro_op2x/nimbro_op2x.urdf
    python3 python/make_nimbro_op2x.py robots/nimbro_op2x_small/nimbro_op2x_small.urdf --scale 0.7 --mass 8
"""

import argparse
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

TOTAL_MASS = 19.0
LEG = 0.29835  # length of thigh and of shank, m
STUB = 0.03345  # hip roll axis to hip pitch axis, and ankle pitch axis to ankle roll axis, m


@dataclass(frozen=True)
class Solid:
    """A homogeneous box (x, y, z sides) or cylinder (radius, length along z) centred at `at` in the link frame."""

    size: tuple
    at: tuple

    def inertia(self, mass):
        """Principal moments about the centre, kg m^2."""
        if len(self.size) == 3:
            x, y, z = (side * side for side in self.size)
            return mass / 12 * (y + z), mass / 12 * (x + z), mass / 12 * (x + y)
        radius, length = self.size
        across = mass / 12 * (3 * radius * radius + length * length)
        return across, across, mass / 2 * radius * radius


@dataclass(frozen=True)
class Link:
    """A joint and the link it carries. `shape` is what collides; None: nothing."""

    name: str
    parent: str
    offset: tuple
    axis: tuple
    limits: tuple
    effort: float
    velocity: float
    mass: float = 0.0
    solid: Solid = None
    shape: Solid = None
    mimic: str = None


TRUNK = Solid((0.17, 0.22, 0.34), (0.004, 0.0, 0.125))
FOOT = Solid((0.300, 0.1685, 0.016), (0.0456, 0.005, -0.047))

# Efforts and speeds: see robot.toml. Limits: anthropomorphic. Thigh and shank angles are both measured against the
# trunk's vertical, so the knee bends one way only where the thigh stays on the front and the shank on the back side.
LEFT = [
    # A bracket below the trunk; 1.38 cm below its joint on the smaller robot.
    Link("hip_yaw", "trunk", (0.0, 0.080, 0.0005), (0, 0, 1), (-0.8, 0.8), 25.8, 1.94,
         0.315, Solid((0.09, 0.08, 0.05), (0.0, 0.0, -0.0206))),
    # Actuators around the crossing of the hip's axes; 1.45 cm below, and without the smaller robot's offset in x.
    Link("hip_roll", "hip_yaw", (0.0, 0.0, -0.061), (1, 0, 0), (-0.4, 0.6), 51.6, 1.94,
         0.527, Solid((0.12, 0.09, 0.06), (0.0, 0.0, -0.0217))),
    # Two pairs of bars without motors: halfway down.
    Link("hip_pitch", "hip_roll", (0.0, 0.0, -STUB), (0, 1, 0), (-1.4, 0.0), 51.6, 3.87,
         0.555, Solid((0.09, 0.06, LEG), (0.0, 0.0, -LEG / 2)), Solid((0.09, 0.08, 0.22), (0.0, 0.0, -LEG / 2))),
    # The knee plate, which the upper parallelogram keeps parallel to the hip; its mass is published with the shank.
    Link("knee_plate", "hip_pitch", (0.0, 0.0, -LEG), (0, 1, 0), (0.0, 1.4), 51.6, 3.87, mimic="hip_pitch"),
    # 10.47 cm of 20 cm down on the smaller robot. Its angle, and its motors', is measured from the plate.
    Link("knee_pitch", "knee_plate", (0.0, 0.0, 0.0), (0, 1, 0), (0.0, 1.4), 51.6, 3.87,
         1.834, Solid((0.11, 0.08, LEG), (-0.005, 0.0, -0.523 * LEG)),
         Solid((0.11, 0.08, 0.22), (-0.005, 0.0, -0.523 * LEG))),
    # The foot carrier, which the lower parallelogram keeps parallel to the plate: the hip roll block upside down.
    Link("ankle_pitch", "knee_pitch", (0.0, 0.0, -LEG), (0, 1, 0), (-1.4, 0.0), 51.6, 3.87,
         0.527, Solid((0.12, 0.09, 0.06), (0.0, 0.0, -0.0118)), mimic="knee_pitch"),
    # A plate on the ground of the sole's size.
    Link("ankle_roll", "ankle_pitch", (0.0, 0.0, -STUB), (1, 0, 0), (-0.6, 0.4), 51.6, 1.94, 0.500, FOOT, FOOT),
    # The bracket between the shoulder's axes, halfway between them.
    Link("shoulder_pitch", "trunk", (0.0, 0.1498, 0.236), (0, 1, 0), (-1.2, 1.0), 12.9, 3.87,
         0.160, Solid((0.05, 0.05, 0.06), (0.0, 0.0279, -0.0075))),
    # 4.95 cm of 15.9 cm down on the smaller robot.
    Link("shoulder_roll", "shoulder_pitch", (0.0, 0.05575, -0.015), (1, 0, 0), (-0.05, 1.2), 12.9, 3.87,
         0.523, Solid((0.07, 0.06, 0.22), (0.0021, 0.0, -0.0775)), Solid((0.07, 0.06, 0.20), (0.02, 0.0, -0.12))),
    # Forearm and a stump for a hand: 5.91 cm down on the smaller robot.
    Link("elbow_pitch", "shoulder_roll", (0.0403, 0.0, -0.2489), (0, 1, 0), (-2.0, 0.0), 12.9, 3.87,
         0.475, Solid((0.03, 0.22), (0.0028, 0.0, -0.0925)), Solid((0.03, 0.22), (0.0, 0.0, -0.11))),
]

MIDDLE = [
    Link("neck_yaw", "trunk", (0.04, 0.0, 0.3098), (0, 0, 1), (-1.5, 1.5), 12.9, 3.87,
         0.196, Solid((0.05, 0.04, 0.06), (0.0, 0.0, 0.033))),
    # The head's top is 1.35 m above the ground with straight legs; 7 cm above its joint on the smaller robot.
    Link("head_pitch", "neck_yaw", (0.0, 0.0, 0.050), (0, 1, 0), (-0.6, 0.8), 12.9, 3.87,
         0.523, Solid((0.14, 0.15, 0.17), (0.018, 0.0, 0.088)), Solid((0.16, 0.15, 0.18), (0.01, 0.0, 0.121))),
]


def flipped(point):
    return (point[0], -point[1], point[2])


def mirrored(link):
    """The mirror image of a link at the plane y = 0. Turning about x or z changes its sense in the mirror."""
    lower, upper = link.limits
    return replace(
        link,
        offset=flipped(link.offset),
        limits=link.limits if link.axis[1] else (-upper, -lower),
        solid=link.solid and replace(link.solid, at=flipped(link.solid.at)),
        shape=link.shape and replace(link.shape, at=flipped(link.shape.at)),
    )


def links():
    """All links but the trunk, with full names."""
    for side, half in (("left", LEFT), ("right", map(mirrored, LEFT))):
        for link in half:
            yield replace(
                link,
                name=f"{side}_{link.name}",
                parent=link.parent if link.parent == "trunk" else f"{side}_{link.parent}",
                mimic=link.mimic and f"{side}_{link.mimic}",
            )
    yield from MIDDLE


def numbers(*values):
    """Nine digits, no negative zero: mirrors exactly."""
    return " ".join(f"{value + 0.0:.9g}" for value in values)


def geometry(solid, scale):
    size = [scale * side for side in solid.size]
    if len(size) == 3:
        return f'<box size="{numbers(*size)}"/>'
    return f'<cylinder radius="{numbers(size[0])}" length="{numbers(size[1])}"/>'


def link_text(name, mass, solid, shape, scale, mass_scale):
    if not solid:
        return [f'  <link name="{name}"/>']
    ixx, iyy, izz = (numbers(mass_scale * scale**2 * moment) for moment in solid.inertia(mass))
    lines = [
        f'  <link name="{name}">',
        "    <inertial>",
        f'      <origin xyz="{numbers(*(scale * x for x in solid.at))}" rpy="0 0 0"/>',
        f'      <mass value="{numbers(mass_scale * mass)}"/>',
        f'      <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>',
        "    </inertial>",
    ]
    for tag in ("visual", "collision") if shape else ():
        lines += [
            f"    <{tag}>",
            f'      <origin xyz="{numbers(*(scale * x for x in shape.at))}" rpy="0 0 0"/>',
            f"      <geometry>{geometry(shape, scale)}</geometry>",
            f"    </{tag}>",
        ]
    return [*lines, "  </link>"]


def joint_text(link, scale, effort_scale, speed_scale):
    lower, upper = map(numbers, link.limits)
    effort, velocity = numbers(effort_scale * link.effort), numbers(speed_scale * link.velocity)
    lines = [
        f'  <joint name="{link.name}" type="revolute">',
        f'    <parent link="{link.parent}_link"/>',
        f'    <child link="{link.name}_link"/>',
        f'    <origin xyz="{numbers(*(scale * x for x in link.offset))}" rpy="0 0 0"/>',
        f'    <axis xyz="{numbers(*link.axis)}"/>',
        f'    <limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/>',
    ]
    if link.mimic:
        lines.append(f'    <mimic joint="{link.mimic}" multiplier="-1" offset="0"/>')
    return [*lines, "  </joint>"]


def urdf(name, scale, total):
    """The whole file. Scaled, gravity's torques shrink with mass times length, and motions quicken with its root."""
    everything = list(links())
    mass_scale = total / TOTAL_MASS
    trunk_mass = TOTAL_MASS - sum(link.mass for link in everything)
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Written by python/make_nimbro_op2x.py, which says how each number was derived. -->",
        f'<robot name="{name}">',
        *link_text("trunk_link", trunk_mass, TRUNK, TRUNK, scale, mass_scale),
    ]
    for link in everything:
        lines += joint_text(link, scale, mass_scale * scale, 1 / math.sqrt(scale))
        lines += link_text(f"{link.name}_link", link.mass, link.solid, link.shape, scale, mass_scale)
    return "\n".join([*lines, "</robot>", ""])


def settings(text, scale, mass_scale):
    """robot.toml of a robot scaled in length and mass so that it moves alike, only quicker by the root of the scale.

    Torques and kp go with mass times length, kd with that times time, armature with mass times length squared.
    """
    time = math.sqrt(scale)
    factors = {
        "kp": mass_scale * scale,
        "kd": mass_scale * scale * time,
        "torque_limit": mass_scale * scale,
        "speed_limit": 1 / time,
        "armature": mass_scale * scale**2,
        "sole": scale,
        "size": scale,
    }
    lines = ["# Written by python/make_nimbro_op2x.py from the full-size robot's file; the script says how it scales."]
    started = False
    for line in text.splitlines():
        started = started or not line.startswith("#") and bool(line)
        key, equals, value = line.partition(" = ")
        if equals and key in factors:
            value = value.partition(" #")[0]
            line = key + equals + re.sub(r"-?[0-9.]+", lambda match: f"{float(match[0]) * factors[key]:.6g}", value)
        elif key == "match":
            line = line.partition(" #")[0]
        if started:
            lines.append(line)
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scale", type=float, default=1.0, help="ratio of lengths")
    parser.add_argument("--mass", type=float, default=TOTAL_MASS, help="total mass, kg")
    arguments = parser.parse_args()
    arguments.out.write_text(urdf(arguments.out.stem, arguments.scale, arguments.mass))
    if arguments.scale != 1.0 or arguments.mass != TOTAL_MASS:
        full_size = Path(__file__).parents[1] / "robots" / "nimbro_op2x" / "robot.toml"
        scaled = settings(full_size.read_text(), arguments.scale, arguments.mass / TOTAL_MASS)
        arguments.out.with_name("robot.toml").write_text(scaled)
