"""Hypotheses of a diagnosis of position drives: laws of the drives and of their joints, numbers of a `Servo` each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...effects import DRIVE_EFFECTS
from ...effects.drive import DriveLaw, Reach, Twin, scaled
from ...servos import SERVO_NUMBERS, SERVO_UNITS, Servo

OFF = "let the joint swing with the drive off: viscous friction stays, the damping of the drive does not"
GRAVITY = "repeat in a posture with another gravity torque: the offset stays, a shifted zero of the command does not"


@dataclass(frozen=True)
class DriveHypothesis:
    """One hypothesis on a drive or its joint."""

    effect: str  # name in diagnosis.json
    numbers: tuple[str, ...]  # of a `Servo`, fitted together; the first is the one that the effect is about
    meaning: str  # what is wrong, one sentence
    variable: str  # velocity, position, acceleration, torque or time: what its mismatch depends on
    trials: Callable[[Servo, Reach], Sequence[Servo]]  # drives from which a fit starts
    tolerance: float = 0.03  # change of the first number that counts as stated exactly [1, or unit of the number]
    relative: bool = True  # whether `tolerance` is relative to the stated value
    twins: tuple[Twin, ...] = ()  # structural: no value of the fit separates them
    region: str = "whole recording"
    plausible: Callable[[Servo, Servo], float] = lambda before, after: 1.0  # relative prior probability of a change
    keys: tuple[str, ...] = ()  # of the numbers in diagnosis.json; default: their names

    def parameter(self, number: str) -> str:
        """Key of one of its numbers in diagnosis.json."""
        return dict(zip(self.numbers, self.keys, strict=False)).get(number, number)

    def unit(self, number: str) -> str:
        """Unit of one of its numbers at a revolute joint."""
        return SERVO_UNITS[number]

    def stated_exactly(self, before: Servo, after: Servo) -> bool:
        """Whether the change of the first number is within the tolerance of stated numbers."""
        old, new = getattr(before, self.numbers[0]), getattr(after, self.numbers[0])
        if not np.isfinite(old):
            return False
        return bool(abs(new - old) <= self.tolerance * (abs(old) if self.relative else 1.0))


def of_drive(law: DriveLaw) -> DriveHypothesis:
    """Hypothesis that a law of the library is missing in a drive, or stated wrongly."""
    return DriveHypothesis(
        law.name,
        tuple(number for number in law.numbers.values() if number in SERVO_NUMBERS),
        law.fault,
        law.variable,
        law.trials,
        law.tolerance,
        law.relative,
        law.rivals,
        law.region,
        law.plausible,
        tuple(law.numbers),
    )


def _viscous(servo: Servo, reach: Reach) -> list[Servo]:
    size = max(servo.damping, 0.1 * reach.effort / max(reach.speed, 1e-6))
    return [servo.with_(viscous_friction=max(servo.viscous_friction + x * size, 0.0)) for x in (0.0, -0.3, 0.6, 1.5)]


def _coulomb(servo: Servo, reach: Reach) -> list[Servo]:
    return [servo.with_(coulomb_friction=servo.coulomb_friction + x * reach.effort) for x in (0.0, 0.05, 0.15)]


def _load(servo: Servo, reach: Reach) -> list[Servo]:
    return [servo.with_(load_friction=servo.load_friction + x) for x in (0.0, 0.05, 0.2, 0.5)]


def _armature(servo: Servo, reach: Reach) -> list[Servo]:
    return scaled(servo, "armature", 0.4, 2.0, 5.0)


def _offset(servo: Servo, reach: Reach) -> list[Servo]:
    return [servo.with_(torque_offset=servo.torque_offset + x * reach.effort) for x in (-0.1, 0.0, 0.1)]


HYPOTHESES: tuple[DriveHypothesis, ...] = (
    *(of_drive(law) for law in DRIVE_EFFECTS if law.fault),
    DriveHypothesis(
        effect="load_friction",
        numbers=("load_friction",),
        meaning="dry friction grows with the torque of the motor",
        variable="torque",
        trials=_load,
        tolerance=0.02,
        relative=False,
        keys=("coefficient",),
    ),
    DriveHypothesis(
        effect="viscous_friction",
        numbers=("viscous_friction",),
        meaning="the viscous friction of the joint is not the stated one",
        variable="velocity",
        trials=_viscous,
        tolerance=0.05,
        twins=(Twin("servo_damping", OFF),),
        keys=("coefficient",),
    ),
    DriveHypothesis(
        effect="coulomb_friction",
        numbers=("coulomb_friction",),
        meaning="the dry friction of the joint is not the stated one",
        variable="velocity",
        trials=_coulomb,
        tolerance=0.05,
        keys=("level",),
    ),
    DriveHypothesis(
        effect="armature",
        numbers=("armature",),
        meaning="the inertia of the rotor is not the stated one",
        variable="acceleration",
        trials=_armature,
        tolerance=0.05,
        keys=("inertia",),
    ),
    DriveHypothesis(
        effect="torque_offset",
        numbers=("torque_offset",),
        meaning="a constant torque acts on the joint",
        variable="position",
        trials=_offset,
        tolerance=5e-3,
        relative=False,
        twins=(Twin("encoder_offset", GRAVITY, 0.3),),
        keys=("offset",),
    ),
)
