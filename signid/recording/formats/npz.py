"""NumPy archives: arrays t, q_1 ..., or matrices q and tau with one row per sample."""

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
from .arrays import memory_table
from .base import MOST, Format, free_memory

HEADER, FACTORS = "header", b'"schema": "signid.factors/'  # array that identifies a factor file, and its content
BEGINNING = 1024  # length of the part of that array that is searched [bytes]


class Npz(Format):
    """Each array of the archive is a column or a matrix of columns."""

    name, suffixes = "npz", (".npz",)
    description = "NumPy archive of arrays named as the columns"

    def open(self, path: Path) -> Table:
        if is_factor_file(path):
            advice = "only signid identify reads factors; give the recording here"
            raise RecordingError(f"{path} holds factors of signid reduce instead of samples; {advice}")
        try:
            arrays = dict(_arrays(np.load(path, allow_pickle=False)))
        except MemoryError:
            raise RecordingError(f"{path} does not fit into memory; give long recordings as Parquet") from None
        except Exception as error:  # numpy, zip and header parsing raise many types
            sentence = f"{path} is not a NumPy archive, or is damaged; save its arrays again with numpy.savez"
            raise RecordingError(sentence) from error
        return memory_table(arrays, str(path))

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        archive = io.BytesIO()
        np.savez_compressed(archive, allow_pickle=False, **columns)
        return archive.getvalue()


def is_factor_file(path: str | Path) -> bool:
    """Whether a file holds factors instead of samples; one of another suffix, a pipe or a device is not read."""
    if not (PLUGIN.recognises(Path(path)) and Path(path).is_file()):
        return False
    try:
        with ZipFile(path) as archive, archive.open(f"{HEADER}.npy") as member:
            return FACTORS in member.read(BEGINNING)
    except (OSError, BadZipFile, KeyError, NotImplementedError, RuntimeError, zlib.error):  # no archive, or damaged
        return False


def _arrays(archive: Any) -> Iterator[tuple[str, Any]]:
    """All arrays; an empty text replaces arrays of Python objects, which are not loaded."""
    if isinstance(archive, np.ndarray):
        raise ValueError("a single array has no names")
    with archive:
        size = sum(item.file_size for item in archive.zip.infolist())
        if 2 * size > min(MOST, free_memory()):
            raise MemoryError
        for name in archive:
            try:
                yield name, archive[name]
            except MemoryError:
                raise
            except Exception:  # header parsing raises many types
                yield name, ""


PLUGIN = Npz()
