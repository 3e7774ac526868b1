"""Export of models to URDF, MJCF, actuators.toml, a Python function, ROS 2 and Isaac Lab.

`Exported.notes` and a comment in the file list the content that a format cannot hold. The Python function holds the
laws that neither URDF nor MJCF can express, and needs only NumPy.
"""

from .edit import urdf_with
from .run import KINDS, Exported, export

__all__ = ["KINDS", "Exported", "export", "urdf_with"]
