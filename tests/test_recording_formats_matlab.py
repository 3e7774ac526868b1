"""MATLAB files: arrays, structures and objects; damaged and hostile files are refused."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from test_recording import arm
from test_recording_formats import refusal

from signid.errors import RecordingError
from signid.recording import read_recording
from signid.recording.formats import FORMATS, base, matlab
from signid.recording.reading import draft_map
from signid.types import Table

N = 30
T = np.arange(N) / 8
Q = np.sin(np.outer(T, [1.0, 2.0, 3.0]))
TAU = np.cos(np.outer(T, [2.0, 3.0, 1.0]))
COUNTS = np.arange(N, dtype=np.int16)


def column(table: Table, name: str) -> np.ndarray:
    return np.asarray(table.read((name,), 0, table.rows)[:, 0])


FILES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "rows": ({"t": T, "q": Q, "tau": TAU}, {}),
    "columns": ({"t": T[:, None], "q": Q.T, "tau": TAU.T}, {}),
    "compressed": ({"t": T, "q": Q.T, "tau": TAU}, {"do_compression": True}),
    "version 4": ({"t": T, "q": Q, "tau": TAU}, {"format": "4"}),
    "vectors": (
        {
            "t": T,
            **{f"{kind}_{k + 1}": x[:, k][:, None] for kind, x in (("q", Q), ("tau", TAU)) for k in range(3)},
        },
        {},
    ),
    "other arrays": (
        {"t": T, "q": Q, "tau": TAU, "M": np.eye(3), "fs": 8.0, "by": "me", "c": np.array([T, "a"], object)},
        {},
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_all_are_the_same_recording(case: str, tmp_path: Path) -> None:
    arrays, options = FILES[case]
    savemat(tmp_path / "a.mat", arrays, **options)
    assert [f for f in FORMATS.names if FORMATS[f].recognises(tmp_path / "a.mat")] == ["matlab"]
    found = read_recording(tmp_path / "a.mat", arm()).read()
    np.testing.assert_array_equal(found.t, T)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.tau, TAU)


def test_structures_are_names_with_dots_and_a_map_is_guessed(tmp_path: Path) -> None:
    """A log, and the structure with time that Simulink writes."""
    signals = np.zeros(2, [("values", object), ("label", object)])
    signals["values"], signals["label"] = [Q, COUNTS[:, None]], ["a", "b"]
    log = {"time": T[:, None], "joint": {"pos": Q, "torque": TAU.T}, "name": "run 1"}
    savemat(tmp_path / "a.mat", {"log": log, "out": {"signals": signals}, "tout": T})
    table = FORMATS["matlab"].open(tmp_path / "a.mat")
    parts = {f"log.joint.{name}_{k}" for name in ("pos", "torque") for k in (1, 2, 3)}
    assert {"log.time", "tout", "out.signals_1.values_2", "out.signals_2.values", *parts} < {*table.columns}
    np.testing.assert_array_equal(column(table, "out.signals_1.values_2"), Q[:, 1])
    np.testing.assert_array_equal(column(table, "out.signals_2.values"), COUNTS)
    np.testing.assert_array_equal(column(table, "log.joint.torque_3"), TAU[:, 2])
    names = {"t": "log.time", "q_1": "log.joint.pos_1", "tau_1": "log.joint.torque_1"}
    np.testing.assert_array_equal(read_recording(tmp_path / "a.mat", arm(), columns=names).read().q[:, 0], Q[:, 0])
    savemat(tmp_path / "b.mat", {"log": log})
    text = draft_map(tmp_path / "b.mat", arm()).text
    assert 'time = "log.time"' in text and '= "log.joint.torque_3"' in text


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def array(kind: int, dims: tuple[int, ...], name: bytes, rest: bytes) -> bytes:
    flags = element(6, struct.pack("<II", kind, 0))
    return element(14, flags + element(5, struct.pack(f"<{len(dims)}i", *dims)) + element(1, name) + rest)


def numbers(name: bytes, values: np.ndarray) -> bytes:
    return array(6, (values.size, 1), name, element(9, values.astype("<f8").tobytes()))


def nested(depth: int, kind: int) -> bytes:
    """An array of cells (1) or a structure (2) in another one, and so on; made from the inside."""
    before = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<2i", 1, 1)) + element(1, b"")
    if kind == 2:
        before += struct.pack("<HHI", 5, 4, 8) + element(1, b"a".ljust(8, b"\0"))
    parts = [numbers(b"", T)]
    size = len(parts[0])
    for _ in range(depth):
        size += len(before)
        parts.append(struct.pack("<II", 14, size) + before)
        size += 8
    inside = b"".join(reversed(parts))
    return array(2, (1, 1), b"x", struct.pack("<HHI", 5, 4, 8) + element(1, b"b".ljust(8, b"\0")) + inside)


START = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x0100) + b"IM"
MARKS = element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
SERIES = element(
    14,
    element(6, struct.pack("<II", 17, 0))
    + element(1, b"ts")
    + element(1, b"MCOS")
    + element(1, b"timeseries")
    + array(13, (6, 1), b"", MARKS),
)


def test_objects_are_left_out_with_a_note_and_refused_alone(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(START + SERIES + numbers(b"t", T) + numbers(b"q_1", T) + numbers(b"tau_1", T))
    recording = read_recording(tmp_path / "a.mat", arm("elbow"))
    np.testing.assert_array_equal(recording.read().t, T)
    assert "left out, because only MATLAB reads objects: timeseries ts" in recording.notes
    (tmp_path / "a.mat").write_bytes(START + SERIES + numbers(b"rate", T[1:2]))
    with refusal("a.mat", "timeseries ts", "q = ts.Data"):
        FORMATS["matlab"].open(tmp_path / "a.mat")


def test_an_object_inside_a_structure_is_no_column(tmp_path: Path) -> None:
    names = struct.pack("<HHI", 5, 4, 8) + element(1, b"a".ljust(8, b"\0") + b"b".ljust(8, b"\0"))
    log = array(2, (1, 1), b"log", names + SERIES + numbers(b"", T))
    (tmp_path / "a.mat").write_bytes(START + log + numbers(b"t", T))
    table = FORMATS["matlab"].open(tmp_path / "a.mat")
    assert {*table.columns} == {"t", "log.a", "log.b"}
    np.testing.assert_array_equal(column(table, "log.b"), T)
    with pytest.raises(RecordingError, match="no plain numbers"):
        table.read(("log.a",), 0, 0)


def saved(**arrays: Any) -> Callable[[Path], object]:
    return lambda path: savemat(path, arrays, do_compression=True)


def cut(path: Path) -> None:
    savemat(path, {"t": T, "q": Q}, do_compression=True)
    path.write_bytes(path.read_bytes()[:-9])


def written(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


BOMB = zlib.compress(bytes(50_000_000), 9)
NAMES = struct.pack("<HHI", 5, 4, 8) + element(1, b"a".ljust(8, b"\0"))
BAD: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "empty": (written(b""), ("not a MATLAB file",)),
    "text": (written(b"t,q\n" * 60), ("not a MATLAB file",)),
    "zeros": (written(bytes(500)), ("not a MATLAB file",)),
    "the header alone, cut": (written(START[:100]), ("not a MATLAB file",)),
    "cut": (cut, ("not a MATLAB file",)),
    "endless element": (written(START + struct.pack("<II", 14, 2**31) + bytes(99)), ("not a MATLAB file",)),
    "endless dimensions": (written(START + array(6, (2**30, 2**30), b"t", element(9, bytes(8)))), ("not a MATLAB",)),
    "endless structures": (written(START + array(2, (2**30, 2**30), b"t", NAMES)), ("a.mat",)),
    "a name twice": (written(START + numbers(b"t", T) + numbers(b"t", Q[:, 0])), ("not a MATLAB file",)),
    "cells without end": (written(START + nested(100_000, 1)), ("not a MATLAB file",)),
    "structures without end": (written(START + nested(100_000, 2)), ("not a MATLAB file",)),
    "square": (saved(t=T[:3], q=Q[:3]), ("'q'", "as many rows as columns")),
}


@pytest.mark.parametrize("case", BAD)
def test_files_that_are_no_tables(case: str, tmp_path: Path) -> None:
    write, culprits = BAD[case]
    write(tmp_path / "a.mat")
    with refusal("a.mat", *culprits):
        FORMATS["matlab"].open(tmp_path / "a.mat")


def test_files_that_unpack_to_more_than_memory_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.mat").write_bytes(START + struct.pack("<II", 15, len(BOMB)) + BOMB)
    monkeypatch.setattr(matlab, "free_memory", lambda: 3e6)
    with refusal("a.mat", "more memory than there is"):
        FORMATS["matlab"].open(tmp_path / "a.mat")
    monkeypatch.setattr(base, "free_memory", lambda: 100.0)
    with refusal("a.mat", "memory"):
        FORMATS["matlab"].open(tmp_path / "a.mat")
