"""Libraries that write the logs: optional, so a missing one is named in a sentence."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

from ...errors import OptionError

LIBRARIES = {"rrd": ("rerun",), "mcap": ("mcap", "rosbags")}  # modules by kind of log
ROS = (
    "rclpy",
    "builtin_interfaces",
    "geometry_msgs",
    "rcl_interfaces",
    "sensor_msgs",
    "std_msgs",
    "visualization_msgs",
)
NAMES = {"rerun": "rerun-sdk"}  # package of a module, if it has another name


def check_library(kind: str) -> None:
    """Check that the libraries of a kind of log, "rrd" or "mcap", are installed.

    Raises:
        OptionError: one is missing.
    """
    lacking = [NAMES.get(module, module) for module in LIBRARIES[kind] if find_spec(module) is None]
    if lacking:
        raise OptionError(
            f"writing .{kind} files needs {' and '.join(lacking)}, which is not installed; "
            f"install the viewers with: pip install 'signid[viewers]'"
        )


def check_ros() -> None:
    """Check that rclpy and the packages of messages that are published can be imported.

    Raises:
        OptionError: one cannot.
    """
    for module in ROS:
        try:
            import_module(module)
        except ImportError:
            raise OptionError(
                f"--publish needs {module} of ROS 2, which is not installed here; source the setup file of ROS 2, or "
                "write a file with --mcap"
            ) from None
