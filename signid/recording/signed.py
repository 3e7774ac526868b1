"""Recording + signs -> recording whose torques have their signs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError
from ..types import Array, Recording, Table


def with_signs(recording: Recording, signs: NDArray[np.int8] | NDArray[np.float32]) -> Recording:
    """The recording with a sign for each torque that has lost it; nothing else changes.

    A torque whose sign is 0, that is unknown, is missing (NaN). Torques that have their sign keep it. Expectations of
    signs between -1 and 1 may stand for them: torque becomes its own expectation.

    Args:
        recording: rows of n joints, read piece by piece as before.
        signs: (rows, n) of each row of the file: -1, 1 or between, or 0 where it is unknown.

    Raises:
        RecordingError: there is not one sign for each row and joint.
    """
    shape = len(recording), len(recording.joints)
    if signs.shape != shape:
        told = f"{recording.path or 'the recording'} has {shape[0]} rows of {shape[1]} joints"
        raise RecordingError(f"{told}, the signs have the shape {signs.shape}; give a sign for each row and joint")
    columns = recording.columns["tau"]
    place = {columns[j]: j for j in np.flatnonzero(~recording.signed).tolist()}
    table = _Signed(recording.table, signs, place)
    return replace(recording, table=table, signed=np.ones(shape[1], dtype=bool))


class _Signed:
    """A table that gives absolute values in some columns their signs."""

    def __init__(self, table: Table, signs: NDArray[Any], place: dict[str, int]) -> None:
        self._table, self._signs, self._place = table, signs, place
        self.columns, self.rows = table.columns, table.rows

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        values = self._table.read(names, start, stop).copy()
        for k, name in enumerate(names):
            if name in self._place:
                sign = self._signs[start:stop, self._place[name]]
                values[:, k] = np.where(sign == 0, np.nan, np.abs(values[:, k]) * sign)
        return values
