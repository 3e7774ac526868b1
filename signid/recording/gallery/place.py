"""Known data sets, and the folder of downloaded recordings: SIGNID_DATA, or the folder data."""

from __future__ import annotations

import gzip
import os
from hashlib import sha256
from pathlib import Path
from zlib import error as ZlibError

from ...errors import RecordingError
from ...registry import Registry
from .base import DataSet

VARIABLE = "SIGNID_DATA"


class _Gallery(Registry[DataSet]):
    """Data sets of signid, whose module is imported on access, and of other packages."""

    def __getitem__(self, name: str) -> DataSet:
        from .sets import SETS

        return SETS[name] if name in SETS else super().__getitem__(name)


DATA = _Gallery("data", __package__, "1r 3r emps panda tx40 ur10e")


def data_folder() -> Path:
    """Folder of the data sets: SIGNID_DATA, or `data` in the working directory."""
    return Path(os.environ.get(VARIABLE) or "data").expanduser()


def recordings(name: str) -> Path:
    """Folder of the recordings of a data set.

    Raises:
        OptionError: unknown data set.
        RecordingError: missing or incomplete data set.
    """
    wanted = DATA[name]
    folder = data_folder() / wanted.folder
    lacking = [product.name for product in wanted.products if not (folder / product.name).is_file()]
    if lacking:
        where = f"{folder} lacks {lacking[0]}" if folder.is_dir() else f"there is no folder {folder}"
        setting = f"{VARIABLE} is {data_folder()}" if os.environ.get(VARIABLE) else f"{VARIABLE} is not set"
        raise RecordingError(f"the recordings of {name} are missing: {setting}, and {where}; run signid data {name}")
    return folder


def is_complete(wanted: DataSet, folder: Path) -> bool:
    """Whether a folder holds all files of a data set with the expected content."""
    return all(_has_digest(folder / product.name, product.sha256) for product in wanted.products)


def _has_digest(path: Path, digest: str) -> bool:
    try:
        content = path.read_bytes()
        text = gzip.decompress(content) if path.suffix == ".gz" else content
    except (OSError, EOFError, ZlibError):
        return False
    return sha256(text).hexdigest() == digest
