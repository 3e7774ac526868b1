"""NumPy archives: arrays t, q_1 ..., or matrices q and tau of one row a sample."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from ...errors import RecordingError
from ...types import Array, Table
from .base import MOST, Format, memory_table
from .room import room

HEADER, FACTORS = (
    "header",
    b'"schema": "signid.factors/',
)  # the array that says what a file of factors holds, and how
BEGINNING = 1024  # bytes of that array


class Npz(Format):
    """Every array of the archive is a column or a matrix of columns."""

    name, suffixes = "npz", (".npz",)
    description = "NumPy archive of arrays named as the columns"

    def open(self, path: Path) -> Table:
        """The arrays of the archive.

        Raises:
            RecordingError: when the file is no NumPy archive, is cut short, or holds factors.
        """
        if is_factor_file(path):
            told = f"{path} holds factors, as signid reduce writes them, and no samples"
            raise RecordingError(f"{told}; only signid identify takes it; give the recording here")
        try:
            arrays = dict(_arrays(np.load(path, allow_pickle=False)))
        except MemoryError:
            raise RecordingError(f"{path} holds more than memory can; give long recordings as Parquet") from None
        except Exception as error:  # numpy's own, those of zip archives, and of what their headers hold
            sentence = f"{path} is not a NumPy archive, or is damaged; save its arrays again with numpy.savez"
            raise RecordingError(sentence) from error
        return memory_table(arrays, str(path))

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        archive = io.BytesIO()
        np.savez_compressed(archive, allow_pickle=False, **columns)
        return archive.getvalue()


def is_factor_file(path: str | Path) -> bool:
    """Whether a file holds factors, rather than samples."""
    try:
        with ZipFile(path) as archive, archive.open(f"{HEADER}.npy") as member:
            return FACTORS in member.read(BEGINNING)
    except (
        OSError,
        BadZipFile,
        KeyError,
        NotImplementedError,
        RuntimeError,
        zlib.error,
    ):  # no archive, or a damaged one
        return False


def _arrays(archive: Any) -> Iterator[tuple[str, Any]]:
    """Every array; one of Python objects is not loaded, and an empty text stands for it."""
    if isinstance(archive, np.ndarray):
        raise ValueError("a single array has no names")
    with archive:
        size = sum(item.file_size for item in archive.zip.infolist())
        if 2 * size > min(MOST, room()):
            raise MemoryError
        for name in archive:
            try:
                yield name, archive[name]
            except MemoryError:
                raise
            except Exception:  # whatever reading its header raises
                yield name, ""


PLUGIN = Npz()
