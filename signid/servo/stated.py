"""Drives as the actuators file states them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..servos import PASSIVE, SERVO_NUMBERS, Servo
from ..types import Robot

STALLED = ("duty", "torque_speed")  # laws whose limit is the stall torque


def stated_servos(robot: Robot) -> dict[str, Servo]:
    """Drives by joint whose kp the actuators file states; what it leaves out is ideal: no delay, no limit."""
    return {
        joint: stated_servo(robot, joint)
        for joint in robot.joints
        if float(robot.servo.get(joint, {}).get("kp", 0.0)) > 0
    }


def stated_servo(robot: Robot, joint: str) -> Servo:
    """Drive of a joint with the numbers that the actuators file states, defaults elsewhere."""
    stated, j = robot.servo.get(joint, {}), robot.index(joint)
    numbers: dict[str, Any] = {}
    for name in PASSIVE:  # also stated outside [joint.X.servo]
        value = float(getattr(robot.actuators, name)[j])
        numbers |= {name: value} if np.isfinite(value) else {}
    numbers |= {name: float(stated[name]) for name in (*SERVO_NUMBERS, "kp_register") if name in stated}
    numbers |= {key: str(stated[key]) for key in ("law", "kd_on") if key in stated}
    if "stall_torque" in stated and numbers.get("law", "effort") in STALLED:
        numbers["effort_limit"] = float(stated["stall_torque"])
    return Servo(**numbers)
