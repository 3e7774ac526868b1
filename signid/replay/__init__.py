"""Replay: the recorded robot and the simulated one, in Meshcat."""

from .live import Live as Live
from .run import Replay as Replay
from .run import replay as replay
