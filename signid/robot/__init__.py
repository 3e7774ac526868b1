"""Robot descriptions: locate, read and check them, and build a Robot.

Sources are URDF, xacro and MJCF files, robots that come with signid, and those of example-robot-data. Joints can be
held fixed; mimic joints follow. `urdf_from_dh` generates a URDF from Denavit-Hartenberg parameters.
"""

from .audit import Audit, Suspect, audit
from .joints import configuration, hold, resting, weld, with_gravity
from .load import as_robot, described_gravity, held_positions, load_robot, robot_from_text
from .locate import locate, names, saved_model
from .urdf import DHLink, urdf_from_dh

__all__ = [
    "Audit",
    "DHLink",
    "Suspect",
    "as_robot",
    "audit",
    "configuration",
    "described_gravity",
    "held_positions",
    "hold",
    "load_robot",
    "locate",
    "names",
    "resting",
    "robot_from_text",
    "saved_model",
    "urdf_from_dh",
    "weld",
    "with_gravity",
]
