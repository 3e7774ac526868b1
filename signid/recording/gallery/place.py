"""Where downloaded recordings lie: below SIGNID_DATA, or else below the folder data."""

from __future__ import annotations

import gzip
import os
from hashlib import sha256
from pathlib import Path
from zlib import error as ZlibError

from ...errors import RecordingError
from .base import DATA, DataSet

VARIABLE = "SIGNID_DATA"


def data_folder() -> Path:
    """The folder that holds a folder for each source: what SIGNID_DATA names, or data where one is."""
    return Path(os.environ.get(VARIABLE) or "data").expanduser()


def recordings(name: str) -> Path:
    """The folder that holds the recordings of a data set.

    Raises:
        OptionError: there is no such data set.
        RecordingError: it is not there, or not whole; the sentence says how to get it.
    """
    wanted = DATA[name]
    folder = data_folder() / wanted.folder
    lacking = [product.name for product in wanted.products if not (folder / product.name).is_file()]
    if lacking:
        where = f"{folder} lacks {lacking[0]}" if folder.is_dir() else f"there is no folder {folder}"
        led = f"{VARIABLE} leads to {data_folder()}" if os.environ.get(VARIABLE) else f"{VARIABLE} is not set"
        raise RecordingError(f"the recordings of {name} are not here: {led}, and {where}; signid data {name} gets them")
    return folder


def is_complete(wanted: DataSet, folder: Path) -> bool:
    """Whether a folder holds all that is made for a data set, to the last digit."""
    return all(_is(folder / product.name, product.sha256) for product in wanted.products)


def _is(path: Path, digest: str) -> bool:
    try:
        content = path.read_bytes()
        text = gzip.decompress(content) if path.suffix == ".gz" else content
    except (OSError, EOFError, ZlibError):
        return False
    return sha256(text).hexdigest() == digest
