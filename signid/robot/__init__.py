"""Robot descriptions: found by path or name, checked, and turned into a Robot.

URDF, xacro and MJCF files are read, and names are found: robots that come with signid, and those of example-robot-data.
Joints that are not to move are held; mimic joints follow. `urdf_from_dh` makes a URDF of Denavit-Hartenberg parameters.
"""

from .configuration import configuration
from .description.dh import DHLink, urdf_from_dh
from .hold import hold, resting
from .load import held_positions, load_robot, robot_from_text
from .locate import locate, names
from .weld import weld

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
    "weld",
]
