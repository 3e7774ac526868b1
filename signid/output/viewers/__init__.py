"""Logs for viewers: Rerun (.rrd), and MCAP for Foxglove and PlotJuggler.

A log holds measured, predicted and extended torque, residual torque, positions and findings over time.
"""

from .log import ViewerLog, viewer_log
from .needed import check_library

__all__ = ["ViewerLog", "check_library", "viewer_log"]
