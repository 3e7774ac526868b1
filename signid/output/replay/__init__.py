"""Replay: the recorded robot and the simulated one as its ghost, in Meshcat.

The simulation starts anew from the measured state again and again, under the recorded torque; links have the colour of
the torque that is left unexplained at their joint, and what a diagnosis found is marked at its place.
"""

from .live import Live
from .page import Replay
from .run import replay

__all__ = ["Live", "Replay", "replay"]
