"""Recordings: open files or arrays and assign their columns to the joints of a robot.

Columns are t [s] and, for each joint J by name or number, q_J [rad or m], tau_J [N.m or N] or current_J [A], or
abs_tau_J and abs_current_J for absolute values; dq_J, ddq_J and q_des_J are optional. Servos have q_des_J instead of
torque, and optionally dq_des_J, tau_ff_J [N.m or N], on_J (0 or 1), pwm_J (-1 to 1), volt_J [V] and temp_J [C]. A
column map assigns other names.
Samples are read on demand and in chunks, so memory does not grow with the length of a recording.
"""

from .missing import without_torque
from .read import (
    Recordings,
    as_recording,
    as_recordings,
    is_recording,
    need_constants,
    need_torque,
    read_bare,
    read_recording,
    same_joints,
    with_signs,
)

__all__ = [
    "Recordings",
    "as_recording",
    "as_recordings",
    "is_recording",
    "need_constants",
    "need_torque",
    "read_bare",
    "read_recording",
    "same_joints",
    "with_signs",
    "without_torque",
]
