"""File formats of recordings: CSV, Parquet, NPZ, ROS bags and MCAP, LeRobot datasets. One format, one file.

A format says which files are its own, opens one as a table of named columns that is read piece by piece, and, if it
can, writes one. `signid.recording` makes a recording of the table.

To add a format: write a file here, as `signid.recording.formats.npz` does, of the kind in
`signid.recording.formats.base`, and add its name below; or put it into another package behind
an entry point `signid.formats`.
"""

from ...registry import Registry
from .base import Format

FORMATS: Registry[Format] = Registry("formats", __name__, "csv_ lerobot parquet npz rosbag")
