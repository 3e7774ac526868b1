"""Watch a robot at work: contacts and lasting changes, from its model and a stream of positions and torques.

The momentum observer (`contacts`) runs on blocks of a few milliseconds (`intake`, `blocks`), the search for lasting
changes (`changes`, `windows`) on frames of 20 ms (`frames`). Thresholds follow from the covariance of the model and
from the residual of a quiet first stretch.
"""

from .events import Contact, Event, LastingChange, Note
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
