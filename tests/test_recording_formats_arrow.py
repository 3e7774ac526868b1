"""Arrow tables in files and streams, lists and structures in columns, and files that state endless sizes."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from test_recording import arm
from test_recording_formats import refusal

from signid.recording import read_recording
from signid.recording.formats import FORMATS, base, find_format

N = 30
T = np.arange(N) / 8
Q = np.sin(np.outer(T, [1.0, 2.0, 3.0]))
TAU = np.cos(np.outer(T, [2.0, 3.0, 1.0]))
DATES = np.datetime64("2026-03-29T00:59:59", "ns") + (T * 1e9).astype(np.int64).astype("timedelta64[ns]")


def frame() -> pl.DataFrame:
    """Positions as arrays, torques as lists, a structure, texts and dates."""
    inner = pl.struct(a=pl.lit(1.5), b=pl.struct(c=pl.lit(True)))
    return pl.DataFrame(
        {
            "t": DATES,
            "q": pl.Series(Q, dtype=pl.Array(pl.Float64, 3)),
            "tau": pl.Series(TAU.tolist(), dtype=pl.List(pl.Float64)),
            "mode": ["run"] * N,
        }
    ).with_columns(state=inner)


WRITERS: dict[str, Callable[[Path], object]] = {
    "a.feather": lambda path: frame().write_ipc(path),
    "lz4.feather": lambda path: frame().write_ipc(path, compression="lz4"),
    "zstd.arrow": lambda path: frame().write_ipc(path, compression="zstd"),
    "a.arrow": lambda path: frame().write_ipc_stream(path),
    "lz4.arrows": lambda path: frame().write_ipc_stream(path, compression="lz4"),
    "a.ipc": lambda path: frame().write_ipc_stream(path, compression="zstd"),
    "a.parquet": lambda path: frame().write_parquet(path),
}


@pytest.mark.parametrize("name", WRITERS)
def test_lists_and_structures_are_columns(name: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / name)
    table = find_format(tmp_path / name).open(tmp_path / name)
    parts = (*(f"{kind}_{k}" for kind in ("q", "tau") for k in (1, 2, 3)), "mode", "state.a", "state.b.c")
    assert table.columns == ("t", *parts) and table.rows == N
    np.testing.assert_array_equal(table.read(("state.a", "state.b.c"), 3, 5), [[1.5, 1], [1.5, 1]])
    found = read_recording(tmp_path / name, arm()).read()
    np.testing.assert_allclose(found.t, T, atol=1e-12)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.tau, TAU)
    with refusal(name, "'mode'", "String"):
        table.read(("mode",), 0, 1)


def test_a_list_of_another_length_is_missing_and_columns_of_their_own_come_first(tmp_path: Path) -> None:
    lists = pl.Series([[1.0, 2.0], [3.0], None, [4.0, 5.0, 6.0], [7.0, None]], dtype=pl.List(pl.Float64))
    pl.DataFrame({"q": lists, "x": lists, "x_2": [0.0] * 5, "e": [[]] * 5}).write_parquet(tmp_path / "a.parquet")
    table = FORMATS["parquet"].open(tmp_path / "a.parquet")
    assert table.columns == ("q_1", "q_2", "x", "x_2", "e")
    wanted = [[1, 2], [np.nan] * 2, [np.nan] * 2, [np.nan] * 2, [7, np.nan]]
    np.testing.assert_array_equal(table.read(("q_1", "q_2"), 0, 5), wanted)


def test_files_of_pandas(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    import pandas as pd

    pd.DataFrame({"t": DATES, "q_1": T, "mode": pd.Categorical(["a"] * N)}).to_feather(tmp_path / "a.feather")
    table = FORMATS["arrow"].open(tmp_path / "a.feather")
    np.testing.assert_allclose(table.read(("t", "q_1"), 0, N), np.column_stack([T, T]), atol=1e-12)


def test_sizes_that_a_message_states_are_checked_before(tmp_path: Path) -> None:
    """The first eight bytes of a compressed array state its size; 2 ** 61 of them would end the process."""
    for name in ("lz4.feather", "zstd.arrow", "lz4.arrows", "a.ipc"):
        WRITERS[name](tmp_path / name)
        content = (tmp_path / name).read_bytes()
        stated = struct.pack("<q", 8 * N)
        assert stated in content
        (tmp_path / name).write_bytes(content.replace(stated, struct.pack("<q", 2**61)))
        with refusal(name, "memory"):
            FORMATS["arrow"].open(tmp_path / name)


BAD: dict[str, tuple[bytes, tuple[str, ...]]] = {
    "empty": (b"", ("not an Arrow table",)),
    "text": (b"t,q\n0,1\n", ("not an Arrow table",)),
    "the mark alone": (b"ARROW1", ("not an Arrow table",)),
    "two marks": (b"ARROW1\0\0ARROW1", ("not an Arrow table",)),
    "endless message": (b"\xff\xff\xff\xff\xff\xff\xff\x7f" + bytes(99), ("not an Arrow table",)),
    "the first Feather": (b"FEA1" + bytes(99), ("version 1", "Parquet")),
}


@pytest.mark.parametrize("case", BAD)
def test_files_that_are_no_tables(case: str, tmp_path: Path) -> None:
    content, culprits = BAD[case]
    (tmp_path / "a.feather").write_bytes(content)
    with refusal("a.feather", *culprits):
        FORMATS["arrow"].open(tmp_path / "a.feather")


def test_tables_beyond_limits_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wide = pl.DataFrame({f"q{k}": pl.Series(np.zeros((2, 1000)), dtype=pl.Array(pl.Float64, 1000)) for k in range(21)})
    wide.write_ipc(tmp_path / "a.feather")
    with refusal("a.feather", "20000 columns"):
        FORMATS["arrow"].open(tmp_path / "a.feather")
    pl.DataFrame({"t": [1, 2], "scan": np.zeros((2, 1001))}).write_ipc(tmp_path / "a.feather")
    assert FORMATS["arrow"].open(tmp_path / "a.feather").columns == ("t", "scan")
    frame().write_ipc(tmp_path / "a.feather")
    monkeypatch.setattr(base, "free_memory", lambda: 5000.0)
    with refusal("a.feather", "memory"):
        FORMATS["arrow"].open(tmp_path / "a.feather")
