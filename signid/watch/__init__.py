"""Watch a robot at work: contacts and lasting changes, from its model and a stream of positions and torques.

The momentum observer (`observer`) runs on blocks of a few milliseconds (`intake`), the search for lasting changes
(`changes`) on frames of 20 ms. Thresholds follow from the model, its covariance and misfit, and from a quiet first
stretch (`quiet`).
"""

from .intake import Contact, Event, LastingChange, Note
from .watcher import WatchedBlocks, Watcher, open_watch, stream_flags, watch

__all__ = [
    "LastingChange",
    "Contact",
    "Event",
    "Note",
    "WatchedBlocks",
    "Watcher",
    "open_watch",
    "stream_flags",
    "watch",
]
