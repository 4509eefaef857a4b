"""A servo and its joint as they are: what is asked of it, motor, transmission, friction.

Friction is LuGre's bristle, not a function of velocity. Play and elasticity make rotor and link two bodies with
a spring between them. A delay transports commands one by one, each with its own lateness.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from .effects import Effect
from .machine import Servo

PRESLIDING = 1.5e-4
"""How far bristles bend before they slip, rad: well below what encoders see."""

COUPLING = 900.0
"""Angular frequency of a rotor on the flanks of its gap, rad/s."""

COUPLING_DAMPING = 0.3
"""Share of the critical damping of a rotor on what it turns the joint by, where the case does not say."""

ROTOR_FRICTION = 0.2
"""Share of dry friction that sits before a gap: at the motor."""

LATENESS = 0.04
"""Spread of a command's lateness on its way, as a share of the delay."""


class Bristle:
    """LuGre friction (Canudas de Wit et al. 1995), without its own viscous term."""

    def __init__(self, breakaway: float) -> None:
        self.stiffness = max(breakaway, 1e-9) / PRESLIDING
        self.bend = 0.0

    def torque(self, velocity: float, level: float, dt: float) -> float:
        """Friction torque at `velocity` where steady sliding makes `level`; both on the side that moves."""
        if level <= 0.0:
            return 0.0
        # Exact for constant velocity over the step: bristles tend to level / stiffness.
        limit = level / self.stiffness
        decay = math.exp(-abs(velocity) / limit * dt)
        before = self.bend
        self.bend = math.copysign(limit, velocity) * (1.0 - decay) + self.bend * decay
        rate = (self.bend - before) / dt
        return self.stiffness * self.bend + 0.3 * math.sqrt(self.stiffness * 1e-3) * rate


class Actuator:
    """One joint's servo with the effects of this case."""

    def __init__(self, servo: Servo, effects: list[Effect], rng: np.random.Generator, start: float) -> None:
        self.servo = servo
        self.effects = {effect.name: effect for effect in effects}
        self.rng = rng
        self.bristle = Bristle(servo.friction + self._beyond())
        self.rotor_bristle = Bristle(servo.friction)
        self.queue: deque[tuple[float, float]] = deque()
        self.asked = start
        self.followed = start
        self.load = 0.0
        self.sagging = 0.0
        self.voltage = 1.0

    def _value(self, name: str, key: str, default: float = 0.0) -> float:
        effect = self.effects.get(name)
        return effect.parameters.get(key, default) if effect else default

    def _beyond(self) -> float:
        """What effects hold at rest beside the friction of the data sheet, N m: it sets how stiff bristles are."""
        held = self._value("stribeck_friction", "torque") + self._value("coulomb_friction", "torque")
        if self.servo.friction > 0.0:
            return held
        # Only load or warmth makes friction here: bristles are those of a fifth of the motor's torque.
        loaded = 0.2 * self.servo.torque_limit * self._value("load_dependent_friction", "coefficient")
        return held + loaded + self._value("thermal_drift", "torque")

    @property
    def two_bodies(self) -> bool:
        return "backlash" in self.effects or "elasticity" in self.effects

    @property
    def offset(self) -> float:
        """What the encoder reads at the joint's zero, rad."""
        return self._value("sensor_offset", "offset")

    @property
    def reading_age(self) -> float:
        """Age of a reading when it is stamped, s."""
        return self._value("sensor_delay", "time")

    def command(self, time: float, target: float) -> None:
        """Sends a target; it arrives when its way through the line is over, and never overtakes another."""
        delay = self._value("command_delay", "time")
        if delay > 0.0:
            # The truth's time is the mean delay, so the mean of the latenesses, none of which is below zero, comes off.
            spread = LATENESS * delay
            delay += float(abs(self.rng.normal(0.0, spread))) - spread * math.sqrt(2.0 / math.pi)
        arrival = max(time + delay, self.queue[-1][0] if self.queue else 0.0)
        self.queue.append((arrival, target))

    def motor(self, time: float, encoder: float, velocity: float, on: bool, dt: float) -> float:
        """Torque of the motor, N m."""
        while self.queue and self.queue[0][0] <= time:
            self.asked = self.queue.popleft()[1]
        target = self.asked * self._value("command_gain", "gain", 1.0)
        fastest = self._value("command_rate_limit", "speed", math.inf)
        self.followed += min(max(target - self.followed, -fastest * dt), fastest * dt)
        if not on:
            self.load = 0.0
            return 0.0
        error = self.followed - encoder
        band = self._value("command_dead_band", "width")
        error = math.copysign(max(abs(error) - band, 0.0), error)
        servo = self.servo
        self._sag(dt)
        torque = self.voltage * servo.kp * error - servo.kd * velocity
        limit = servo.torque_limit * self.voltage
        fast = velocity / (servo.speed_limit * self.voltage)
        upper = limit * min(max(1.0 - fast, 0.0), 1.0)
        lower = -limit * min(max(1.0 + fast, 0.0), 1.0)
        self.load = min(max(torque, lower), upper)
        return self.load

    def _sag(self, dt: float) -> None:
        """The supply gives less where much is drawn, with the battery's time constant."""
        self.voltage = self._value("supply_voltage", "ratio", 1.0)
        share = self._value("battery_sag", "share")
        drawn = abs(self.load) / (0.5 * self.servo.torque_limit)
        self.sagging += (share * drawn - self.sagging) * dt / 0.05
        self.voltage *= max(1.0 - self.sagging, 0.2)

    def friction(self, velocity: float, transmitted: float, warm: float, dt: float) -> float:
        """Torque that friction takes from the joint (against `velocity`), N m, after `warm` s of work."""
        dry = self.servo.friction
        if "thermal_drift" in self.effects:
            warmth = 1.0 - math.exp(-warm / self._value("thermal_drift", "time_constant"))
            dry *= 1.0 + self._value("thermal_drift", "share") * warmth
            dry += self._value("thermal_drift", "torque") * warmth
        if self.two_bodies:
            dry *= 1.0 - ROTOR_FRICTION
        dry += self._value("coulomb_friction", "torque")
        speed = velocity / max(self._value("stribeck_friction", "velocity"), 1e-9)
        dry += self._value("stribeck_friction", "torque") * math.exp(-min(speed * speed, 700.0))
        dry += self._value("load_dependent_friction", "coefficient") * abs(transmitted)
        dry += self._value("directional_friction", "torque") * math.copysign(1.0, velocity)
        return self.bristle.torque(velocity, max(dry, 1e-3 * self.servo.friction), dt) + self.servo.damping * velocity

    def outside(self, position: float) -> float:
        """Torque that acts on the joint by its position, N m."""
        torque = self._value("external_force", "torque")
        for name, ratio in (("position_ripple", None), ("ripple_with_beat", "ratio")):
            if name in self.effects:
                effect = self.effects[name]
                angle = 2 * math.pi * effect.get("frequency") * position + effect.get("phase")
                torque += effect.get("amplitude") * math.sin(angle)
                if ratio:
                    torque += effect.get("amplitude") * math.sin(angle * effect.get(ratio))
        if "cable_spring" in self.effects:
            stretched = max(position - self._value("cable_spring", "from"), 0.0)
            torque -= self._value("cable_spring", "torque") * math.tanh(2.0 * stretched) * (1.0 + stretched)
        return torque

    def _coupling_damping(self) -> float:
        name = "backlash" if "backlash" in self.effects else "elasticity"
        return self._value(name, "coupling_damping", COUPLING_DAMPING)

    def coupling(self, twist: float, twist_rate: float) -> float:
        """Torque from the rotor to the link of a two-body joint: a spring outside the gap."""
        half_gap = 0.5 * self._value("backlash", "gap")
        soft = self._value("elasticity", "compliance")
        inertia = self.servo.armature
        stiffness = 1.0 / soft if soft else inertia * COUPLING**2
        damping = 2.0 * self._coupling_damping() * math.sqrt(stiffness * inertia)
        if abs(twist) <= half_gap:
            return 0.0
        return stiffness * (twist - math.copysign(half_gap, twist)) + damping * twist_rate
