"""Columns of frames (pandas, polars, arrow) and structured arrays by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol, cast

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from ..errors import RecordingError


class Frame(Protocol):
    """A container of named columns: pandas or polars frame, arrow table, structured array."""

    def __getitem__(self, name: Any, /) -> Any:
        """Return a column."""
        ...


def columns_of(source: Mapping[str, ArrayLike] | Frame) -> Mapping[str, ArrayLike]:
    """Columns by name; an index of dates or durations, or named t, becomes column t if there is none.

    Raises:
        RecordingError: the source is no frame, or two columns have the same name.
    """
    if isinstance(source, Mapping):
        return source
    if isinstance(source, np.ndarray) and source.dtype.names:
        return {name: source[name] for name in source.dtype.names}
    if hasattr(source, "iloc"):
        return _of_pandas(source)
    if isinstance(source, pl.LazyFrame):
        source = source.collect()
    elif hasattr(source, "__arrow_c_stream__") and not isinstance(source, pl.DataFrame):
        source = pl.DataFrame(cast(Any, source))
    if isinstance(source, pl.DataFrame):
        return {column.name: column.to_numpy() for column in source}
    expected = "expected a file, arrays by column name, or a frame of pandas, polars or arrow"
    raise RecordingError(f"a recording cannot be read from {type(source).__name__}; {expected}")


def _of_pandas(frame: Any) -> dict[str, ArrayLike]:
    names = [str(name) for name in frame.columns]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"the frame has two columns {twice!r}; give every column its own name")
    columns = dict(zip(names, _series(frame), strict=True))
    index = frame.index
    if "t" not in columns and (index.name == "t" or getattr(index.dtype, "kind", "") in "mM"):
        columns["t"] = _numbers(index)
    return columns


def _series(frame: Any) -> Iterator[ArrayLike]:
    return (_numbers(frame.iloc[:, k]) for k in range(frame.shape[1]))


def _numbers(series: Any) -> ArrayLike:
    """Numbers, dates or durations as a numpy array; missing values are NaN."""
    kind = getattr(series.dtype, "kind", "O")
    if kind in ("M", "m"):
        return np.asarray(series.to_numpy(dtype=f"{'datetime64' if kind == 'M' else 'timedelta64'}[ns]"))
    if kind in ("b", "i", "u", "f"):
        return np.asarray(series.to_numpy(dtype=np.float64, na_value=np.nan))
    return np.asarray(series.to_numpy(dtype=object))
