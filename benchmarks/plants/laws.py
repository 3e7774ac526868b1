"""Planted laws that are evaluated at each simulation step: friction levels, and torques that the motor must add.

A level is the largest friction in either direction [N.m]; it holds the joint at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import asin, copysign, cos, exp, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from .control import Array
from .faults import Fault


class Moment(NamedTuple):
    """State of one joint: time [s], position [rad], velocity [rad/s], rigid-body torque [N.m]."""

    t: float
    q: float
    v: float
    load: float


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


LEVELS: Mapping[str, Callable[..., float]] = {  # largest friction at a moment
    # mean Coulomb friction of both directions; the torque below adds half the difference
    "asymmetric_friction": lambda x, coulomb_positive, coulomb_negative, **_: (coulomb_positive + coulomb_negative) / 2,
    "stribeck_friction": lambda x, level, velocity: level * exp(-((x.v / velocity) ** 2)),
    "load_friction": lambda x, coefficient: coefficient * abs(x.load),
    "position_friction": lambda x, amplitude, frequency, phase: amplitude * sin(frequency * x.q + phase),
    "friction_drift": lambda x, change, time_constant: change * (1 - exp(-x.t / time_constant)),
    "tustin_friction": lambda x, level, velocity: level * exp(-abs(x.v) / velocity),  # Stribeck curve with exponent 1
    "friction_step": lambda x, change, time: change if x.t >= time else 0.0,
    # triangle wave over the position from 0 to 2 A
    "triangular_friction": lambda x, amplitude, frequency: amplitude * (1 + 2 / pi * asin(sin(frequency * x.q))),
    "root_load_friction": lambda x, coefficient: coefficient * sqrt(abs(x.load)),
}
TORQUES: Mapping[str, Callable[..., float]] = {  # torque at a moment
    "asymmetric_friction": lambda x, viscous_positive, viscous_negative, coulomb_positive, coulomb_negative: (
        (viscous_positive if x.v > 0 else viscous_negative) * x.v + (coulomb_positive - coulomb_negative) / 2
    ),
    "quadratic_friction": lambda x, coefficient: coefficient * x.v * abs(x.v),
    "cable_torque": lambda x, cubic, centre: cubic * (x.q - centre) ** 3,
    "counterbalance": lambda x, amplitude, phase: amplitude * sin(x.q + phase),
    "torque_ripple": lambda x, amplitude, frequency, phase: amplitude * sin(frequency * x.q + phase),
    "double_ripple": lambda x, amplitude, second, frequency, phase: (
        amplitude * sin(frequency * x.q + phase) + second * sin(2 * frequency * x.q + 1)
    ),
    "root_friction": lambda x, coefficient: copysign(coefficient * sqrt(abs(x.v)), x.v),
    # spring beyond a free distance from the centre
    "soft_stop": lambda x, stiffness, centre, free: copysign(
        stiffness * max(abs(x.q - centre) - free, 0.0), x.q - centre
    ),
    # frequency in Hz
    "torque_in_time": lambda x, amplitude, frequency, phase: amplitude * sin(2 * pi * frequency * x.t + phase),
    "velocity_wave": lambda x, amplitude, velocity: amplitude * cos(x.v / velocity),
    "skewed_friction": lambda x, coefficient, centre: coefficient * (x.q - centre) * x.v,  # grows along the travel
    "load_wave": lambda x, amplitude, torque: amplitude * cos(x.load / torque),
}
MEMORIES = {"presliding_friction": dahl, "lugre_friction": lugre}
LOADED = ("load_friction", "root_load_friction", "load_wave")  # need the rigid-body torque


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
