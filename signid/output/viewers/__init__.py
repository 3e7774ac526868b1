"""Logs for viewers: Rerun (.rrd), and MCAP for Foxglove, RViz and PlotJuggler.

A replay, a diagnosis (`log`) and a watch (`watch_logs`) send the same `messages` to a file of either kind.
"""

from .files import WatchLogs, check_library
from .log import ViewerLog, viewer_log

__all__ = ["ViewerLog", "WatchLogs", "check_library", "viewer_log"]
