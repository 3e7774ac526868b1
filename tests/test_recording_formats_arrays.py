"""Arrays in files: matrices in rows or in columns, structured arrays, single arrays with stated names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_recording import arm
from test_recording_formats import refusal, sentence

from signid.errors import InputError, OptionError, RecordingError
from signid.recording import read_recording
from signid.recording.formats import FORMATS, base
from signid.recording.formats.base import memory_table
from signid.types import Table

N = 9
T = np.arange(N) / 8  # exact in binary
Q = np.arange(3.0 * N).reshape(N, 3)


def column(table: Table, name: str) -> np.ndarray:
    return np.asarray(table.read((name,), 0, table.rows)[:, 0])


def written(path: Path, value: Any) -> Path:
    if path.suffix == ".npz":
        np.savez(path, **value)
    else:
        np.save(path, value)
    return path


GROUPS = np.zeros(N, [("t", "f8"), ("joint", [("q", "f8", (3,)), ("on", "?")])])
GROUPS["t"], GROUPS["joint"]["q"], GROUPS["joint"]["on"] = T, Q, T > 0.5

ORIENTED: dict[str, dict[str, Any]] = {
    "rows": {"t": T, "q": Q},
    "columns": {"t": T, "q": Q.T},
    "time as a column": {"t": T[:, None], "q": Q.T},
    "time as a row": {"t": T[None], "q": Q},
    "time by another name": {"time": T, "q": Q.T, "longer": np.ones(99)},
    "time of a group": {"log.time": T, "q": Q.T, "longer": np.ones(99)},
    "no time, rows": {"q": Q, "gains": np.ones(3)},
    "no time, columns": {"q": Q.T, "mass": np.ones((3, 3))},
    "fewer samples than joints, rows": {"t": T[:2], "q": Q[:2]},
    "fewer samples than joints, columns": {"t": T[:2], "q": Q[:2].T},
}


@pytest.mark.parametrize("case", ORIENTED)
def test_matrices_in_rows_and_in_columns_are_the_same(case: str, tmp_path: Path) -> None:
    table = FORMATS["npz"].open(written(tmp_path / "a.npz", ORIENTED[case]))
    rows = 2 if "fewer" in case else N
    assert table.rows == rows and {"q_1", "q_2", "q_3"} < {*table.columns}
    np.testing.assert_array_equal(table.read(("q_1", "q_2", "q_3"), 0, rows), Q[:rows])


def test_images_and_scans_are_no_columns() -> None:
    table = memory_table({"t": T, "scan": np.ones((1001, N)), "image": np.ones((N, 4, 4))}, "arrays")
    assert table.columns == ("t", "scan", "image")
    for name in ("scan", "image"):
        with pytest.raises(RecordingError, match="expected one value per sample"):
            table.read((name,), 0, 0)


def test_groups_of_arrays_are_names_with_dots(tmp_path: Path) -> None:
    for table in (
        FORMATS["npz"].open(written(tmp_path / "a.npz", {"t": T, "log": GROUPS})),
        memory_table({"t": T, "log": {"t": T, "joint": {"q": Q, "on": T > 0.5}}}, "arrays"),
    ):
        assert {*table.columns} == {"t", "log.t", "log.joint.q_1", "log.joint.q_2", "log.joint.q_3", "log.joint.on"}
        np.testing.assert_array_equal(column(table, "log.joint.q_3"), Q[:, 2])
        np.testing.assert_array_equal(column(table, "log.joint.on"), T > 0.5)


def test_a_structured_array_is_a_table(tmp_path: Path) -> None:
    table = FORMATS["npy"].open(written(tmp_path / "a.npy", GROUPS))
    assert table.columns == ("t", "joint.q_1", "joint.q_2", "joint.q_3", "joint.on") and table.rows == N
    np.testing.assert_array_equal(column(table, "joint.q_2"), Q[:, 1])


@pytest.mark.parametrize("transposed", [False, True])
def test_a_matrix_needs_stated_names(transposed: bool, tmp_path: Path) -> None:
    t = np.arange(30) / 10
    values = np.column_stack([t, np.sin(t), np.ones(30), np.cos(t)])
    path = written(tmp_path / "a.npy", values.T if transposed else values)
    with refusal("a.npy", "without names", "--names", "names = [...]"):
        read_recording(path, arm("elbow"))
    found = read_recording(path, arm("elbow"), columns={"names": ["t", "q_1", "", "tau_1"]}).read()
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_array_equal(found.tau[:, 0], np.cos(t))


def npy(value: Any, **options: Any) -> Callable[[Path], object]:
    return lambda path: np.save(path, value, **options)


def header_of_a_terabyte(path: Path) -> None:
    np.save(path, np.ones((5, 2)))
    path.write_bytes(path.read_bytes().replace(b"(5, 2), }        ", b"(62500000000, 2), }"[:18].ljust(18)))


def cut(path: Path) -> None:
    np.save(path, np.ones((500, 2)))
    path.write_bytes(path.read_bytes()[:-8])


NAMES = {"names": ["t", "q"]}
BAD: dict[str, tuple[Callable[[Path], object], dict[str, Any], tuple[str, ...]]] = {
    "empty": (lambda p: p.write_bytes(b""), {}, ("not a NumPy array",)),
    "text": (lambda p: p.write_text("t,q\n0,1\n"), NAMES, ("not a NumPy array",)),
    "objects": (npy(np.array([{}, None]), allow_pickle=True), {}, ("not a NumPy array",)),
    "cut": (cut, NAMES, ("cut short",)),
    "a terabyte": (header_of_a_terabyte, NAMES, ("cut short",)),
    "no samples": (npy(np.ones((0, 3))), {"names": ["t", "q_1", "tau_1"]}, ("no samples",)),
    "an archive": (lambda p: np.savez(p.open("wb"), t=T), {}, ("archive", ".npz")),
    "other names": (npy(Q), NAMES, ("(9, 3)", "2 names")),
    "vector": (npy(T), NAMES, ("(9,)", "2 names")),
    "square": (npy(np.ones((2, 2))), NAMES, ("as many rows as columns",)),
    "records in a matrix": (npy(np.zeros((2, 3), [("t", "f8")])), {}, ("(2, 3)", "each sample")),
    "words": (npy(np.array([["a"] * 3] * 4)), {"names": ["t", "q_1", "tau_1"]}, ("'t'", "no plain numbers")),
    "names of a structured array": (npy(GROUPS), NAMES, ("names its columns itself",)),
    "lines before a header": (npy(Q), {"skip": 2}, ("no lines before a header",)),
}


@pytest.mark.parametrize("case", BAD)
def test_arrays_that_are_no_tables(case: str, tmp_path: Path) -> None:
    write, columns, culprits = BAD[case]
    write(tmp_path / "a.npy")
    with pytest.raises(InputError) as error:
        read_recording(tmp_path / "a.npy", arm("elbow"), columns=columns)
    assert isinstance(error.value, OptionError) == ("names its" in culprits[0] or "lines" in culprits[0])
    sentence(str(error.value), "a.npy", *culprits)


def nested(depth: int) -> Any:
    inner: Any = T
    for _ in range(depth):
        inner = {"a": inner}
    return inner


AMBIGUOUS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "square": ({"t": T[:3], "q": Q[:3]}, ("'q'", "as many rows as columns, 3", "q_1, q_2")),
    "square without a time": ({"q": Q[:3]}, ("'q'", "as many rows as columns, 3")),
    "a name twice": ({"t": T, "q": Q, "q_2": T}, ("'q_2'", "two columns")),
    "a name twice in groups": ({"t": T, "a.b": T, "a": {"b": T}}, ("'a.b'", "two arrays")),
    "too many columns": ({"t": T, **{f"q{k}": np.ones((N, 1000)) for k in range(21)}}, ("20000 columns",)),
    "nested without end": (nested(500), ("more than 20 deep",)),
}


@pytest.mark.parametrize("case", AMBIGUOUS)
def test_arrays_that_could_mean_two_things_are_refused(case: str) -> None:
    arrays, culprits = AMBIGUOUS[case]
    with refusal("arrays", *culprits):
        memory_table(arrays, "arrays")


def test_small_integers_need_the_memory_of_floats(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "a.npy", np.zeros(1000, [("t", "u1"), ("q", "u1")]))
    monkeypatch.setattr(base, "free_memory", lambda: 10_000.0)
    with refusal("a.npy", "memory"):
        FORMATS["npy"].open(path)
