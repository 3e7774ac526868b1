"""Recordings with recovered torque signs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError
from ..types import Array, Recording
from .table import DerivedTable


def with_signs(recording: Recording, signs: NDArray[np.int8] | NDArray[np.float32]) -> Recording:
    """Apply signs to the absolute torques of a recording; signed torques are unchanged.

    Torques with an unknown sign become missing values (NaN). Expected signs between -1 and 1 yield expected torques.

    Args:
        recording: recording of n joints.
        signs: (rows, n) sign of each row of the file: -1, 1 or between, 0 where unknown.

    Raises:
        RecordingError: the signs do not have one value per row and joint.
    """
    shape = len(recording), len(recording.joints)
    if signs.shape != shape:
        fault = f"{recording.path or 'the recording'} has {shape[0]} rows of {shape[1]} joints"
        raise RecordingError(f"{fault}, the signs have the shape {signs.shape}; give a sign for each row and joint")
    columns = recording.columns["tau"]
    unsigned = np.flatnonzero(~recording.signed).tolist()
    table = DerivedTable(recording.table, {columns[j]: partial(_apply, signs[:, j]) for j in unsigned})
    return replace(recording, table=table, signed=np.ones(shape[1], dtype=bool))


def _apply(signs: NDArray[Any], values: Array, start: int) -> Array:
    sign = signs[start : start + len(values)]
    return np.where(sign == 0, np.nan, np.abs(values) * sign)
