"""Typical sizes of the numbers of a drive along its recordings, and starts for numbers without one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...servos import Servo, ServoGrid
from ..plant.course import Moved


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
