"""Length of a substep: at most 2 ms, and short against the fastest oscillation of the loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...servos import Servo
from ...types import Array

LONGEST, MOST = 0.002, 32  # [s] of a substep; substeps of a row
TURN = 0.35  # [rad] of the fastest oscillation in a substep


def substeps(step: float, servos: Sequence[Servo], inertia: Array) -> int:
    """Substeps of a row of `step` seconds; inertia: (n,) of the robot at the joints [kg.m2 or kg]."""
    fastest = max(
        (np.sqrt(servo.kp / max(servo.armature + own, 1e-9)) for servo, own in zip(servos, inertia, strict=True)),
        default=0.0,
    )
    return int(np.clip(np.ceil(step * max(1 / LONGEST, fastest / TURN) - 1e-9), 1, MOST))
