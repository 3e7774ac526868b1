"""Files or arrays -> Recording: found, opened, and its columns assigned to the joints of a robot.

Columns are t [s] and, for each joint J by name or number, q_J [rad or m], tau_J [N.m or N] or current_J [A], or
abs_tau_J and abs_current_J where the sign is lost; dq_J, ddq_J and q_des_J if there are any; a file maps other names.
Nothing is read until it is needed, and then piece by piece: memory does not grow with the length of a recording.
"""

from .read import need_constants, read_recording, same_joints
from .signed import with_signs

__all__ = ["need_constants", "read_recording", "same_joints", "with_signs"]
