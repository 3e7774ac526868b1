"""Robot descriptions: found by path or name, checked, and turned into a Robot."""

from .configuration import configuration
from .dh import DHLink, urdf_from_dh
from .hold import hold, resting
from .load import held_positions, load_robot, robot_from_text
from .locate import locate, names

__all__ = [
    "DHLink",
    "configuration",
    "held_positions",
    "hold",
    "load_robot",
    "locate",
    "names",
    "resting",
    "robot_from_text",
    "urdf_from_dh",
]
