"""Start of a fit: error of the loop as a linear response of the torque of the motion (compliance regression)."""

from __future__ import annotations

from collections.abc import Sequence

from ...model import Model
from ...servos import Servo, ServoGrid


def start_servos(model: Model, grids: Sequence[ServoGrid], law: str = "effort") -> dict[str, Servo]:
    """Drives to start a fit from, for every joint with commands.

    clip(e, limits) = (1/kp) (torque of the motion + damping v + friction sign v + armature a) + constant, by
    non-negative least squares over a grid of delays and limits. Damping is put into `kd`.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints.
        law: one of DRIVE_LAWS.
    """
    raise NotImplementedError
