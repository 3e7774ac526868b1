"""A model in files that other programs read: URDF, MJCF, actuators.toml, a Python function, ROS 2, Isaac Lab.

What a format cannot hold stands in `Exported.notes` and, as a comment, in the file. The function holds the laws that
neither URDF nor MJCF knows, and needs numpy alone.
"""

from .edit import urdf_with
from .run import KINDS, Exported, export

__all__ = ["KINDS", "Exported", "export", "urdf_with"]
