"""HDF5, and MATLAB files of version 7.3: groups and arrays; links, texts and objects are left out."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_recording import arm
from test_recording_formats import refusal

from signid.errors import RecordingError
from signid.recording import read_recording
from signid.recording.formats import FORMATS
from signid.types import Table

N = 30
T = np.arange(N) / 8
Q = np.sin(np.outer(T, [1.0, 2.0, 3.0]))
TAU = np.cos(np.outer(T, [2.0, 3.0, 1.0]))
h5py: Any = pytest.importorskip("h5py") if find_spec("h5py") else None
needs_library = pytest.mark.skipif(h5py is None, reason="h5py is not installed")
MARK = b"\x89HDF\r\n\x1a\n"


def test_without_the_library_a_sentence_gives_the_install_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    (tmp_path / "a.h5").write_bytes(MARK)
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384) + MARK)
    for name in ("a.h5", "a.mat"):
        with refusal(name, "h5py", "pip install 'signid[hdf5]'"):
            read_recording(tmp_path / name, "3r")


def column(table: Table, name: str) -> np.ndarray:
    return np.asarray(table.read((name,), 0, table.rows)[:, 0])


def of_matlab(file: Any, name: str, value: np.ndarray, kind: str = "double", **attributes: Any) -> None:
    """A variable as MATLAB writes it: transposed, with its class."""
    file[name] = np.atleast_2d(value).T
    file[name].attrs["MATLAB_class"] = np.bytes_(kind)
    for key, given in attributes.items():
        file[name].attrs[key] = given


@needs_library
@pytest.mark.parametrize("transposed", [False, True])
def test_groups_and_matrices_are_columns(transposed: bool, tmp_path: Path) -> None:
    records = np.zeros(N, [("on", "?"), ("temp", "f4")])
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["time"] = T
        file.create_dataset("arm/q", data=Q.T if transposed else Q, chunks=True, compression="gzip")
        file["arm/tau"], file["arm/name"], file["arm/records"], file["rate"] = TAU, "arm", records, 8.0
        file["empty"] = h5py.Empty("f8")
    assert [f for f in FORMATS.names if FORMATS[f].recognises(tmp_path / "a.hdf5")] == ["hdf5"]
    table = FORMATS["hdf5"].open(tmp_path / "a.hdf5")
    parts = {f"arm.{kind}_{k}" for kind in ("q", "tau") for k in (1, 2, 3)}
    assert {*table.columns} == {"time", "rate", "empty", "arm.name", "arm.records.on", "arm.records.temp", *parts}
    names = {"t": "time", **{f"{kind}_{k}": f"arm.{kind}_{k}" for kind in ("q", "tau") for k in (1, 2, 3)}}
    found = read_recording(tmp_path / "a.hdf5", arm(), columns=names).read()
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.tau, TAU)


@needs_library
def test_matlab_7_3(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        of_matlab(file, "t", T)
        of_matlab(file, "log/q", Q)
        of_matlab(file, "log/elbow", Q[:, 1])
        of_matlab(file, "word", np.arange(N, dtype=np.uint16), "char")
        of_matlab(file, "ts", np.arange(6, dtype=np.uint32), "timeseries", MATLAB_object_decode=np.int32(3))
        file["#refs#/a"] = T
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    table = FORMATS["matlab"].open(path)
    assert {*table.columns} == {"t", "log.q_1", "log.q_2", "log.q_3", "log.elbow", "word"}
    np.testing.assert_array_equal(column(table, "log.q_3"), Q[:, 2])
    np.testing.assert_array_equal(column(table, "log.elbow"), Q[:, 1])
    with pytest.raises(RecordingError, match="no plain numbers"):
        table.read(("word",), 0, 0)
    with h5py.File(path, "r+") as file:
        del file["t"], file["log"], file["word"]
    with refusal("a.mat", "timeseries ts", "q = ts.Data"):
        FORMATS["matlab"].open(path)


@needs_library
def test_links_to_other_places_are_not_followed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = T
    (tmp_path / "secret.bin").write_bytes(T.tobytes())
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = T
        file["soft"], file["outside"] = h5py.SoftLink("/t"), h5py.ExternalLink("secret.h5", "x")
        file.create_dataset("raw", (N,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 8 * N)])
        layout = h5py.VirtualLayout((N,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "x", (N,))
        file.create_virtual_dataset("virtual", layout)
    table = FORMATS["hdf5"].open(tmp_path / "a.h5")
    assert {*table.columns} == {"t", "raw", "virtual"}
    for name in ("raw", "virtual"):
        with pytest.raises(RecordingError, match="no plain numbers"):
            table.read((name,), 0, 0)


@needs_library
def test_groups_without_end_and_beyond_memory_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = T
        file["group/x"] = T
        file["group/again"] = file["group"]
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.create_dataset("t", (10**12,), "f8", chunks=(10**6,))
    for name, culprit in (("a.h5", "20 deep"), ("b.h5", "memory")):
        with refusal(name, culprit):
            FORMATS["hdf5"].open(tmp_path / name)


@needs_library
def test_files_that_are_damaged_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["t"] = T
        file.create_dataset("q", data=Q, chunks=True, compression="gzip")
    content = path.read_bytes()
    for spoilt in (b"", b"t,q\n0,1\n", MARK, content[:700], content[:-9]):
        path.write_bytes(spoilt)
        with refusal("a.h5", "not an HDF5 file"):
            FORMATS["hdf5"].open(path)
