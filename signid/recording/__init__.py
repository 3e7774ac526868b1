"""Files or arrays -> Recording: found, opened, and its columns assigned to the joints of a robot."""

from .read import need_constants, read_recording, same_joints
from .signed import with_signs

__all__ = ["need_constants", "read_recording", "same_joints", "with_signs"]
