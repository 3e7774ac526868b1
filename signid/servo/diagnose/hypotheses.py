"""Hypotheses of a diagnosis of position drives: laws of the drives and of their joints, numbers of a `Servo` each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...effects import DRIVE_EFFECTS
from ...effects.drive import DriveLaw, Reach, Twin, scaled
from ...effects.servo_damping import DRIVE_OFF_ADVICE
from ...servos import JOINT_LAWS, SERVO_NUMBERS, Servo

GRAVITY = "repeat in a posture with another gravity torque: the offset stays, a shifted zero of the command does not"


Trials = Callable[[Servo, Reach], Sequence[Servo]]


@dataclass(frozen=True)
class DriveHypothesis:
    """One hypothesis on a drive or its joint."""

    effect: str  # name in diagnosis.json
    numbers: tuple[str, ...]  # of a `Servo`, fitted together; the first is the one that the effect is about
    meaning: str  # what is wrong, one sentence
    variable: str  # velocity, position, acceleration, torque or time: what its mismatch depends on
    trials: Trials  # drives from which a fit starts
    tolerance: float = 0.03  # change of the first number that counts as stated exactly [1, or unit of the number]
    relative: bool = True  # whether `tolerance` is relative to the stated value
    twins: tuple[Twin, ...] = ()  # structural: no value of the fit separates them
    region: str = "whole recording"
    plausible: Callable[[Servo, Servo], float] = lambda before, after: 1.0  # relative prior probability of a change
    keys: tuple[str, ...] = ()  # of the numbers and shape in diagnosis.json; default: their names
    shape: tuple[str, ...] = ()  # numbers that its trials set and no fit changes

    def parameter(self, number: str) -> str:
        """Key of one of its numbers in diagnosis.json."""
        return dict(zip((*self.numbers, *self.shape), self.keys, strict=False)).get(number, number)

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


def _shifted(number: str, *shares: float, of_effort: bool = True) -> Trials:
    """Drives whose number differs by shares of the torque that is reached, or of 1."""
    return lambda servo, reach: [
        servo.with_(**{number: getattr(servo, number) + x * (reach.effort if of_effort else 1.0)}) for x in shares
    ]


def _viscous(servo: Servo, reach: Reach) -> list[Servo]:
    size = max(servo.damping, 0.1 * reach.effort / max(reach.speed, 1e-6))
    return [servo.with_(viscous_friction=max(servo.viscous_friction + x * size, 0.0)) for x in (0.0, -0.3, 0.6, 1.5)]


def _stribeck(servo: Servo, reach: Reach) -> list[Servo]:
    sizes = [(x * reach.effort, y * reach.speed) for x in (0.05, 0.15) for y in (0.03, 0.1, 0.3)]
    return [servo.with_(stribeck_level=level, stribeck_velocity=velocity) for level, velocity in sizes]


def _position(servo: Servo, reach: Reach) -> list[Servo]:
    size = max(0.3 * servo.coulomb_friction, 0.03 * reach.effort)
    return [
        servo.with_(position_amplitude=size, position_phase=phase, position_frequency=turns)
        for turns in (1.0, 2.0)
        if turns * reach.travel > np.pi / 2  # over less, the law is close to Coulomb friction
        for phase in (-np.pi / 2, 0.0, np.pi / 2, np.pi)
    ]


def _backlash(servo: Servo, reach: Reach) -> list[Servo]:
    gaps = ((0.0, 0.005), (0.0, 0.015), (0.0, 0.04), (0.0, 0.1), (1.0, 0.015), (1.0, 0.05))  # link encoder, gap [rad]
    return [servo.with_(backlash_gap=servo.backlash_gap + gap, link_encoder=side) for side, gap in gaps]


def of_joint(effect: str, meaning: str, variable: str, trials: Trials, shape: tuple[str, ...] = ()) -> DriveHypothesis:
    """Hypothesis that a law of `JOINT_LAWS` is missing at a joint."""
    numbers = JOINT_LAWS[effect]
    free = tuple(number for number in numbers.values() if number not in shape)
    keys = (*(key for key, number in numbers.items() if number in free), *(k for k, x in numbers.items() if x in shape))
    return DriveHypothesis(effect, free, meaning, variable, trials, keys=keys, shape=shape)


HYPOTHESES: tuple[DriveHypothesis, ...] = (
    *(of_drive(law) for law in DRIVE_EFFECTS if law.fault),
    DriveHypothesis(
        effect="load_friction",
        numbers=("load_friction",),
        meaning="dry friction grows with the torque of the motor",
        variable="torque",
        trials=_shifted("load_friction", 0.0, 0.05, 0.2, 0.5, of_effort=False),
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
        twins=(Twin("servo_damping", DRIVE_OFF_ADVICE),),
        keys=("coefficient",),
    ),
    DriveHypothesis(
        effect="coulomb_friction",
        numbers=("coulomb_friction",),
        meaning="the dry friction of the joint is not the stated one",
        variable="velocity",
        trials=_shifted("coulomb_friction", 0.0, 0.05, 0.15),
        tolerance=0.05,
        keys=("level",),
    ),
    DriveHypothesis(
        effect="armature",
        numbers=("armature",),
        meaning="the inertia of the rotor is not the stated one",
        variable="acceleration",
        trials=lambda servo, reach: scaled(servo, "armature", 0.4, 2.0, 5.0),
        tolerance=0.05,
        keys=("inertia",),
    ),
    DriveHypothesis(
        effect="torque_offset",
        numbers=("torque_offset",),
        meaning="a constant torque acts on the joint",
        variable="position",
        trials=_shifted("torque_offset", -0.1, 0.0, 0.1),
        tolerance=5e-3,
        relative=False,
        twins=(Twin("encoder_offset", GRAVITY, 0.3),),
        keys=("offset",),
    ),
    of_joint("stribeck_friction", "dry friction is larger at low speed", "velocity", _stribeck),
    of_joint(
        "position_friction",
        "dry friction changes with the position of the joint",
        "position",
        _position,
        shape=("position_frequency",),
    ),
    of_joint("spring", "a spring acts at the joint", "position", _shifted("spring_stiffness", 0.05, 0.2, 0.6)),
    of_joint(
        "backlash", "the link moves freely within a gap of the gear", "position", _backlash, shape=("link_encoder",)
    ),
)
