"""NumPy files of a single array: a structured one, or a matrix whose columns are named by the user."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import OptionError, RecordingError
from ...types import Table
from ..mapping import Heading
from .base import Format, memory_table, require_memory


class Npy(Format):
    """Read completely; fields of a structured array are its columns."""

    name, suffixes = "npy", (".npy",)
    description = "NumPy array: structured, or (N, n) with stated names"

    def open(self, path: Path) -> Table:
        array = _load(path)
        if not array.dtype.names:
            fault = f"{path} holds an array of the shape {array.shape} without names"
            if array.ndim > 2:
                raise RecordingError(f"{fault}; save matrices (samples, joints) with numpy.savez, such as q=q, tau=tau")
            advice = "signid convert --names t,q_1,tau_1, or names = [...] in a column map"
            raise RecordingError(f"{fault}; state a name for each column: {advice}")
        if array.ndim != 1:
            raise RecordingError(f"{path} holds records of the shape {array.shape}; save one record for each sample")
        return memory_table({"": array}, str(path))

    def open_headed(self, path: Path, heading: Heading) -> Table:
        if heading.skip:
            raise OptionError(f"{path} has no lines before a header; remove skip from the column map, or --skip")
        array = _load(path)
        if array.dtype.names:
            return super().open_headed(path, heading)
        if array.ndim != 2 or len(heading.names) not in array.shape:
            fault = f"{path} holds an array of the shape {array.shape}, but {len(heading.names)} names are stated"
            raise RecordingError(f'{fault}; state a name for each column, "" for one that is not used')
        if array.shape[0] == array.shape[1]:
            fault = f"{path} has as many rows as columns, {array.shape[0]}, so that either could be the samples"
            raise RecordingError(f"{fault}; save a structured array")
        columns = array.T if array.shape[1] == len(heading.names) else array
        named = {name: column for name, column in zip(heading.names, columns, strict=True) if name}
        return memory_table(named, str(path))


def _load(path: Path) -> Any:
    """Array of a file, which is mapped and not read.

    Raises:
        RecordingError: no array, one of Python objects, or more than memory holds.
    """
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # header parsing raises many types
        fault = f"{path} is not a NumPy array of numbers, or is cut short; objects are never unpickled"
        raise RecordingError(f"{fault}; save arrays of numbers with numpy.savez") from error
    if not isinstance(array, np.ndarray):
        array.close()
        raise RecordingError(f"{path} is a NumPy archive; correct the suffix of its name to .npz")
    require_memory(path, 2.0 * array.nbytes)
    return array


PLUGIN = Npy()
