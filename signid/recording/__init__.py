"""Files or arrays -> Recording: found, opened, and its columns assigned to the joints of a robot."""

from .read import read_recording, same_joints
from .signed import with_signs

__all__ = ["read_recording", "same_joints", "with_signs"]
