"""A converted recording equals its source in any format, and the source is described."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from bags import JOINTS, START, state, states, store, write1, write2
from swing import csv, pristine, swing
from test_recording import TAU, Q, T, arm, whole
from test_recording_formats import sentence
from test_recording_formats_lerobot import two_episodes

import signid
from signid.cli import run
from signid.errors import RecordingError
from signid.output.report.write import write_files
from signid.recording import read_recording
from signid.recording.convert import convert
from signid.recording.sampling import survey
from signid.types import Samples

MAP = """
q_1 = { column = "angle", unit = "deg" }
tau_1 = { column = "m", unit = "mN.m" }
t = { column = "ms", unit = "ms" }
"""


def same(found: Samples, wanted: Samples) -> None:
    for mine, theirs in zip(found, wanted, strict=True):
        assert (mine is None) == (theirs is None)
        if mine is not None and theirs is not None:
            np.testing.assert_array_equal(mine, theirs)


def command(line: str, capfd: pytest.CaptureFixture[str], code: int = 0) -> tuple[str, str]:
    assert run(shlex.split(line)) == code
    output = capfd.readouterr()
    return output.out, output.err


@pytest.mark.parametrize(
    ("kind", "end"), [("bag", ".csv"), ("bag", ".npz"), ("table", ".csv.gz"), ("dataset", ".parquet")]
)
def test_reading_and_converting_are_the_same(
    kind: str, end: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    known = store()
    if kind == "bag":
        write2(tmp_path / "source", known, states(known), mcap=True)
        more, columns = "--topic /joint_states", None
    elif kind == "dataset":
        two_episodes(tmp_path, together=True).rename("source")
        more, columns = "--unit q=deg --unit q_des=deg --unit tau=N.cm", {"q": "deg", "q_des": "deg", "tau": "N.cm"}
    else:
        odd = {
            "mode": ["run"] * len(T),
            **whole(q_1=None, angle=np.degrees(Q[:, 0]), m=TAU[:, 0], ms=T * 1e3, t=None, tau_1=None),
        }
        pl.DataFrame(odd).write_parquet("source")
        Path("source").rename("source.parquet")
        Path("map.toml").write_text(MAP)
        more, columns = "--columns map.toml", None
    source = next(path for path in ("source", "source.parquet") if Path(path).exists())
    given = "map.toml" if kind == "table" else {"units": columns or {}}
    out, err = command(f"convert {source} -o out{end} {more}", capfd)
    assert err == "" and f"out{end}" in out.partition("written:")[2]
    found = read_recording(f"out{end}", arm())
    same(found.read(), read_recording(source, arm(), columns=given).read())
    assert found.joints == JOINTS
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith((".", "out"))) == [f"out{end}"]


def test_tables_pass_through_every_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text(csv(swing(load=pristine()["t"] ** 2)))
    for before, after in (("a.csv", "b.npz"), ("b.npz", "c.parquet"), ("c.parquet", "d.csv.gz"), ("d.csv.gz", "e.csv")):
        out, _ = command(f"convert {before} -o {after}", capfd)
        assert "1200 rows" in out and "12.0 s at 100 Hz, no gap" in out and "Other columns, unchanged: load" in out
    first, last = pl.read_csv("a.csv"), pl.read_csv("e.csv")
    assert first.columns == last.columns and first.equals(last)


def test_the_source_is_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    known = store(first=True)
    gap = [(topic, message, at) for topic, message, at in states(known) if not START + 10**9 < at < START + 2 * 10**9]
    other = [("/spare", state(known, START, ["x"], [1.0], [], []), START)]
    write1(tmp_path / "a.bag", known, sorted([*gap, *other], key=lambda each: each[2]))
    words = ("a.bag: 300 rows, 3.99 s at 100 Hz, 1 gap of up to 1.01 s", "/joint_states  JointState", "shoulder")
    out, _ = command("convert a.bag --topic joint_states -o a.csv", capfd)
    for word in (*words, "/spare", "(not read)", "Clock: header stamps, counted from 2023-11-14T22:13:20.000Z"):
        assert word in out, word
    document = json.loads(command("convert a.bag --topic /joint_states --json", capfd)[0])
    assert document["schema"] == "signid.conversion/1" and document["rows"] == 300
    assert document["time"]["gaps"] == 1 and document["time"]["longest_gap"] == pytest.approx(1.01)
    assert document["joints"][0] == {"name": "shoulder", "columns": ["q", "dq", "tau"]}
    assert [(topic["name"], topic["read"]) for topic in document["topics"]] == [
        ("/joint_states", True),
        ("/spare", False),
    ]
    assert document["inputs"][0]["path"] == "a.bag" and document["flags"] == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bag", "a.csv"], "looking writes nothing"


def test_names_are_held_against_a_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    t, q, tau = pristine().values()
    Path("a.csv").write_text(csv({"t": t, "q_left/joint_1": q, "tau_left/joint_1": tau}))
    out, err = command("convert a.csv --robot 1r -o b.csv", capfd, code=3)
    assert Path("b.csv").is_file()
    sentence(err.strip(), "a.csv: q_left/joint_1 names no joint of 1r")
    Path("map.toml").write_text('joints = "left/*"')
    out, err = command("convert a.csv --robot 1r --columns map.toml -o b.csv", capfd)
    assert err == "" and "look it through" not in out
    robot = signid.load_robot("1r")
    same(read_recording("b.csv", robot).read(), read_recording("a.csv", robot, columns="map.toml").read())


def test_rows_that_lack_a_value_can_be_dropped() -> None:
    """Holes no longer than the clock bridges then split nothing; longer ones still do."""
    tau = TAU[:, 0].copy()
    tau[[4, 9]] = np.nan
    spare = np.full(len(T), np.nan)
    kept = convert(whole(tau_1=tau, q_9=spare), drop_missing=True)
    np.testing.assert_array_equal(kept.columns["t"], np.delete(T, [4, 9]))
    sentence("; ".join(kept.notes), "2 of 30 rows lack a value")
    assert len(convert(whole(tau_1=tau)).columns["t"]) == len(T)
    assert convert(whole(), drop_missing=True).notes == ()


def test_short_holes_need_not_lose_a_recording() -> None:
    """A torque missing every 0.4 s would leave no stretch of half a second: it is bridged, or its rows are left out."""
    robot, tau = signid.load_robot("1r"), pristine()["tau_1"].copy()
    tau[::40] = np.nan
    bridged = read_recording(swing(tau_1=tau), robot)
    assert len(survey(bridged, robot).spans) == 1 and "29 missing values are bridged" in " ".join(bridged.notes)
    whole = read_recording(convert(swing(tau_1=tau), drop_missing=True).columns, robot)
    assert len(survey(whole, robot).spans) == 1 and len(whole) == 1170


def test_oddities_are_reported() -> None:
    assert "milliseconds" in convert(whole(t=T * 1e3)).flags[0]
    assert "goes back after 1 of" in convert(whole(t=np.concatenate([T[15:], T[:15]]))).flags[0]
    found = convert({"a": T, "mode": ["run"] * len(T)}, units={"q": "deg"})
    sentence("; ".join(found.notes), "no numbers: mode", "unit of q is unused", "column of time t", "torque tau_J")
    assert found.pace is None and list(found.columns) == ["a"]
    slow = convert(whole(), units={"t": "ms"})
    assert slow.pace is not None and slow.pace.rate == pytest.approx(1e4) and slow.units["t"] == "ms"


def test_sources_that_cannot_be_converted() -> None:
    with pytest.raises(RecordingError, match="would both be q_1"):
        convert({"t": T, "q_1": T, "q_a1": T}, columns={"joints": "a*"})
    with pytest.raises(RecordingError, match="'mode' holds no plain numbers"):
        convert({"t": T, "mode": ["run"] * len(T)}, columns={"q_1": "mode"})
    with pytest.raises(RecordingError, match="no samples"):
        convert({"t": [], "q_1": []})


CASES = {
    "the same file": ("convert a.csv -o ./a.csv", "another name"),
    "through a link": ("convert a.csv -o link.csv", "another name"),
    "an unknown format": ("convert a.csv -o a.doc", "format"),
    "a bag as the result": ("convert a.csv -o a.mcap", "cannot be written"),
    "a folder as the result": ("convert a.csv -o folder", "folder"),
    "no such source": ("convert gone.bag -o b.csv", "does not exist"),
    "a folder as the source": ("convert folder -o b.csv", "metadata.yaml"),
    "topics of a table": ("convert a.csv --topic /a -o b.csv", "no topics"),
    "a strange unit": ("convert a.csv --unit q=furlong -o b.csv", "furlong"),
    "a strange kind": ("convert a.csv --unit elbow=deg -o b.csv", "elbow"),
    "a unit twice": ("convert a.csv --unit q=deg --unit q=rad -o b.csv", "twice"),
    "no map": ("convert a.csv --columns gone.toml -o b.csv", "gone.toml"),
    "no robot": ("convert a.csv --robot gone.urdf -o b.csv", "gone.urdf"),
    "an empty name": ("convert a.csv -o ''", "-o"),
    "a folder that is a file": ("convert a.csv -o a.csv/b.csv", "a.csv is a file"),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_usage_leaves_nothing_behind(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path, {"a.csv": csv(swing())})
    Path("folder").mkdir()
    Path("link.csv").symlink_to("a.csv")
    line, culprit = CASES[case]
    out, err = command(line, capfd, code=2)
    assert out == "" and err.startswith("signid: ") and len(err.splitlines()) == 1 and culprit in err, err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "folder", "link.csv"]
