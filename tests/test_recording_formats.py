"""Every format reads the same numbers, a missing cell is NaN, and unreadable files are refused in one sentence."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from signid.errors import RecordingError
from signid.recording.formats import FORMATS, parquet
from signid.recording.formats.base import memory_table

NAMES = ("t", "q_1", "tau_1")
VALUES = np.array([[0.0, 1.0, -2.0], [0.5, np.nan, 3.25], [1.0, 1.5, 1e-7]])
TEXT = "t,q_1,tau_1\n0,1,-2\n0.5,,3.25\n1,1.5,1e-7\n"


def sentence(message: str, *culprits: str) -> None:
    """One sentence that names each culprit."""
    assert "\n" not in message and message == message.strip() and len(message) < 400, message
    for culprit in culprits:
        assert culprit in message, (culprit, message)


@contextmanager
def refusal(*culprits: str) -> Iterator[None]:
    """A RecordingError in one sentence that names each culprit."""
    with pytest.raises(RecordingError) as error:
        yield
    sentence(str(error.value), *culprits)


def write_csv(path: Path) -> None:
    path.write_text(TEXT)


def write_gzip(path: Path) -> None:
    path.write_bytes(gzip.compress(TEXT.encode()))


def write_parquet(path: Path) -> None:
    pl.DataFrame(dict(zip(NAMES, VALUES.T, strict=True)), nan_to_null=True).write_parquet(path)


def write_npz(path: Path) -> None:
    np.savez(path, **dict(zip(NAMES, VALUES.T, strict=True)))


FILES: dict[str, tuple[str, Callable[[Path], None]]] = {
    "a.csv": ("csv", write_csv),
    "a.CSV.GZ": ("csv", write_gzip),
    "plain.csv.gz": ("csv", write_csv),
    "a.parquet": ("parquet", write_parquet),
    "a.npz": ("npz", write_npz),
}


@pytest.mark.parametrize("name", FILES)
def test_every_format_reads_the_same(name: str, tmp_path: Path) -> None:
    form, write = FILES[name]
    write(tmp_path / name)
    assert [f for f in FORMATS.names if FORMATS[f].recognises(tmp_path / name)] == [form]
    table = FORMATS[form].open(tmp_path / name)
    assert table.columns == NAMES and table.rows == 3
    np.testing.assert_array_equal(table.read(NAMES, 0, 3), VALUES)
    np.testing.assert_array_equal(table.read(("tau_1", "t"), 1, 99), VALUES[1:, [2, 0]])
    assert table.read((), 0, 2).shape == (2, 0) and table.read(NAMES, 2, 2).shape == (0, 3)
    with refusal("q_9", name, "tau_1"):
        table.read(("q_9",), 0, 1)


CSV = {
    "integers first": ("t,q\n0,1\n1,2\n" + "2,3\n" * 300 + "3,4.5\n", (-1, [3, 4.5])),
    "semicolons": ("t;q\n0;1.5\n", (0, [0, 1.5])),
    "decimal commas": ("t;q\n0,5;1,25\n", (0, [0.5, 1.25])),
    "tabs": ("t\tq\n0\t2\n", (0, [0, 2])),
    "blanks around": (" t , q \n 0 , 2 \n", (0, [0, 2])),
    "byte order mark, CRLF, blank lines": ("\ufefft,q\r\n0,2\r\n\r\n1,3\r\n\r\n", (1, [1, 3])),
    "quotes": ('"t","q"\n"0","2"\n', (0, [0, 2])),
    "comments": ("# by a robot\n\nt,q\n# half time\n0,2\n", (0, [0, 2])),
    "header in a comment": ("# t,q\n0,2\n", (0, [0, 2])),
    "words for nothing": ("t,q\n0,NA\n1,null\n2,-nan\n3,nan\n4,\n", (3, [3, np.nan])),
    "last line cut": ("t,q\n0,1\n1", (1, [1, np.nan])),
    "first line short": ("t,q\n0\n1,2\n", (1, [1, 2])),
    "column of row numbers": (",t,q\n7,0,2\n", (0, [0, 2])),
    "blanks": ("t q\n0 2\n", (0, [0, 2])),
    "blanks, aligned": ("    t     q\n  0.0   2 \n  1.0\t-3\n", (1, [1, -3])),
    "blanks, quoted": ('"t" "q"\n0 2\n', (0, [0, 2])),
    "blanks and words for nothing": ("t q m\n0 nan idle\n1 NA run\n", (1, [1, np.nan])),
    "blanks below commas": ("# t, q\n0 2\n1 3\n", (1, [1, 3])),
    "tabs and decimal commas": ("t\tq\n0,5\t1,25\n", (0, [0.5, 1.25])),
    "header in a comment of ROS": ("%t,q,name\n0,2,a\n", (0, [0, 2])),
    "lines above": ("Recorder 2.1\ndate: 2024-01-02, 10:00\nrate;500\n\nt,q\n0,2\n1,3\n", (1, [1, 3])),
    "lines above blanks": ("Recorder of robot x\n\nt q w\n0 2 1\n1 3 1\n", (1, [1, 3])),
    "comments above, the last but one names": ("# rate 500\n# t q\n# -------\n0 2\n1 3\n", (1, [1, 3])),
    "a column of words": ("t,mode,q\n0,idle,2\n1,run, 3 \n", (1, [1, 3])),
}


@pytest.mark.parametrize("case", CSV)
def test_csv_as_it_comes(case: str, tmp_path: Path) -> None:
    text, (row, values) = CSV[case]
    (tmp_path / "a.csv").write_bytes(text.encode())
    table = FORMATS["csv"].open(tmp_path / "a.csv")
    row = row % table.rows
    np.testing.assert_array_equal(table.read(("t", "q"), row, row + 1)[0], values)


def png(path: Path) -> None:
    path.write_bytes(b"\x89PNG\r\n\0\0\0\rIHDR")


BAD: dict[str, tuple[str, Callable[[Path], object], tuple[str, ...]]] = {
    "empty": ("a.csv", lambda p: p.write_text(""), ("a.csv", "empty")),
    "only blank lines": ("a.csv", lambda p: p.write_text("\n \n"), ("a.csv", "empty")),
    "only a comment": ("a.csv", lambda p: p.write_text("# log\n"), ("a.csv", "empty")),
    "no header": ("a.csv", lambda p: p.write_text("0,1.5\n1,2\n"), ("a.csv", "no header")),
    "twice": ("a.csv", lambda p: p.write_text("t,q_1,q_1\n0,1,2\n"), ("a.csv", "'q_1' twice")),
    "a cell less": (
        "a.txt",
        lambda p: p.write_text("t q x\n0 1 2\n1 2\n2 3 4\n"),
        ("a.txt", "2 cells in line 3", "nan"),
    ),
    "a cell more": ("a.txt", lambda p: p.write_text("t q\n0 1\n1 2 3\n"), ("a.txt", "3 cells", "row 2")),
    "no header below": ("a.txt", lambda p: p.write_text("Recorder\n0 1 2\n"), ("a.txt", "no header", "--names")),
    "binary": ("a.csv", png, ("a.csv", "binary")),
    "not UTF-8": ("a.csv", lambda p: p.write_bytes("t,Gelenk_ä\n".encode("latin-1")), ("a.csv", "UTF-8")),
    "line too long": ("a.csv", lambda p: p.write_text("t,q\n0,1\n1,2,3\n"), ("a.csv", "row 2", "3 cells")),
    "first line too long": ("a.csv", lambda p: p.write_text("t,q\n0,1,3\n1,2\n"), ("a.csv", "row 1")),
    "a line of commas": ("a.csv", lambda p: p.write_text("t,q\n" + "," * 3_000_000), ("a.csv", "1 MB", "line 1")),
    "gzip cut": ("a.csv.gz", lambda p: p.write_bytes(gzip.compress(TEXT.encode() * 99)[:-9]), ("a.csv.gz", "gzip")),
    "gzip of noise": ("a.csv.gz", lambda p: p.write_bytes(b"\x1f\x8bnoise"), ("a.csv.gz", "gzip")),
    "not Parquet": ("a.parquet", write_csv, ("a.parquet", "not a Parquet")),
    "empty Parquet": ("a.parquet", lambda p: p.write_bytes(b""), ("a.parquet", "not a Parquet")),
    "not NumPy": ("a.npz", write_csv, ("a.npz", "not a NumPy archive")),
    "empty NumPy": ("a.npz", lambda p: p.write_bytes(b""), ("a.npz", "not a NumPy archive")),
    "one array": ("a.npz", lambda p: np.save(p.open("wb"), VALUES), ("a.npz", "not a NumPy archive")),
}


@pytest.mark.parametrize("case", BAD)
def test_files_that_are_no_tables(case: str, tmp_path: Path) -> None:
    name, write, culprits = BAD[case]
    write(tmp_path / name)
    form = next(form for form in FORMATS if form.recognises(tmp_path / name))
    with refusal(*culprits):
        form.open(tmp_path / name)


CELLS: dict[str, tuple[str, Callable[[Path], object], tuple[str, ...]]] = {
    "word": ("a.csv", lambda p: p.write_text("t,q\n0,1\n1,o.5\n"), ("'q'", "row 2", "'o.5'")),
    "thousands": ("a.csv", lambda p: p.write_text('t,q\n0,"1,000"\n'), ("'q'", "row 1", "'1,000'")),
    "words in Parquet": ("a.parquet", lambda p: pl.DataFrame({"q": ["x"]}).write_parquet(p), ("'q'", "String")),
    "objects": ("a.npz", lambda p: np.savez(p, q=np.array([None, {}])), ("'q'", "numbers")),
    "words": ("a.npz", lambda p: np.savez(p, q=np.array(["a", "b"])), ("'q'", "numbers")),
    "complex": ("a.npz", lambda p: np.savez(p, q=np.ones(3) * 1j), ("'q'", "numbers")),
    "single number": ("a.npz", lambda p: np.savez(p, t=np.ones(3), q=2.0), ("'q'", "()")),
    "too short": ("a.npz", lambda p: np.savez(p, t=np.ones(3), q=np.ones(2)), ("'q'", "2 values", "3 as 't'")),
}


@pytest.mark.parametrize("case", CELLS)
def test_columns_that_are_no_numbers_fail_when_asked_for(case: str, tmp_path: Path) -> None:
    name, write, culprits = CELLS[case]
    write(tmp_path / name)
    table = next(form for form in FORMATS if form.recognises(tmp_path / name)).open(tmp_path / name)
    assert "q" in table.columns
    with refusal(name, *culprits):
        table.read(("q",), 0, 0)


def test_arrays_given_can_change_afterwards() -> None:
    t = np.arange(3.0)
    table = memory_table({"t": t}, "arrays")
    t[:] = -1
    np.testing.assert_array_equal(table.read(("t",), 0, 3)[:, 0], [0, 1, 2])


def test_parquet_keeps_only_the_slabs_read_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet, "SLAB", 100)
    values = np.random.default_rng(0).normal(size=(1234, 4))
    names = list("abcd")
    frame = pl.DataFrame(values, schema=names).with_columns(pl.col("d").cast(pl.Float32), i=pl.lit(7), b=pl.lit(True))
    frame.write_parquet(tmp_path / "a.parquet", row_group_size=321)
    table = FORMATS["parquet"].open(tmp_path / "a.parquet")
    assert isinstance(table, parquet.ScannedTable)
    for start in range(0, 1234, 70):
        low = max(0, start - 30)
        np.testing.assert_array_equal(table.read(("c", "a"), low, start + 70), values[low : start + 70, [2, 0]])
        assert len(table._slabs) <= parquet.CACHED_SLABS
    np.testing.assert_array_equal(table.read(("a", "i", "b"), 0, 1234)[:, 1:], np.tile([7, 1], (1234, 1)))
    np.testing.assert_array_equal(table.read(("d",), 5, 1200)[:, 0], values[5:1200, 3].astype(np.float32))


def test_parquet_damaged_inside(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pl.DataFrame({"t": np.random.default_rng(0).normal(size=5000)}).write_parquet(path)
    content = path.read_bytes()
    path.write_bytes(content[:4] + b"\xff" * 40 + content[44:])
    table = FORMATS["parquet"].open(path)
    with refusal("a.parquet", "damaged"):
        table.read(("t",), 0, 10)
