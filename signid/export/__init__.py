"""A model in files that other programs read: URDF, MJCF, actuators.toml, and a Python function."""

from .edit import urdf_with
from .run import KINDS, Exported, export

__all__ = ["KINDS", "Exported", "export", "urdf_with"]
