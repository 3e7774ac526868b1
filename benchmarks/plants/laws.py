"""Planted laws that are evaluated at each simulation step: friction levels, and torques that the motor must add.

A level is the largest friction in either direction [N.m]; it holds the joint at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import asin, copysign, cos, exp, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .faults import Fault


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


Array = NDArray[np.float64]


class Laws:
    """Friction levels and torques of n joints at each step."""

    def __init__(self, faults: Sequence[Fault], joints: Sequence[str], levels: Sequence[float], step: float) -> None:
        """Collect the laws of this kind from all faults.

        Args:
            faults: all planted faults.
            joints: joint names (n,).
            levels: dry friction of the drives (n,) [N.m].
            step: time step [s].
        """
        self._joints, self._own, self._step = tuple(joints), np.array(levels, dtype=float), step
        self._levels = [(self._at(f.joint), LEVELS[f.effect], f.numbers) for f in faults if f.effect in LEVELS]
        self._torques = [(self._at(f.joint), TORQUES[f.effect], f.numbers) for f in faults if f.effect in TORQUES]
        self._crossed = [
            (self._at(f.joint), self._at(f.partner), f.numbers) for f in faults if f.effect == "crossed_torque"
        ]
        held = [f for f in faults if f.effect in MEMORIES]
        self._memories = [(self._at(f.joint), MEMORIES[f.effect], f.numbers) for f in held]
        self._held = [(0.0, 0.0) for _ in held]  # state and torque of each law with memory
        self._drags = [f.numbers["coefficient"] for f in faults if f.effect == "fluid_drag"]
        self._pushes = [
            (p["start"], p["end"], np.array([p["force_x"], p["force_y"], p["force_z"]]))
            for p in (f.numbers for f in faults if f.effect == "external_contact")
        ]
        self.loaded = any(f.effect in LOADED for f in faults)
        self.tip = bool(self._drags or self._pushes)

    @property
    def any(self) -> bool:
        """Whether any law must be evaluated at each step."""
        return bool(self._levels or self._torques or self._crossed or self._memories or self.tip)

    def at(self, t: float, q: Array, v: Array, load: Array) -> tuple[Array, Array]:
        """Torque that the motors must add, and the level of dry friction, (n,) each [N.m].

        Args:
            t: time [s].
            q: positions (n,) [rad].
            v: velocities (n,) [rad/s].
            load: rigid-body torque (n,) [N.m].

        Raises:
            ValueError: for a negative friction level, which would drive the joint.
        """
        moments = [Moment(t, *x) for x in zip(q.tolist(), v.tolist(), load.tolist(), strict=True)]
        torque, level = np.zeros(len(moments)), self._own.copy()
        for j, law, numbers in self._levels:
            level[j] += law(moments[j], **numbers)
        for j, law, numbers in self._torques:
            torque[j] += law(moments[j], **numbers)
        for j, k, numbers in self._crossed:
            torque[j] += crossed_torque(moments[j].q, moments[k].q, **numbers)
        for (j, _, _), (_, held) in zip(self._memories, self._held, strict=True):
            torque[j] += held
        if level.min() < 0:
            j = int(level.argmin())
            raise ValueError(
                f"friction would drive {self._joints[j]} at {t:.4g} s (level {level[j]:.4g} N.m); "
                "increase the joint's coulomb_friction or reduce the fault"
            )
        return torque, level

    def advance(self, v: Array) -> None:
        """Advance the laws with memory by one step at mean velocities v (n,) [rad/s]."""
        self._held = [
            law(z, float(v[j]), self._step, **numbers)
            for (j, law, numbers), (z, _) in zip(self._memories, self._held, strict=True)
        ]

    def force(self, t: float, w: Array) -> Array:
        """Force (3,) [N] of the last link's centre of mass on the world, at velocity w (3,) [m/s]."""
        force = sum((c * float(np.linalg.norm(w)) * w for c in self._drags), np.zeros(3))
        return force + sum((push for start, end, push in self._pushes if start <= t <= end), np.zeros(3))

    def _at(self, joint: Any) -> int:
        return self._joints.index(joint)
