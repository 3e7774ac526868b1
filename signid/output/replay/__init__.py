"""Animation of a recorded robot and its simulation, in Meshcat.

The simulation restarts from the measured state at regular intervals and is driven by the recorded torque. The colour of
a link shows the residual torque of its joint. Findings of a diagnosis are marked.
"""

from .live import Live
from .page import Replay
from .run import DEFAULT_MAX_DURATION, part, replay

__all__ = ["DEFAULT_MAX_DURATION", "Live", "Replay", "part", "replay"]
