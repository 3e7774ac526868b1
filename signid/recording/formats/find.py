"""Which format a file is of, by its name."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

from ...errors import RecordingError
from . import FORMATS
from .base import Format


def find_format(path: Path) -> Format:
    """The first format that recognises a file: those of the tree, then those of installed packages.

    Raises:
        RecordingError: none does.
    """
    names = (*FORMATS.names, *(point.name for point in entry_points(group="signid.formats")))
    for name in names:
        if FORMATS[name].recognises(path):
            return FORMATS[name]
    known = ", ".join(dict.fromkeys(suffix for form in FORMATS for suffix in form.suffixes))
    if path.is_dir():
        told = "expected a file of samples, a ROS 2 bag (with metadata.yaml) or a LeRobot dataset (with meta/info.json)"
        raise RecordingError(f"recording {path} is a folder; {told}")
    raise RecordingError(f"recording {path} is of no known format; expected a name that ends in {known}")
