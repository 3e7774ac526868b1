"""Files or arrays -> Recording: found, opened, and its columns assigned to the joints of a robot."""

from .read import read_recording, same_joints

__all__ = ["read_recording", "same_joints"]
