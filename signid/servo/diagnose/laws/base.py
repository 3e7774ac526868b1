"""Law of a drive as a hypothesis: the numbers of a `Servo` that it changes, and trial values to start a fit from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....servos import SERVO_UNITS, Servo


class Reach(NamedTuple):
    """Sizes at one joint along the recordings."""

    effort: float  # largest motor torque of the simulation [N.m]
    speed: float  # largest measured speed [rad/s]
    error: float  # largest |q_des - q| [rad]
    acceleration: float  # rms of the measured acceleration [rad/s2]
    registers: int = 1  # number of different firmware gains in the recordings


class Twin(NamedTuple):
    """A law that fits equally well, or nearly, and the motion that separates the two."""

    effect: str
    separating_motion: str
    ratio: float = 1.0  # its prior probability over that of the law [1]


Trials = Callable[[Servo, Reach], Sequence[Servo]]
Plausible = Callable[[Servo, Servo], float]


@dataclass(frozen=True)
class DriveLaw:
    """One hypothesis on a drive or its joint."""

    effect: str  # name in diagnosis.json
    numbers: tuple[str, ...]  # of a `Servo`, fitted together; the first is the one that the effect is about
    meaning: str  # what the effect is, one sentence
    variable: str  # velocity, position, acceleration, torque or time: what its mismatch depends on
    trials: Trials  # servos to start from
    tolerance: float = 0.03  # change of the first number that counts as stated exactly [1, or unit of the number]
    relative: bool = True  # whether `tolerance` is relative to the stated value
    least: float = 0.0  # smallest value of the first number [unit of the number]
    twins: tuple[Twin, ...] = ()  # structural: no value of the fit separates them
    region: str = "whole recording"
    plausible: Plausible = lambda before, after: 1.0  # relative prior probability of a change  # noqa: E731
    key: str = ""  # of the parameter in diagnosis.json; default: the first number

    def parameter(self, number: str) -> str:
        """Key of one of its numbers in diagnosis.json."""
        return self.key if self.key and number == self.numbers[0] else number

    def unit(self, number: str) -> str:
        """Unit of one of its numbers at a revolute joint."""
        return SERVO_UNITS[number]

    def stated_exactly(self, before: Servo, after: Servo) -> bool:
        """Whether the change of the first number is within the tolerance of stated numbers."""
        old, new = getattr(before, self.numbers[0]), getattr(after, self.numbers[0])
        if not np.isfinite(old):
            return False
        return bool(abs(new - old) <= self.tolerance * (abs(old) if self.relative else 1.0))


def scaled(number: str, *factors: float) -> Trials:
    """Trials that multiply a number."""

    def trials(servo: Servo, _: Reach) -> list[Servo]:
        value = getattr(servo, number)
        return [servo.with_(**{number: value * x}) for x in (1.0, *factors)] if np.isfinite(value) and value > 0 else []

    return trials
