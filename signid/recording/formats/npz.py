"""NumPy archives: arrays t, q_1 ..., or matrices q and tau with one row per sample."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RecordingError
from ...types import Array, Table
from .base import MAX_UNPACKED, Format, free_memory, memory_table


class Npz(Format):
    """Each array of the archive is a column or a matrix of columns."""

    name, suffixes = "npz", (".npz",)
    description = "NumPy archive of arrays named as the columns"

    def open(self, path: Path) -> Table:
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


def _arrays(archive: Any) -> Iterator[tuple[str, Any]]:
    """All arrays; an empty text replaces arrays of Python objects, which are not loaded."""
    if isinstance(archive, np.ndarray):
        raise ValueError("a single array has no names")
    with archive:
        size = sum(item.file_size for item in archive.zip.infolist())
        if 2 * size > min(MAX_UNPACKED, free_memory()):
            raise MemoryError
        for name in archive:
            try:
                yield name, archive[name]
            except MemoryError:
                raise
            except Exception:  # header parsing raises many types
                yield name, ""


PLUGIN = Npz()
