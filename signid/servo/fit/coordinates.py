"""Free numbers of drives, and of a body at the last link, as coordinates of a fit.

Positive numbers z are x = log(z + c) with a small c, so zero is a bound that is reached in finite steps; the others
are x = z. One direction of each joint is its common scale of torque: all its torques in proportion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...servos import LOOP_NUMBERS, MAX_NUMBER, Servo, ServoGrid
from ...types import Array, Mask
from ..given import Bounds, Prior
from ..plant.course import Copies, Moved, copies_of

SCALED = ("kp", "kd", "viscous_friction", "coulomb_friction", "armature", "torque_offset", "effort_limit", "gear_level")
BODY = ("mass", "first_moment_x", "first_moment_y", "first_moment_z")  # numbers of a body [kg, kg.m]
MAX_TYPICAL_RATIO = 100.0  # number over its typical size
SPREAD = 1.5  # standard deviation of the logarithm of a kp over its usual size: a scale that nothing sets stays
CENTRE = 0.1  # [m] standard deviation of the centre of a body about the last link
DIFFERENCE = 0.01  # difference over the number
LONGEST_PERIOD = 0.2  # [s] sqrt(armature / kp): from a measured state, a heavier rotor coasts along any smooth motion
AT_BOUND = 1e-6  # distance of a coordinate from its bound, over its size, below which it is there


class Kind(NamedTuple):
    """How a number varies in a fit; sizes are relative to its typical one."""

    logarithmic: bool = True
    soft: float = 0.02  # c of x = log(z + c)
    low: float = 0.0  # lower bound
    longest: float | None = 1.0  # largest step of the coordinate [1, or unit of the number]; None: its typical size
    difference: float = 0.003  # smallest difference
    high: float = MAX_TYPICAL_RATIO  # upper bound


POSITIVE = Kind(soft=0.0, low=1e-6)
LIMIT = POSITIVE._replace(longest=0.15)  # without influence beyond the motion: short steps
SIGNED = Kind(logarithmic=False, low=-np.inf, longest=None)
KINDS = {
    "kp": POSITIVE,
    "effort_limit": LIMIT,
    "speed_limit": LIMIT,
    "profile_speed": LIMIT,
    "delay": Kind(logarithmic=False, longest=0.05, difference=1.0),
    "torque_offset": SIGNED,
    "stribeck_velocity": POSITIVE._replace(high=1.0),  # beyond the rms speed it is Coulomb friction
    "position_phase": SIGNED,
    "spring_rest": SIGNED,
    "encoder_offset": SIGNED,
    "gear_exponent": Kind(soft=0.0, low=0.5, longest=0.5, high=5.0),
    "gear_velocity": Kind(soft=0.0, low=0.02, longest=0.5, high=2.0),  # faster ones are viscous friction
    "mass": POSITIVE,
    "first_moment_x": SIGNED,
    "first_moment_y": SIGNED,
    "first_moment_z": SIGNED,
}  # any other number is a `Kind()`


@dataclass(frozen=True)
class Slot:
    """A free number: of one joint, of several joints of a group, or of the body (joint -1)."""

    joint: int  # first joint in the group
    number: str
    typical: float  # in SERVO_UNITS
    others: tuple[int, ...] = ()  # joints of the group that have the same number
    usual: float = 0.0  # of a kp [SERVO_UNITS]: centre of its weak prior; 0: none
    scale: float = 1.0  # usual kp over that of the typical sizes: a chain of fits keeps its bounds of torque
    prior: Prior | None = None
    bounds: Bounds | None = None

    @property
    def joints(self) -> tuple[int, ...]:
        """All joints that have the number."""
        return (self.joint, *self.others)

    @cached_property
    def kind(self) -> Kind:
        return KINDS.get(self.number, Kind())

    @property
    def soft(self) -> float:
        """Constant c of x = log(z + c)."""
        return self.kind.soft * self.typical

    @property
    def low(self) -> float:
        """Lower bound of the coordinate."""
        low = self.kind.low * self.typical * self.scale
        low = low if self.bounds is None else max(low, self.bounds.low)
        return float(np.log(self.soft + low)) if self.kind.logarithmic else low

    @property
    def high(self) -> float:
        """Upper bound of the coordinate: without it an unidentifiable scale could run away."""
        high = min(self.kind.high * self.typical * self.scale, MAX_NUMBER) if self.kind.logarithmic else np.inf
        high = high if self.bounds is None else self.bounds.high
        return float(np.log(high + self.soft)) if self.kind.logarithmic else high

    @property
    def longest(self) -> float:
        """Largest step of the coordinate."""
        return self.typical if self.kind.longest is None else self.kind.longest


@dataclass(frozen=True)
class Coordinates:
    """Free numbers of n drives and of a body."""

    servos: tuple[Servo, ...]  # n drives with their fixed numbers
    slots: tuple[Slot, ...] = ()  # P
    body: tuple[float, float, float, float] | None = None  # numbers of BODY

    def copies(self, values: Array) -> Copies:
        """Drives at C points; values (C, P) [SERVO_UNITS]."""
        first = copies_of([self.servos])
        numbers, laws = np.repeat(first.numbers, len(values), axis=0), np.repeat(first.laws, len(values), axis=0)
        for i, slot in enumerate(self.slots):
            if slot.joint >= 0:
                numbers[:, list(slot.joints), LOOP_NUMBERS.index(slot.number)] = values[:, i, None]
        return first._replace(numbers=numbers, laws=laws)

    def at(self, values: Array) -> Coordinates:
        """The same numbers free, about values (P,) [SERVO_UNITS]."""
        body = None if self.body is None else list(self.body)
        changed: list[dict[str, float]] = [{} for _ in self.servos]
        for slot, value in zip(self.slots, values.tolist(), strict=True):
            if slot.joint < 0:
                assert body is not None
                body[BODY.index(slot.number)] = value
                continue
            for j in slot.joints:
                changed[j][slot.number] = value
        servos = tuple(servo.with_(**new) for servo, new in zip(self.servos, changed, strict=True))
        return replace(self, servos=servos, body=None if body is None else (body[0], body[1], body[2], body[3]))

    @property
    def values(self) -> Array:
        """Values (P,) of drives and body [SERVO_UNITS]."""
        body = dict(zip(BODY, self.body or (), strict=False))
        each = [body[s.number] if s.joint < 0 else getattr(self.servos[s.joint], s.number) for s in self.slots]
        return np.array(each, float)

    @property
    def start(self) -> Array:
        """Values (P,) [SERVO_UNITS], within the bounds of the user."""
        each = zip(self.values.tolist(), self.slots, strict=True)
        return np.array([z if s.bounds is None else min(max(z, s.bounds.low), s.bounds.high) for z, s in each])

    def x(self, values: Array) -> Array:
        """Coordinates (P,) of values (P,) [SERVO_UNITS]."""
        each = zip(values, self.slots, strict=True)
        return np.array([np.log(max(z, 1e-12) + s.soft) if s.kind.logarithmic else z for z, s in each])

    def values_at(self, x: Array) -> Array:
        """Values (P,) of coordinates x (P,) [logarithms or SERVO_UNITS]."""
        each = zip(x, self.slots, strict=True)
        return np.array([max(np.exp(z) - s.soft, 0.0) if s.kind.logarithmic else z for z, s in each])

    def allowed(self, values: Array) -> tuple[Array, Array]:
        """Least and largest coordinates (P,) about values (P,) [SERVO_UNITS], by which a rotor follows its loop."""
        low, high = np.array([(slot.low, slot.high) for slot in self.slots]).reshape(-1, 2).T
        drives = self.at(values).servos
        for k, slot in enumerate(self.slots):
            if slot.number == "armature" and slot.bounds is None:
                high[k] = min(high[k], np.log(drives[slot.joint].kp * LONGEST_PERIOD**2 + slot.soft))
        return low, high

    def slope(self, values: Array) -> Array:
        """dz/dx (P,) at values (P,) [SERVO_UNITS]."""
        return np.array([z + s.soft if s.kind.logarithmic else 1.0 for z, s in zip(values, self.slots, strict=True)])

    def prior(self, values: Array) -> tuple[Array, Array]:
        """Prior at values (P,) [SERVO_UNITS]: precision (P,) of the coordinates, distances (P,) from their centres.

        A number may have a prior of the user. Without it a kp, and with it the scale of its joint, has a usual size; a
        body hangs near the last link.
        """
        precision, off, slope = np.zeros(len(values)), np.zeros(len(values)), self.slope(values)
        for k, (z, slot) in enumerate(zip(values, self.slots, strict=True)):
            if slot.prior is not None:
                precision[k], off[k] = (slope[k] / slot.prior.std) ** 2, (z - slot.prior.mean) / slope[k]
            elif slot.usual > 0:
                precision[k], off[k] = SPREAD**-2, np.log(z / slot.usual)
            elif slot.number in BODY[1:]:
                mass = next(m for m, other in zip(values, self.slots, strict=True) if other.number == "mass")
                precision[k], off[k] = (CENTRE * mass) ** -2.0, z
        return precision, off

    def prior_cost(self, values: Array) -> float:
        """Squares of values (P,) [SERVO_UNITS] against their prior, in the units of a cost [1]."""
        precision, off = self.prior(values)
        return float(precision @ off**2)

    @property
    def stated_precision(self) -> Array:
        """Precision (P,) of the priors of the user [inverse squares of SERVO_UNITS]; 0 without one."""
        return np.array([0.0 if s.prior is None else s.prior.std**-2 for s in self.slots])

    def at_bounds(self, values: Array) -> Mask:
        """Which of the values (P,) [SERVO_UNITS] stand at a bound of the user."""
        at = [
            s.bounds is not None and min(abs(x - s.low), abs(x - s.high)) < AT_BOUND * max(abs(x), s.longest)
            for x, s in zip(self.x(values), self.slots, strict=True)
        ]
        return np.array(at, bool)

    def differences(self, values: Array) -> Array:
        """Steps (P,) of finite differences at values (P,) [SERVO_UNITS]."""
        each = zip(values, self.slots, strict=True)
        return np.array([max(DIFFERENCE * abs(z), s.kind.difference * s.typical) for z, s in each])

    def scaled(self, i: int) -> list[int]:
        """Slots that share the scale of torque of slot i, if that is a kp; itself included."""
        own = self.slots[i]
        if own.number != "kp":
            return []
        return [k for k, s in enumerate(self.slots) if s.number in SCALED and set(s.joints) <= set(own.joints)]

    def ratios(self, values: Array) -> Array:
        """Matrix (P, P): coordinates from ratios to kp and common scales, at values (P,) [SERVO_UNITS]."""
        out, slope = np.eye(len(self.slots)), self.slope(values)
        for i in range(len(self.slots)):
            for k in self.scaled(i):
                out[k, i] = values[k] / slope[k]
        return out


def slots(
    free: Sequence[Sequence[str]],
    sizes: Sequence[dict[str, float]],
    same: Mapping[str, Sequence[int]],
    usual: Sequence[float],
    priors: Mapping[tuple[int, str], Prior],
    bounds: Mapping[tuple[int, str], Bounds],
) -> tuple[Slot, ...]:
    """Free numbers of the n joints of a group.

    Args:
        free: names by joint.
        sizes: typical sizes by joint and name [SERVO_UNITS].
        same: by name, a label (n,) of each joint; those with the same label share the number.
        usual: kp by joint [SERVO_UNITS]; 0: none.
        priors: by joint and name.
        bounds: by joint and name.
    """
    members: dict[tuple[int, str], list[int]] = {}
    for j, names in enumerate(free):
        for number in names:
            members.setdefault((same[number][j], number), []).append(j)

    def slot(joints: Sequence[int], number: str) -> Slot:
        j, centre = joints[0], usual[joints[0]] if number == "kp" else 0.0
        prior = next((priors[k, number] for k in joints if (k, number) in priors), None)
        limits = next((bounds[k, number] for k in joints if (k, number) in bounds), None)
        scale = usual[j] / sizes[j]["kp"] if number in SCALED and usual[j] > 0 else 1.0
        return Slot(j, number, sizes[j].get(number, 1.0), tuple(joints[1:]), centre, scale, prior, limits)

    return tuple(slot(joints, number) for (_, number), joints in members.items())


def typical(servo: Servo, joint: int, grids: Sequence[ServoGrid], motions: Sequence[Moved]) -> dict[str, float]:
    """Sizes by number, in SERVO_UNITS: those that give about the rms torque of the drive alone."""
    error = np.concatenate([(g.gain[joint] * (g.command - g.q)[:, joint])[g.on[:, joint] > 0.5] for g in grids])
    speed = np.concatenate([along.v[:, joint] for along in motions])
    rate = np.concatenate([along.a[:, joint] for along in motions])
    v, a = max(_rms(speed), 1e-3), max(_rms(rate), 1e-2)
    kp = servo.kp if servo.kp > 0 else 10.0
    torque = max(kp * min(_rms(error), 0.5), 1e-6)
    top = max(float(np.abs(error).max(initial=0.0)), 1e-3)
    return {
        "kp": kp,
        "kd": torque / v,
        "delay": 0.2 * min(g.step for g in grids),
        "effort_limit": kp * top,
        "speed_limit": float(np.abs(speed).max()) + 1e-3,
        "dead_band": 0.02,
        "profile_speed": float(np.abs(speed).max()) + 1e-3,
        "coulomb_friction": torque,
        "viscous_friction": torque / v,
        "load_friction": 1.0,
        "armature": torque / a,
        "torque_offset": torque,
        "droop": 1.0 / torque,
        "stribeck_level": torque,
        "stribeck_velocity": v,
        "position_amplitude": torque,
        "position_phase": 1.0,
        "spring_stiffness": kp,
        "spring_rest": 1.0,
        "backlash_gap": 0.1,
        "encoder_offset": 1.0,
        "gear_exponent": 2.0,
        "gear_velocity": v,
        "gear_level": torque,
        "gear_load": 1.0,
        "gear_load_at_rest": 1.0,
        "gear_quadratic_motor": 1.0 / torque,
        "gear_quadratic_external": 1.0 / torque,
    }


STARTS = {
    "kp": 1.0,
    "kd": 0.1,
    "effort_limit": 1.2,
    "speed_limit": 2.0,
    "dead_band": 0.1,
    "profile_speed": 1.2,
    "coulomb_friction": 0.05,
    "viscous_friction": 0.05,
    "load_friction": 0.05,
    "armature": 0.05,
    "droop": 0.05,
    "gear_level": 0.05,
    "gear_load": 0.05,
    "gear_load_at_rest": 0.05,
    "gear_quadratic_motor": 0.02,
    "gear_quadratic_external": 0.02,
}  # over the typical size, where a free number is zero or infinite


def started(servo: Servo, free: Sequence[str], sizes: dict[str, float]) -> Servo:
    """Drive whose free numbers can vary: those that are zero or infinite get a start."""
    new = {
        name: STARTS[name] * sizes[name] for name in free if name in STARTS and not 0.0 < getattr(servo, name) < np.inf
    }
    return servo.with_(**new)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0
