"""File formats of recordings: CSV, Parquet, NPZ, ROS bags and MCAP, LeRobot datasets. One format per file.

A format recognises its files, opens a file as a table of named columns that is read in chunks, and optionally writes
files. `signid.recording` builds a recording from the table.

To add a format, write a module here after the example of `signid.recording.formats.npz`, derive
`signid.recording.formats.base.Format`, and add its name below; or register an entry point `signid.formats` in another
package.
"""

from ...registry import Registry
from .base import Format

FORMATS: Registry[Format] = Registry("formats", __name__, "csv_ lerobot parquet npz rosbag")
