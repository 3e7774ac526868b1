"""Free numbers of drives as coordinates of a fit.

Positive numbers z are x = log(z + c) with a small c, so zero is a bound that is reached in finite steps; the others
are x = z. One direction of each joint is its common scale of torque: all its torques in proportion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...servos import LOOP_NUMBERS, Servo
from ...types import Array
from ..plant.drives import Copies, copies_of
from ..plant.kernel import KP

SCALED = ("kp", "kd", "viscous_friction", "coulomb_friction", "armature", "torque_offset", "effort_limit")
LINEAR = ("delay", "torque_offset")  # no logarithm
FLAT = ("effort_limit", "speed_limit", "profile_speed")  # without influence beyond the motion: short steps
SHORT, LONG = 0.15, 1.0  # largest step of a logarithm
LARGEST = 100.0  # number over its typical size
SPREAD = 1.5  # standard deviation of the logarithm of a kp over its usual size: a scale that nothing sets stays
SOFT = 0.02  # c over the typical size of a number
DIFFERENCE, FLOOR = 0.01, 0.003  # difference over the number; smallest one over its typical size


@dataclass(frozen=True)
class Slot:
    """A free number: of one joint, or of all joints of a group."""

    joint: int  # first joint in the group
    number: str
    typical: float  # in SERVO_UNITS
    shared: bool = False
    usual: float = 0.0  # of a kp [SERVO_UNITS]: centre of its weak prior; 0: none

    @property
    def column(self) -> int:
        return LOOP_NUMBERS.index(self.number)

    @property
    def soft(self) -> float:
        """Constant c of x = log(z + c)."""
        return 0.0 if self.number in ("kp", *FLAT) else SOFT * self.typical


@dataclass(frozen=True)
class Coordinates:
    """Free numbers of n drives."""

    servos: tuple[Servo, ...]  # n drives with their fixed numbers
    slots: tuple[Slot, ...]  # P

    def copies(self, values: Array) -> Copies:
        """Drives at C points; values (C, P) [SERVO_UNITS]."""
        out = copies_of([self.servos] * len(values))
        for i, slot in enumerate(self.slots):
            joints = slice(None) if slot.shared else slice(slot.joint, slot.joint + 1)
            out.numbers[:, joints, slot.column] = values[:, i, None]
        return out

    def start(self) -> Array:
        """Values (P,) of the drives."""
        return np.array([getattr(self.servos[slot.joint], slot.number) for slot in self.slots], float)

    def x(self, values: Array) -> Array:
        """Coordinates (P,) of values (P,) [SERVO_UNITS]."""
        return np.array(
            [
                z if slot.number in LINEAR else np.log(max(z, 1e-12) + slot.soft)
                for z, slot in zip(values, self.slots, strict=True)
            ]
        )

    def values(self, x: Array) -> Array:
        """Values (P,) of coordinates x (P,) [logarithms or SERVO_UNITS]."""
        out = [
            z if slot.number in LINEAR else max(np.exp(z) - slot.soft, 0.0)
            for z, slot in zip(x, self.slots, strict=True)
        ]
        return np.array(out)

    def slope(self, values: Array) -> Array:
        """dz/dx (P,) at values (P,) [SERVO_UNITS]."""
        return np.array(
            [1.0 if slot.number in LINEAR else z + slot.soft for z, slot in zip(values, self.slots, strict=True)]
        )

    @property
    def pull(self) -> Array:
        """Precision (P,) of the prior of the coordinates [1]: of each kp, and with it of the scale of its joint."""
        return np.array([SPREAD**-2 if slot.usual > 0 else 0.0 for slot in self.slots])

    def off(self, values: Array) -> Array:
        """Distance (P,) of the coordinates of values (P,) [SERVO_UNITS] from the centre of their prior."""
        return np.array(
            [np.log(z / slot.usual) if slot.usual > 0 else 0.0 for z, slot in zip(values, self.slots, strict=True)]
        )

    def prior(self, values: Array) -> float:
        """Squares of values (P,) [SERVO_UNITS] against their prior, in the units of a cost [1]."""
        return float(self.pull @ self.off(values) ** 2)

    @property
    def low(self) -> Array:
        """Lower bounds (P,) of the coordinates."""
        return np.array([_low(slot) for slot in self.slots])

    @property
    def high(self) -> Array:
        """Upper bounds (P,) of the coordinates: without them an unidentifiable scale could run away."""
        return np.array([np.inf if s.number in LINEAR else np.log(LARGEST * s.typical + s.soft) for s in self.slots])

    @property
    def most(self) -> Array:
        """Largest steps (P,) of the coordinates."""
        return np.array([_most(slot) for slot in self.slots])

    def differences(self, values: Array) -> Array:
        """Steps (P,) of finite differences at values (P,) [SERVO_UNITS]."""
        return np.array(
            [
                slot.typical if slot.number == "delay" else max(DIFFERENCE * abs(z), FLOOR * slot.typical)
                for z, slot in zip(values, self.slots, strict=True)
            ]
        )

    def scaled(self, i: int) -> list[int]:
        """Slots that share the scale of torque of slot i, if that is a kp; itself included."""
        own = self.slots[i]
        if own.column != KP:
            return []
        return [k for k, s in enumerate(self.slots) if s.number in SCALED and s.joint == own.joint and not s.shared]

    def ratios(self, values: Array) -> Array:
        """Matrix (P, P): coordinates from ratios to kp and common scales, at values (P,) [SERVO_UNITS]."""
        out, slope = np.eye(len(self.slots)), self.slope(values)
        for i in range(len(self.slots)):
            for k in self.scaled(i):
                out[k, i] = values[k] / slope[k]
        return out

    def servos_at(self, values: Array) -> tuple[Servo, ...]:
        """Drives with the values (P,) [SERVO_UNITS]."""
        table = self.copies(values[None]).numbers[0]
        changed: list[dict[str, float]] = [{} for _ in self.servos]
        for slot in self.slots:
            for j in range(len(self.servos)) if slot.shared else (slot.joint,):
                changed[j][slot.number] = float(table[j, slot.column])
        return tuple(servo.with_(**new) for servo, new in zip(self.servos, changed, strict=True))


def slots(
    free: Sequence[Sequence[str]], sizes: Sequence[dict[str, float]], shared: Sequence[str], usual: Sequence[float]
) -> tuple[Slot, ...]:
    """Free numbers of the joints of a branch: their names and sizes by joint, numbers that all share, and usual kp."""
    out, common = [], set()
    for j, names in enumerate(free):
        for number in names:
            if number in shared and number in common:
                continue
            if number in shared:
                common.add(number)
            out.append(Slot(j, number, sizes[j][number], number in shared, usual[j] if number == "kp" else 0.0))
    return tuple(out)


def _low(slot: Slot) -> float:
    if slot.number == "torque_offset":
        return -np.inf
    if slot.number == "delay":
        return 0.0
    return float(np.log(slot.soft + (1e-6 * slot.typical if slot.number in ("kp", *FLAT) else 0.0)))


def _most(slot: Slot) -> float:
    if slot.number == "delay":
        return 0.05
    if slot.number == "torque_offset":
        return float(slot.typical)
    return SHORT if slot.number in FLAT else LONG
