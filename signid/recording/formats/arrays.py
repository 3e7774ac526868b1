"""Tables of named arrays: groups become names with dots, matrices a column for each number of a sample."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...errors import RecordingError
from ..names.match import guess
from .base import MOST_COLUMNS, MOST_PARTS, About, MemoryTable, require_memory

MOST_DEPTH = 20  # groups inside each other
NUMBERS, DATES = "biuf", "mM"  # kinds of data types


def memory_table(arrays: Mapping[str, Any], source: str, about: About | None = None) -> MemoryTable:
    """Table of arrays (N,) by name; groups, by name or as structured arrays, are NAME.FIELD.

    Dates become seconds since the first. A matrix "q" (N, n) or (n, N) becomes the columns q_1 to q_n: N is the size of
    the time t, else of an array that is named like a time, else the longest axis of all.

    Raises:
        RecordingError: a square matrix whose rows and columns could both be samples, too many columns or groups, or
            more numbers than memory holds.
    """
    given: dict[str, np.ndarray] = {}
    for name, value in _leaves(arrays, "", source, 0):
        if name in given:
            raise RecordingError(f"{source} has two arrays {name!r}; give every array its own name")
        given[name] = _seconds(np.asarray(value))
    reference, rows = _samples(given)
    columns: dict[str, np.ndarray] = {}
    for name, value in given.items():
        for column, part in _columns(name, value, rows, source):
            if column in columns:
                raise RecordingError(f"{source} has two columns {column!r}; give every array its own name")
            columns[column] = part
        if len(columns) > MOST_COLUMNS:
            raise RecordingError(f"{source} has more than {MOST_COLUMNS} columns; save only those of the robot")
    faults = {name: fault for name, column in columns.items() if (fault := _fault(column, reference, rows))}
    require_memory(source, 8.0 * rows * (len(columns) - len(faults)))  # small integers become floats
    usable = {name: np.array(column, np.float64) for name, column in columns.items() if name not in faults}
    return MemoryTable(usable, faults, source, about)


def _leaves(group: Any, name: str, source: str, depth: int) -> Iterator[tuple[str, ArrayLike]]:
    """Arrays of a group and of the groups in it."""
    if depth > MOST_DEPTH:
        raise RecordingError(f"{source} is nested more than {MOST_DEPTH} deep; save its arrays side by side")
    fields = group if isinstance(group, Mapping) else {}
    if isinstance(group, np.ndarray) and group.dtype.names:
        fields = {field: group[field] for field in group.dtype.names}
    elif not isinstance(group, Mapping):
        yield name, group
    for field, value in fields.items():
        yield from _leaves(value, f"{name}.{field}" if name else str(field), source, depth + 1)


def _samples(given: Mapping[str, np.ndarray]) -> tuple[str, int]:
    """Array that defines the number of samples, and this number."""
    numbers = {name: value for name, value in given.items() if value.dtype.kind in NUMBERS}
    vectors = {name: value.size for name, value in numbers.items() if 0 < value.ndim < 3 and value.size in value.shape}
    if "t" in vectors:
        return "t", vectors["t"]
    times = [name for name in vectors if vectors[name] > 1 and (meant := guess(name)) and meant.kind == "t"]
    if times:
        longest = max(times, key=lambda name: vectors[name])
        return longest, vectors[longest]
    axes = {name: max(value.shape) for name, value in numbers.items() if 0 < value.ndim < 3}
    longest = max(axes, key=lambda name: axes[name], default="t")
    return longest, axes.get(longest, 0)


def _columns(name: str, value: np.ndarray, rows: int, source: str) -> Iterator[tuple[str, np.ndarray]]:
    """Columns of an array; one that is no matrix of the samples is its own."""
    if name == "t" and value.ndim == 2 and value.size in value.shape:
        yield name, value.ravel()
        return
    if value.ndim != 2 or value.dtype.kind not in NUMBERS or rows not in value.shape:
        yield name, value
        return
    if value.shape[0] == value.shape[1] > 1:
        fault = f"{name!r} has as many rows as columns, {rows}, so that either could be the samples"
        raise RecordingError(f"{source}: {fault}; save each column as an array of its own, {name}_1, {name}_2, ...")
    matrix = value if value.shape[0] == rows else value.T
    if matrix.shape[1] > MOST_PARTS:
        yield name, value
        return
    yield from ((f"{name}_{k}", part) for k, part in enumerate(matrix.T, 1))


def _seconds(stamps: np.ndarray) -> np.ndarray:
    """Dates as seconds since the first one, and durations as seconds; other arrays are unchanged."""
    if stamps.dtype.kind not in DATES:
        return stamps
    known = stamps[~np.isnat(stamps)]
    since = stamps - known[0] if stamps.dtype.kind == "M" and len(known) else stamps
    count = since.astype("timedelta64[ns]").astype(np.int64) / 1e9
    return np.where(np.isnat(since), np.nan, count)


def _fault(column: np.ndarray, reference: str, rows: int) -> str:
    """Reason why an array is not a numeric column, "" if it is one."""
    if column.dtype.kind not in NUMBERS:
        return "holds no plain numbers; give one real number per sample"
    if column.ndim != 1:
        return f"has shape {column.shape}, expected one value per sample"
    return "" if len(column) == rows else f"has {len(column)} values, expected {rows} as {reference!r} has"
