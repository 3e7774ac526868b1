"""Laws evaluated at each simulation step: friction levels and torques that the motor must add, for one joint.

A level is the largest friction in either direction [N.m]; it holds the joint at rest.
"""

from __future__ import annotations

from math import asin, copysign, cos, exp, pi, sin, sqrt
from typing import NamedTuple


class Moment(NamedTuple):
    """State of one joint: time [s], position [rad], velocity [rad/s], rigid-body torque [N.m]."""

    t: float
    q: float
    v: float
    load: float


def asymmetric_level(x: Moment, coulomb_positive: float, coulomb_negative: float, **_: float) -> float:
    """Mean Coulomb friction of both directions; `asymmetric_torque` adds the difference."""
    return (coulomb_positive + coulomb_negative) / 2


def asymmetric_torque(
    x: Moment,
    viscous_positive: float,
    viscous_negative: float,
    coulomb_positive: float,
    coulomb_negative: float,
) -> float:
    """Viscous friction of the direction, and half the difference of Coulomb friction."""
    return (viscous_positive if x.v > 0 else viscous_negative) * x.v + (coulomb_positive - coulomb_negative) / 2


def stribeck_level(x: Moment, level: float, velocity: float) -> float:
    """F exp(-(v / vs)^2)."""
    return level * exp(-((x.v / velocity) ** 2))


def load_level(x: Moment, coefficient: float) -> float:
    """Mu |load|."""
    return coefficient * abs(x.load)


def position_level(x: Moment, amplitude: float, frequency: float, phase: float) -> float:
    """A sin(k q + phi), added to the joint's other friction."""
    return amplitude * sin(frequency * x.q + phase)


def drift_level(x: Moment, change: float, time_constant: float) -> float:
    """Exponential rise from 0 to the whole change."""
    return change * (1 - exp(-x.t / time_constant))


def quadratic_torque(x: Moment, coefficient: float) -> float:
    """C v |v|."""
    return coefficient * x.v * abs(x.v)


def cable_torque(x: Moment, cubic: float, centre: float) -> float:
    """C (q - q0)^3."""
    return cubic * (x.q - centre) ** 3


def counterbalance_torque(x: Moment, amplitude: float, phase: float) -> float:
    """A sin(q + phi)."""
    return amplitude * sin(x.q + phase)


def ripple_torque(x: Moment, amplitude: float, frequency: float, phase: float) -> float:
    """A sin(k q + phi)."""
    return amplitude * sin(frequency * x.q + phase)


def tustin_level(x: Moment, level: float, velocity: float) -> float:
    """Stribeck curve with exponent 1."""
    return level * exp(-abs(x.v) / velocity)


def step_level(x: Moment, change: float, time: float) -> float:
    """Step change of friction."""
    return change if x.t >= time else 0.0


def triangular_level(x: Moment, amplitude: float, frequency: float) -> float:
    """Triangle wave over the position from 0 to 2 A."""
    return amplitude * (1 + 2 / pi * asin(sin(frequency * x.q)))


def root_load_level(x: Moment, coefficient: float) -> float:
    """C sqrt |load|."""
    return coefficient * sqrt(abs(x.load))


def double_ripple_torque(x: Moment, amplitude: float, second: float, frequency: float, phase: float) -> float:
    """Two harmonics."""
    return amplitude * sin(frequency * x.q + phase) + second * sin(2 * frequency * x.q + 1)


def root_torque(x: Moment, coefficient: float) -> float:
    """C sqrt |v| in the direction of v."""
    return copysign(coefficient * sqrt(abs(x.v)), x.v)


def stop_torque(x: Moment, stiffness: float, centre: float, free: float) -> float:
    """Spring beyond a free distance from the centre."""
    return copysign(stiffness * max(abs(x.q - centre) - free, 0.0), x.q - centre)


def time_torque(x: Moment, amplitude: float, frequency: float, phase: float) -> float:
    """A sin(2 pi f t + phi), frequency in Hz."""
    return amplitude * sin(2 * pi * frequency * x.t + phase)


def velocity_wave_torque(x: Moment, amplitude: float, velocity: float) -> float:
    """A cos(v / v0)."""
    return amplitude * cos(x.v / velocity)


def skewed_torque(x: Moment, coefficient: float, centre: float) -> float:
    """C (q - q0) v: viscous friction that grows along the travel."""
    return coefficient * (x.q - centre) * x.v


def load_wave_torque(x: Moment, amplitude: float, torque: float) -> float:
    """A cos(load / tau0)."""
    return amplitude * cos(x.load / torque)


def crossed_torque(q: float, other: float, amplitude: float, frequency: float) -> float:
    """A sin(k q) cos(k q') of this joint and another."""
    return amplitude * sin(frequency * q) * cos(frequency * other)


def dahl(z: float, v: float, step: float, level: float, distance: float) -> tuple[float, float]:
    """Dahl state after a step at constant v, and the torque F z; dz/dt = v / d (1 - z sign v)."""
    ahead = copysign(1.0, v)
    z = ahead + (z - ahead) * exp(-abs(v) * step / distance)
    return z, level * z


def lugre(
    z: float, v: float, step: float, level: float, static: float, velocity: float, stiffness: float, damping: float
) -> tuple[float, float]:
    """LuGre bristle deflection z [rad] after a step at constant v, and the torque."""
    most = (level + (static - level) * exp(-((v / velocity) ** 2))) / stiffness
    end = copysign(most, v)
    after = end + (z - end) * exp(-abs(v) * step / most)
    return after, stiffness * after + damping * (after - z) / step


LEVELS = {
    "asymmetric_friction": asymmetric_level,
    "stribeck_friction": stribeck_level,
    "load_friction": load_level,
    "position_friction": position_level,
    "friction_drift": drift_level,
    "tustin_friction": tustin_level,
    "friction_step": step_level,
    "triangular_friction": triangular_level,
    "root_load_friction": root_load_level,
}
TORQUES = {
    "asymmetric_friction": asymmetric_torque,
    "quadratic_friction": quadratic_torque,
    "cable_torque": cable_torque,
    "counterbalance": counterbalance_torque,
    "torque_ripple": ripple_torque,
    "double_ripple": double_ripple_torque,
    "root_friction": root_torque,
    "soft_stop": stop_torque,
    "torque_in_time": time_torque,
    "velocity_wave": velocity_wave_torque,
    "skewed_friction": skewed_torque,
    "load_wave": load_wave_torque,
}
MEMORIES = {"presliding_friction": dahl, "lugre_friction": lugre}
LOADED = ("load_friction", "root_load_friction", "load_wave")  # need the rigid-body torque
