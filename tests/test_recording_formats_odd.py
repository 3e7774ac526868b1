"""Files that are no table of rows: one sentence with the remedy; doubled names are numbered."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from signid.cli import run
from signid.errors import RecordingError
from signid.recording import read_recording
from signid.recording.formats.hdf5 import without_objects

T = np.arange(0, 2, 0.01)
Q = np.sin(np.c_[T, 2 * T, 3 * T])


class Trap:
    """An object that leaves a file where it is unpickled."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return (Path.touch, (self.file,))


@pytest.mark.parametrize("name", ["log.pt", "log.pth", "log.pkl", "log.pickle", "log.npy", "log.npz"])
def test_objects_are_never_unpickled(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    left, path = tmp_path / "left", tmp_path / name
    path.write_bytes(pickle.dumps(Trap(left)))
    for command in (f"check {path}", f"check 3r {path}", f"convert {path}", f"identify 3r {path} -o {tmp_path}/out"):
        assert run(command.split()) == 2
        assert "numpy.savez" in capfd.readouterr().err
    assert not left.exists()


@pytest.mark.parametrize("ending", ["npz", "npy", "mat", "h5"])
def test_three_dimensions_are_refused_with_the_remedy(ending: str, tmp_path: Path) -> None:
    path, cube = tmp_path / f"log.{ending}", np.zeros((3, 20, 5))
    if ending == "npz":
        np.savez(path, t=T[:20], q=cube)
    elif ending == "npy":
        np.save(path, cube)
    elif ending == "mat":
        from scipy.io import savemat

        savemat(path, {"t": T[:20], "q": cube})
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["t"], file["q"] = T[:20], cube
    with pytest.raises(RecordingError, match=r"numpy.savez") as said:
        read_recording(path, "3r")
    assert "3 x 20 x 5" in str(said.value) or "(3, 20, 5)" in str(said.value)


def test_images_beside_signals_are_noted() -> None:
    found = read_recording({"t": T, "q": Q, "tau": Q, "camera": np.zeros((len(T), 4, 4))}, "3r")
    assert any("more than two dimensions are not read: camera" in note for note in found.notes)


@pytest.mark.parametrize(("kind", "line"), [("table", "table2struct(T,"), ("timetable", "timetable2table(T)")])
def test_tables_of_matlab(kind: str, line: str) -> None:
    with pytest.raises(RecordingError) as said:
        without_objects(Path("log.mat"), {}, [f"{kind} T"])
    assert line in str(said.value)


def test_doubled_names_are_numbered(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    head = "t,pos,pos,pos,torque,torque,torque"
    np.savetxt(path, np.c_[T, Q, 2 * Q], delimiter=",", header=head, comments="")
    names = {f"{kind}_{k}": f"{word}_{k}" for kind, word in (("q", "pos"), ("tau", "torque")) for k in (1, 2, 3)}
    found = read_recording(path, "3r", columns=names)
    np.testing.assert_allclose(found.read().q, Q)
    assert "columns of the same name are numbered: pos, torque" in found.notes
