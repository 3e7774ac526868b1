"""Laws of position drives: how a commanded position becomes torque, in the order in which a drive applies them.

command -> delay, profile -> error = command - q -> dead band -> gain -> duty limit -> damping -> limits -> supply
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..servos import Servo
from ..types import Array, Effect

# in which a drive applies its laws
STAGES = ("delay", "profile", "error", "gain", "duty", "damping", "limit", "supply")
COMMAND_STAGES = ("delay", "profile")  # stages that change the commanded position along time


@dataclass(frozen=True, eq=False)
class DriveState:
    """Signals of m drives between command and torque; a law returns one of them changed."""

    q: Array  # (..., m) [rad or m]
    v: Array  # (..., m) [rad/s or m/s]
    command: Array  # (..., m) [rad or m] position
    reference: Array  # (..., m) [rad/s or m/s] speed of the command
    error: Array  # (..., m) [rad or m] command - q
    torque: Array  # (..., m) [N.m or N] of the laws before


class Reach(NamedTuple):
    """Sizes at one joint along the recordings."""

    effort: float  # largest motor torque of the simulation [N.m]
    speed: float  # largest measured speed [rad/s]
    error: float  # largest |q_des - q| [rad]
    acceleration: float  # rms of the measured acceleration [rad/s2]
    travel: float = np.inf  # range of the measured positions [rad]
    registers: int = 1  # number of different firmware gains in the recordings


class Twin(NamedTuple):
    """A law that fits equally well, or nearly, and the motion that separates the two."""

    effect: str
    separating_motion: str
    ratio: float = 1.0  # its prior probability over that of the law [1]


class DriveLaw(Effect):
    """A part of a position drive at one joint.

    Its equation is the signal that it changes: the command, the error, or the torque of the laws before it. A `Servo`
    holds the same numbers packed for the compiled closed loop.
    """

    stage: ClassVar[str] = ""  # one of STAGES
    numbers: ClassVar[Mapping[str, str]] = {}  # number of a `Servo` of each parameter; the first is the main one
    form: ClassVar[str] = ""  # law of a `Servo` whose limit this is; "": none
    fault: ClassVar[str] = ""  # what is wrong where a diagnosis names the law, one sentence
    variable: ClassVar[str] = ""  # velocity, position, acceleration, torque or time: what its mismatch depends on
    region: ClassVar[str] = "whole recording"  # of the recording in which it acts
    tolerance: ClassVar[float] = 0.03  # change of the main number that counts as stated exactly [1, or its unit]
    relative: ClassVar[bool] = True  # whether `tolerance` is relative to the stated value
    rivals: ClassVar[tuple[Twin, ...]] = ()  # no value of a fit separates them

    def acts(self, x: DriveState, *args: Any, **parameters: Any) -> Array:
        """The error or the torque (..., m) [rad, m, N.m or N] after this law."""
        raise NotImplementedError

    def moved(self, t: Array, command: Array, *args: Any, **parameters: Any) -> Array:
        """The command (K,) [rad or m] at instants t (K,) [s] after this law."""
        raise NotImplementedError

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        """Drives from which a diagnosis starts a fit of the numbers of this law."""
        return []

    def plausible(self, before: Servo, after: Servo) -> float:
        """Relative prior probability of a change [1]."""
        return 1.0

    def stated(self, servo: Servo) -> dict[str, float] | None:
        """Parameters of this law in a drive; None where the drive does not have it."""
        if self.form and servo.law != self.form:
            return None
        numbers = {key: getattr(servo, number) for key, number in self.numbers.items()}
        own = {key: x for key, x in numbers.items() if x != getattr(Servo, self.numbers[key])}
        return own if own or self.form not in ("", Servo.law) else None

    def packed(self, servo: Servo, parameters: Mapping[str, float]) -> Servo:
        """A drive with this law."""
        numbers = {self.numbers[key]: float(value) for key, value in parameters.items()}
        drive = servo.with_(**numbers)
        return replace(drive, law=self.form) if self.form else drive


def limits(servo: Servo, reach: Reach, form: str) -> list[Servo]:
    """Drives with limits below the largest torque, and around a stated one."""
    values = [x * reach.effort for x in (0.9, 0.75, 0.6, 0.45, 0.3)]
    if np.isfinite(servo.effort_limit):
        values += [x * servo.effort_limit for x in (0.8, 1.25, 1.6, 2.5)]
    return [replace(servo, law=form, effort_limit=x) for x in values]


def scaled(servo: Servo, number: str, *factors: float) -> list[Servo]:
    """Drives with a number as it is and multiplied by factors; none where it is zero or infinite."""
    value = getattr(servo, number)
    usable = np.isfinite(value) and value > 0
    return [servo.with_(**{number: value * x}) for x in (1.0, *factors)] if usable else []
