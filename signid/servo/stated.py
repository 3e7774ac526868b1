"""Drives as the actuators file states them."""

from __future__ import annotations

from typing import Any

from ..servos import PASSIVE, SERVO_NUMBERS, Servo
from ..types import Robot

STALLED = ("duty", "torque_speed")  # laws whose limit is the stall torque


def stated_servos(robot: Robot) -> dict[str, Servo]:
    """Drives by joint whose kp the actuators file states; what it leaves out is ideal: no delay, no limit.

    Numbers of PASSIVE are left out, since they are laws of the model of the robot, stated or identified.
    """
    return {
        joint: stated_servo(robot, joint)
        for joint in robot.joints
        if float(robot.servo.get(joint, {}).get("kp", 0.0)) > 0
    }


def stated_servo(robot: Robot, joint: str) -> Servo:
    """Drive of a joint with the numbers that the actuators file states, defaults elsewhere."""
    stated = robot.servo.get(joint, {})
    own = [name for name in (*SERVO_NUMBERS, "kp_register") if name in stated and name not in PASSIVE]
    numbers: dict[str, Any] = {name: float(stated[name]) for name in own}
    numbers |= {key: str(stated[key]) for key in ("law", "kd_on") if key in stated}
    if "stall_torque" in stated and numbers.get("law", "effort") in STALLED:
        numbers["effort_limit"] = float(stated["stall_torque"])
    return Servo(**numbers)
