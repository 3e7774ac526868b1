"""Gravity in the frame of a robot's root link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from ..errors import OptionError
from ..types import Array, Robot

if TYPE_CHECKING:
    import pinocchio as pin

STRONGEST = 1000.0  # largest magnitude [m/s2]: forty times that on Jupiter's surface


def with_gravity(robot: Robot, gravity: Sequence[float] | Array | None) -> Robot:
    """Return the robot in a field of gravity (3,) [m/s2], in the frame of its root link; None: unchanged.

    Zero stands for a robot whose recorded torque does not carry its weight.

    Raises:
        OptionError: gravity is not three finite numbers of up to STRONGEST.
    """
    if gravity is None:
        return robot
    try:
        vector = np.array([float(x) for x in gravity])
    except (TypeError, ValueError, OverflowError):
        vector = np.zeros(0)
    if isinstance(gravity, str) or vector.shape != (3,) or not np.all(np.abs(vector) <= STRONGEST):
        raise OptionError(
            f"gravity is {gravity!r}; give three numbers up to {STRONGEST:.0f} m/s2, in the frame of the root link, "
            f"such as 0,0,-9.81"
        )
    if np.array_equal(vector, robot.model.gravity.linear):
        return robot
    model = robot.model.copy()
    model.gravity.linear = vector
    note = f"gravity is {gravity_text(vector)} m/s2 in the frame of {root_link(robot)}"
    return replace(robot, model=model, notes=(*(x for x in robot.notes if not x.startswith("gravity is ")), note))


def parse_gravity(text: str) -> tuple[float, ...]:
    """Parse gravity on the command line, X,Y,Z [m/s2].

    Raises:
        OptionError: the text is not three finite numbers.
    """
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not all(isfinite(x) and abs(x) <= STRONGEST for x in numbers):
        raise OptionError(
            f"--gravity {text!r} is not a vector; write X,Y,Z: three numbers up to {STRONGEST:.0f} m/s2, in the frame "
            f"of the root link, such as 0,-9.81,0"
        )
    return numbers


def gravity_text(gravity: Sequence[float] | Array) -> str:
    """Write gravity: (3,) [m/s2] as in a sentence: (0, -9.81, 0)."""
    return f"({', '.join(f'{float(x) + 0.0:.4g}' for x in gravity)})"


def root_link(robot: Robot) -> str:
    """Name of the link in whose frame gravity is stated."""
    import pinocchio as pin

    bodies = (x.name for x in robot.model.frames if x.type == pin.FrameType.BODY and x.parentJoint == 0)
    return str(next(bodies, "the base"))


def is_weightless(model: pin.Model) -> bool:
    """Whether a pin.Model has no gravity."""
    return not np.any(model.gravity.linear)
