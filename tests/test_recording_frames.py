"""Frames of pandas and polars, arrow tables and structured arrays are recordings like arrays by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest
from test_recording import Q, T, arm, whole
from test_recording_formats import refusal

import signid
from signid.recording import read_recording
from signid.recording.formats import FORMATS

NS = (T * 1e9).round().astype(np.int64)
DATES = np.datetime64("2026-03-29T00:59:59", "ns") + NS.astype("timedelta64[ns]")


def structured(columns: dict[str, np.ndarray]) -> np.ndarray:
    array = np.zeros(len(T), [(name, float) for name in columns])
    for name, column in columns.items():
        array[name] = column
    return array


MADE: dict[str, Callable[[dict[str, Any]], Any]] = {
    "pandas": pd.DataFrame,
    "pandas, nullable": lambda columns: pd.DataFrame(columns).convert_dtypes(),
    "pandas, t as index": lambda columns: pd.DataFrame(columns).set_index("t"),
    "pandas, dates": lambda columns: pd.DataFrame({**columns, "t": DATES}),
    "pandas, dates of a zone": lambda columns: pd.DataFrame(
        {**columns, "t": pd.Series(DATES).dt.tz_localize("UTC").dt.tz_convert("Europe/Berlin")}
    ),
    "pandas, dates as index": lambda columns: (
        pd.DataFrame(columns).drop(columns="t").set_index(pd.DatetimeIndex(DATES))
    ),
    "pandas, with words": lambda columns: pd.DataFrame(columns).assign(mode="run"),
    "polars": pl.DataFrame,
    "polars, lazy": lambda columns: pl.DataFrame(columns).lazy(),
    "polars, dates": lambda columns: pl.DataFrame({**columns, "t": DATES}),
    "polars, durations": lambda columns: pl.DataFrame({**columns, "t": NS.astype("timedelta64[ns]")}),
    "polars, matrices": lambda columns: pl.DataFrame({"t": T, "q": Q, "tau": np.column_stack([*columns.values()][4:])}),
    "structured": structured,
    "lists": lambda columns: {name: column.tolist() for name, column in columns.items()},
}


@pytest.mark.parametrize("case", MADE)
def test_all_are_the_same_recording(case: str) -> None:
    wanted = read_recording(whole(), arm()).read()
    made = read_recording(MADE[case](whole()), arm())
    found = made.read()
    np.testing.assert_allclose(found.t, wanted.t, atol=1e-12)
    np.testing.assert_array_equal(found.q, wanted.q)
    np.testing.assert_array_equal(found.tau, wanted.tau)
    assert made.sha256 == read_recording(MADE[case](whole()), arm()).sha256


def test_missing_values_are_nan() -> None:
    holes = pd.DataFrame(whole()).convert_dtypes()
    holes.loc[3:8, "q_2"] = pd.NA
    for frame in (
        holes,
        pl.DataFrame(whole()).with_columns(q_2=pl.when(~pl.col("t").is_between(T[3], T[8])).then("q_2")),
    ):
        q = read_recording(frame, arm()).read().q
        assert np.argwhere(np.isnan(q)).tolist() == [[k, 1] for k in range(3, 9)]


def test_dates_in_parquet(tmp_path: Path) -> None:
    pl.DataFrame({**whole(), "t": DATES}).write_parquet(tmp_path / "a.parquet")
    np.testing.assert_allclose(read_recording(tmp_path / "a.parquet", arm()).read().t, T, atol=1e-12)
    nothing = pl.DataFrame({"t": pl.Series([None] * 3, dtype=pl.Datetime("us"))})
    nothing.write_parquet(tmp_path / "b.parquet")
    assert np.isnan(FORMATS["parquet"].open(tmp_path / "b.parquet").read(("t",), 0, 3)).all()


def test_objects_that_are_no_frame() -> None:
    twice = pd.DataFrame(np.ones((3, 2)), columns=["t", "t"])
    for given, culprits in ((twice, ("'t'", "two columns")), ([1, 2], ("list", "frame")), (None, ("NoneType",))):
        with refusal(*culprits):
            read_recording(given, arm())  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["pandas", "an index of times", "polars"])
def test_a_frame_in_reverse_order_of_time_is_refused(kind: str) -> None:
    t = np.arange(0, 4, 0.01)
    columns = {"t": t, **{f"{name}_{k}": np.sin(k * t) for name in ("q", "tau") for k in (1, 2, 3)}}
    frame = pd.DataFrame(columns).iloc[::-1]
    reverse = {
        "pandas": frame,
        "an index of times": frame.drop(columns="t").set_index(pd.to_datetime(frame["t"], unit="s")),
        "polars": pl.DataFrame(columns).reverse(),
    }[kind]
    [flag] = signid.check("3r", reverse).flags
    assert "goes back at every row" in flag and "sort the rows by time" in flag
