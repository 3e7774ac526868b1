"""File formats of recordings. To add one: write a file here, add its name below."""

from ..registry import Registry
from .base import Format

FORMATS: Registry[Format] = Registry("formats", __name__, "csv_ lerobot parquet npz rosbag")
