"""HDF5 files, and MATLAB files of version 7.3, by the library h5py: groups and arrays of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RecordingError, shorten
from ...types import Table
from .base import MOST_COLUMNS, MOST_DEPTH, About, Format, memory_limited, memory_table, require_memory

TIMES = 3  # peak memory while reading [times the size of the numbers]
TEXTS = ("char", "cell", "string")  # classes of MATLAB that are no numbers, although they are stored so


class Hdf5(Format):
    """Read completely; groups become NAME.FIELD."""

    name, suffixes = "hdf5", (".h5", ".hdf5")
    description = "HDF5 file of arrays and groups"

    def open(self, path: Path) -> Table:
        return open_hdf5(path)


def open_hdf5(path: Path) -> Table:
    """Open a file as a table; links to other files and places are not followed.

    Raises:
        RecordingError: no HDF5, h5py is not installed, or the arrays are no table.
    """
    try:
        import h5py
    except ImportError as error:
        advice = "reading HDF5, and MATLAB files of version 7.3, needs the library h5py"
        raise RecordingError(f"{path}: {advice}; install it with: pip install 'signid[hdf5]'") from error
    arrays: dict[str, Any] = {}
    objects: list[str] = []
    try:
        with memory_limited(), h5py.File(path, "r") as file:
            size = 0
            for name, dataset in _datasets(file, "", 0, h5py):
                if name in arrays or len(arrays) >= MOST_COLUMNS:
                    fault = f"two arrays {name!r}" if name in arrays else f"more than {MOST_COLUMNS} arrays"
                    raise RecordingError(f"{path} has {fault}; save only those of the robot, with names of their own")
                if "MATLAB_object_decode" in dataset.attrs:
                    objects.append(f"{_kind(dataset)} {name}")
                    continue
                elsewhere = dataset.is_virtual or dataset.external
                other = dataset.shape is None or dataset.dtype.hasobject or _kind(dataset) in TEXTS
                numbers = not (elsewhere or other)
                size += dataset.size * dataset.dtype.itemsize if numbers else 0
                require_memory(path, TIMES * size)
                value = np.asarray(dataset[()]) if numbers else ""  # MATLAB has no vectors, but matrices of one row
                arrays[name] = np.squeeze(value) if numbers and _kind(dataset) else value
    except RecordingError:
        raise
    except MemoryError as error:
        raise RecordingError(f"{path} needs more memory than there is, or is damaged; save fewer arrays") from error
    except Exception as error:  # the library raises many types
        raise RecordingError(f"{path} is not an HDF5 file, or is damaged; copy or save it again") from error
    return without_objects(path, arrays, objects)


def without_objects(path: Path, arrays: Mapping[str, Any], objects: Sequence[str]) -> Table:
    """Table of the arrays of a file of MATLAB, with a note on its objects, which are left out.

    Raises:
        RecordingError: nothing else is there, or the arrays are no table.
    """
    notes = (f"left out, because only MATLAB reads objects: {shorten(objects)}",) if objects else ()
    table = memory_table(arrays, str(path), About(notes))
    if objects and table.rows < 2:
        named = next((name.split()[-1] for name in objects if name.split()[0] in ("table", "timetable")), "")
        whole = f"timetable2table({named})" if f"timetable {named}" in objects else named
        struct = f'save a table as a structure: S = table2struct({whole}, "ToScalar", true)'
        advice = struct if named else "save arrays, such as t = ts.Time and q = ts.Data of a timeseries ts"
        raise RecordingError(f"{path} holds objects that only MATLAB reads: {shorten(objects)}; {advice}")
    return table


def _datasets(group: Any, name: str, depth: int, h5py: Any) -> Iterator[tuple[str, Any]]:
    """Arrays in a group and in the groups inside it, by name.

    Raises:
        RecordingError: groups nested too deeply, as those that hold themselves.
    """
    if depth > MOST_DEPTH:
        raise RecordingError(
            f"{group.file.filename} is nested more than {MOST_DEPTH} deep; save its arrays side by side"
        )
    for key in group:
        if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue  # parts of MATLAB's cells and objects, and links
        part, place = group[key], f"{name}.{key}" if name else key
        if isinstance(part, h5py.Group):
            yield from _datasets(part, place, depth + 1, h5py)
        elif isinstance(part, h5py.Dataset):
            yield place, part


def _kind(dataset: Any) -> str:
    """Class of a variable of MATLAB, "" without one."""
    kind = dataset.attrs.get("MATLAB_class", b"")
    return kind.decode("utf-8", "replace") if isinstance(kind, bytes) else str(kind)


PLUGIN = Hdf5()
