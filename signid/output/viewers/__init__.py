"""Logs for viewers: Rerun (.rrd), and MCAP for Foxglove, RViz and PlotJuggler.

A replay, a diagnosis (`log`) and a watch (`watch_logs`) send the same `messages` to a file of either kind.
"""

from .files import WatchLogs as WatchLogs, check_library as check_library
from .log import ViewerLog as ViewerLog, viewer_log as viewer_log
