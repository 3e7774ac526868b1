"""Sets for IdentiBench: rows, scores, files of a toy robot and of a real one, sources and licences."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import signid
from benchmarks.blackbox import methods, run
from benchmarks.blackbox.task import Answer, Task, build
from benchmarks.concealed_real.sets import SETS, Part, RealSet
from benchmarks.public_sets import __main__ as check, specification
from benchmarks.public_sets.specification import HEADLINE, Rows, channels, pooled_rms, read, relative
from benchmarks.public_sets.write import (
    COPY,
    ORIGINS,
    PARTS,
    SetFiles,
    describe,
    refusal,
    set_files,
    write_readme,
    write_set,
    write_specification,
)
from signid.recording.gallery.sets import SETS as GALLERY
from signid.regression.bandwidth import Decimator, lowpass
from signid.robot import robot_from_text
from signid.types import Recording, Robot

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.3"/>
<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>"""
TOY = RealSet("toy", "dfki_simple_pendulum", "", (Part("a"),), Part("b"), Part("c"))


def recording(robot: Robot, seed: int) -> Recording:
    """10 s of a pendulum with friction and noise."""
    rng, t = np.random.default_rng(seed), np.arange(0, 10, 0.005)
    w, phase = 2 * np.pi * np.array([0.3, 0.7, 1.1]), rng.uniform(0, 6, 3)
    angle = np.outer(t, w) + phase
    q, v, a = (x.sum(axis=1) * 0.4 for x in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    tau = 0.1 * a + 2.943 * np.sin(q) + 0.3 * v + 0.4 * np.sign(v) + 0.02 * rng.standard_normal(len(t))
    return signid.read_recording({"t": t, "q": q[:, None], "tau": tau[:, None]}, robot)


@pytest.fixture(scope="module")
def toy() -> SetFiles:
    robot = robot_from_text(PENDULUM, "urdf", "pendulum")
    a, b, c = (recording(robot, seed) for seed in range(3))
    return set_files(Task("toy", robot, (a,), b, c, methods.least_squares(robot, [a, b])))


def needs_identibench() -> None:
    pytest.importorskip("identibench", reason="identibench is not installed; pip install identibench==0.4.0")


def test_rows_are_those_of_the_library() -> None:
    signal = np.random.default_rng(0).standard_normal((500, 2))
    for taps, factor in ((lowpass(100, 5), 10), (np.ones(1), 1), (lowpass(100, 20), 2)):
        rows = Rows(taps, factor, np.ones((0, 2), bool))(signal)
        assert rows == pytest.approx(Decimator(taps, factor)(signal), abs=1e-12)


def test_rms_is_that_of_all_files_together() -> None:
    first, second = np.array([[3.0, 1.0]]), np.array([[4.0, 1.0], [np.nan, 5.0]])
    counts = (np.array([[True, True]]), np.array([[True, True], [False, False]]))
    found = pooled_rms(zip((first, second), counts, strict=True))
    assert found == pytest.approx([np.sqrt(12.5), 1.0])
    assert np.isnan(pooled_rms([(second, np.ones((2, 2), bool))])[0])  # a prediction that is no number
    assert np.isnan(pooled_rms([(second, np.zeros((2, 2), bool))])).all()


def test_the_headline_is_a_geometric_mean() -> None:
    assert relative([1.0, 8.0], [2.0, 1.0]) == pytest.approx(2.0)
    assert relative([1.0, np.nan], [2.0, np.nan]) == pytest.approx(0.5)  # no rows of the second joint
    assert np.isnan(relative([1.0, np.nan], [2.0, 1.0])) and relative([0.0], [1.0]) == 0


def test_every_set_has_a_source_and_a_licence() -> None:
    assert {one.folder for one in SETS.values()} == set(ORIGINS)
    known = {one.folder: one for one in GALLERY.values() if one.folder in ORIGINS}
    assert len(known) == 4
    for folder, one in known.items():
        own = ORIGINS[folder]
        assert (own.repository, own.commit, own.licence) == (one.repository, one.commit, one.licence)
        assert own.source == one.home


def test_sources_are_those_of_the_data(data: Path) -> None:
    for folder, origin in ORIGINS.items():
        text = (data / folder / "README.md").read_text(encoding="utf-8")
        assert origin.repository in text and origin.commit in text, folder
        stated = origin.licence.split()[0].removesuffix("-Clause") if "none" not in origin.licence else "licence"
        assert stated.lower() in text.lower(), folder


def test_stretches_hold_the_rows_of_least_squares(toy: SetFiles) -> None:
    held_out = toy.task.held_out
    assert [x.part for x in toy.stretches] == list(PARTS) and toy.units == ("N.m",)
    (test,) = (x for x in toy.stretches if x.part == "test")
    assert np.array_equal(test.counts, np.isfinite(held_out.rest)) and toy.rows("test") == [test.counts.sum()]
    rows = Rows(test.taps, test.factor, test.counts)(test.torque)
    assert rows[test.counts] == pytest.approx(held_out.torque[test.counts], abs=1e-9)
    score = run.evaluate(toy.task, {run.BASE: Answer(held_out.rest, 0.0)}).scores[0]
    assert toy.least_squares_rms == score.rms


def test_a_description_can_be_written_as_json(toy: SetFiles) -> None:
    found = json.loads(json.dumps(describe(TOY, toy), allow_nan=False))
    assert found["licence"] == "BSD-3-Clause" and "dfki-ric" in found["source"]
    assert found["files"] == {"train": ["A1_1.hdf5"], "valid": ["B_1.hdf5"], "test": ["C_1.hdf5"]}
    assert channels(found["joints"]) == (["q_j", "dq_j", "ddq_j"], ["tau_j"], ["counts_j"])


def test_folders_of_others_and_the_repository_are_refused(tmp_path: Path) -> None:
    assert "repository" in refusal(Path(specification.__file__).parent / "data")
    assert not refusal(tmp_path) and not refusal(tmp_path / "new")
    (tmp_path / "file").touch()
    assert "other files" in refusal(tmp_path) and "is a file" in refusal(tmp_path / "file")
    write_specification(tmp_path)
    assert not refusal(tmp_path)


def test_absent_identibench_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "identibench", None)
    with pytest.raises(ImportError, match="pip install identibench"):
        specification.specifications(tmp_path)


def test_files_are_read_back_in_single_precision(toy: SetFiles, tmp_path: Path) -> None:
    pytest.importorskip("h5py", reason="h5py is not installed; it comes with identibench")
    (tmp_path / "toy" / "test").mkdir(parents=True)
    (tmp_path / "toy" / "test" / "old.hdf5").touch()
    place = write_set(tmp_path, TOY, toy)
    assert [x.name for x in (place / "test").iterdir()] == ["C_1.hdf5"]
    test = next(x for x in toy.stretches if x.part == "test")
    u, y, rows, attributes = read(place / "test" / "C_1.hdf5", toy.task.joints)
    assert u == pytest.approx(test.motion, rel=1e-6, abs=1e-6) and y == pytest.approx(test.torque, rel=1e-6, abs=1e-6)
    assert np.array_equal(rows.counts, test.counts) and np.array_equal(rows.taps, test.taps)
    assert attributes["fs"] == pytest.approx(200) and attributes["licence"] == "BSD-3-Clause"
    write_specification(tmp_path)
    write_readme(tmp_path)
    assert (tmp_path / COPY).read_text() == Path(specification.__file__).read_text()
    assert "| toy | 1 |" in (tmp_path / "README.md").read_text()


def test_identibench_scores_least_squares_as_blackbox_does(toy: SetFiles, tmp_path: Path) -> None:
    needs_identibench()
    write_set(tmp_path, TOY, toy)
    found = check.check(specification.specifications(tmp_path)["toy"], toy)
    assert found.least_squares == pytest.approx(1, abs=1e-5) and found.difference < 1e-5
    assert found.zero > found.affine > 1.5


def test_a_wrong_model_is_refused_and_nan_is_no_score(toy: SetFiles, tmp_path: Path) -> None:
    needs_identibench()
    spec = specification.specifications(write_set(tmp_path, TOY, toy).parent)["toy"]
    with pytest.raises(ValueError, match="shape"):
        spec.task(spec, lambda u, y_init, attributes: np.zeros((len(u), 2)))
    scores = spec.task(spec, lambda u, y_init, attributes: np.full((len(u), 1), np.nan)).scores
    assert np.isnan(scores["test"][HEADLINE])
    context: Any = SimpleNamespace(spec=spec)
    assert spec.task(spec, check.affine(context)).headline == ("test", HEADLINE)


def test_no_set_is_one_sentence(tmp_path: Path) -> None:
    needs_identibench()
    with pytest.raises(FileNotFoundError, match="holds no set"):
        specification.specifications(tmp_path)


def test_a_real_set_scores_as_in_blackbox(data: Path, tmp_path: Path) -> None:
    needs_identibench()
    for name in ("dfki", "psm"):
        found = set_files(build(SETS[name], methods.least_squares))
        write_set(tmp_path, SETS[name], found)
        assert check.check(specification.specifications(tmp_path)[name], found).difference < 1e-6
