"""Logs for viewers: Rerun (.rrd), and MCAP for Foxglove and PlotJuggler.

A log holds measured, predicted and extended torque, residual torque, positions and findings over time. Logs of a watch
(`watch_logs`) are written as it goes on; their messages (`watched`) also go to topics of ROS 2 (`topics`).
"""

from .log import ViewerLog, viewer_log
from .needed import check_library, check_ros
from .watch_logs import WatchLogs

__all__ = ["ViewerLog", "WatchLogs", "check_library", "check_ros", "viewer_log"]
