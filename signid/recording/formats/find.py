"""Find the format of a file by its name."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

from ...errors import RecordingError
from . import FORMATS
from .base import Format


def find_format(path: Path) -> Format:
    """First format that recognises a file: formats of signid, then those of other packages.

    Raises:
        RecordingError: unknown format.
    """
    names = (*FORMATS.names, *(point.name for point in entry_points(group="signid.formats")))
    for name in names:
        if FORMATS[name].recognises(path):
            return FORMATS[name]
    known = ", ".join(dict.fromkeys(suffix for form in FORMATS for suffix in form.suffixes))
    if path.is_dir():
        kinds = "a file of samples, a ROS 2 bag (with metadata.yaml) or a LeRobot dataset (with meta/info.json)"
        raise RecordingError(f"recording {path} is a folder; expected {kinds}")
    raise RecordingError(f"recording {path} has no known format; expected a name that ends in {known}")
