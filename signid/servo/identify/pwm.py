"""Recorded PWM of drives: the error at which the duty is full, without a fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameters import Array
from ...types import Recording, Robot
from ..plant import servo_grids

FULL = 0.95  # duty from which a sample is left out of the slope
LINEAR = 0.98  # share of the variance of the duty that the error explains
ROWS = 50  # least number of samples


def full_duty_errors(robot: Robot, recordings: Sequence[Recording]) -> dict[str, float]:
    """Error [rad or m] of full duty at the nominal gain, of each joint whose PWM is proportional to its error."""
    pairs: dict[str, list[tuple[Array, Array]]] = {}
    for recording in recordings:
        x = recording.read()
        pwm = None if x.servo is None else x.servo.pwm
        if pwm is None or x.q_des is None:
            continue
        gain = servo_grids(recording, robot)[0].gain
        for j, joint in enumerate(recording.joints):
            error = gain[j] * (x.q_des[:, j] - x.q[:, j])
            on = np.isfinite(error) & np.isfinite(pwm[:, j]) & (np.abs(pwm[:, j]) < FULL)
            if x.servo is not None and x.servo.on is not None:
                on &= x.servo.on[:, j] > 0.5
            pairs.setdefault(joint, []).append((error[on], pwm[on, j]))
    found = {joint: _error_of_one(*map(np.concatenate, zip(*some, strict=True))) for joint, some in pairs.items()}
    return {joint: error for joint, error in found.items() if error > 0}


def _error_of_one(error: Array, duty: Array) -> float:
    """Error of full duty; 0 unless the duty is proportional to the error."""
    if len(error) < ROWS or not np.any(error):
        return 0.0
    slope = float(error @ duty / (error @ error))
    left = np.median(np.abs(duty - slope * error)) / 0.675
    return 1.0 / slope if slope > 0 and left**2 < (1 - LINEAR) * np.mean(duty**2) else 0.0
