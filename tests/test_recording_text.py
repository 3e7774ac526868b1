"""Logs as text: lines before a header, names that the user states, units in the header or below it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_recording import arm
from test_recording_formats import refusal, sentence

from signid.cli.run import run
from signid.errors import OptionError, RecordingError
from signid.recording import read_bare, read_recording
from signid.recording.convert import convert
from signid.recording.formats import FORMATS
from signid.recording.mapping import Heading
from signid.recording.reading import draft_map
from signid.robot import load_robot
from signid.toml_json import read_toml

T = np.arange(30) / 100
Q, TAU = np.sin(3 * T), np.cos(3 * T)
DEGREES = np.degrees(Q)


def lines(separator: str, *columns: np.ndarray) -> str:
    return "".join(separator.join(f"{x:.9g}" for x in row) + "\n" for row in np.transpose(columns))


UNITS = {
    "brackets": ("t [s],q_1 [rad],tau_1 [N.m]\n" + lines(",", T, Q, TAU)),
    "parentheses": ("t (ms),q_1 (deg),tau_1 (Nm)\n" + lines(",", 1e3 * T, DEGREES, TAU)),
    "blanks": ('"t [s]" "q_1 [deg]" "tau_1 [mNm]"\n' + lines(" ", T, DEGREES, 1e3 * TAU)),
    "no blank between": ("t[s] q_1[°] tau_1[Nm]\n" + lines(" ", T, DEGREES, TAU)),
    "second row": ("t;q_1;tau_1\ns;deg;N.m\n" + lines(";", T, DEGREES, TAU)),
    "second row in brackets": ("t\tq_1\ttau_1\n[ms]\t[deg]\t[-]\n" + lines("\t", 1e3 * T, DEGREES, TAU)),
    "lines above and a second row": ("Logger 3\nby: me\nt,q_1,tau_1\nms,rad,mNm\n" + lines(",", 1e3 * T, Q, 1e3 * TAU)),
}


@pytest.mark.parametrize("case", UNITS)
def test_units_of_the_header_are_used(case: str, tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text(UNITS[case], encoding="utf-8")
    samples = read_recording(path, arm()).read()
    np.testing.assert_allclose(samples.t, T, atol=1e-9)
    np.testing.assert_allclose(samples.q[:, 0], Q, atol=1e-8)
    np.testing.assert_allclose(samples.tau[:, 0], TAU, atol=1e-8)
    found = convert(path, robot=arm())
    assert set(found.columns) == {"t", "q_1", "tau_1"} and not found.flags
    np.testing.assert_allclose(found.columns["q_1"], Q, atol=1e-8)


def test_a_column_map_overrides_the_units_of_the_header(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t [s],q_1 [rad],tau_1 [N.m]\n" + lines(",", T, DEGREES, TAU))
    for columns in ({"units": {"q": "deg"}}, {"q_1": {"column": "q_1", "unit": "deg"}}):
        np.testing.assert_allclose(read_recording(path, arm(), columns=columns).read().q[:, 0], Q, atol=1e-8)
    with refusal("'N.m'", "rad/s"):
        read_recording(path, arm(), columns={"dq_1": "tau_1 [N.m]"})


def test_a_draft_takes_the_units_of_the_header(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,q_1,tau_1\nms,deg,Nm\n" + lines(",", 1e3 * T, DEGREES, TAU))
    (tmp_path / "map.toml").write_text(draft_map(path, arm()).text)
    samples = read_recording(path, arm(), columns=tmp_path / "map.toml").read()
    np.testing.assert_allclose(samples.q[:, 0], Q, atol=1e-8)
    np.testing.assert_allclose(samples.t, T, atol=1e-9)


def test_units_of_servos_without_a_description(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,q_a [deg],q_des_a [deg]\n" + lines(",", T, DEGREES, DEGREES))
    recording, units = read_bare(path)
    np.testing.assert_allclose(recording.read().q[:, 0], Q, atol=1e-8)
    assert units == {"a": "rad"}


def test_names_stated_for_a_file_without_a_header(tmp_path: Path) -> None:
    path, names = tmp_path / "log.dat", ("t", "", "q_1", "tau_1")
    path.write_text("Recorder 3\n\n" + lines("  ", T, 0 * T, Q, TAU))
    for columns in ({"names": list(names)}, {"names": list(names), "skip": 2}):
        samples = read_recording(path, arm(), columns=columns).read()
        np.testing.assert_allclose(samples.q[:, 0], Q, atol=1e-8)
    drafted = draft_map(path, arm(), heading=Heading(2, names))
    (tmp_path / "map.toml").write_text(drafted.text)
    assert read_toml(tmp_path / "map.toml")["names"] == list(names)
    samples = read_recording(path, arm(), columns=tmp_path / "map.toml").read()
    np.testing.assert_allclose(samples.tau[:, 0], TAU, atol=1e-8)


def test_skipped_lines_come_before_the_header(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("a,b,c\n1,2,3\n4,5,6\n7,8,9\nt,q_1,tau_1\n" + lines(",", T, Q, TAU))
    with pytest.raises(RecordingError):
        read_recording(path, arm())
    samples = read_recording(path, arm(), columns={"skip": 4}).read()
    np.testing.assert_allclose(samples.q[:, 0], Q, atol=1e-8)


STATED = {
    "too few": ({"names": ["t", "q_1"]}, ("3 columns", "2 names")),
    "twice": ({"names": ["t", "q_1", "q_1"]}, ("'q_1'", "two columns")),
    "no list": ({"names": "t,q_1,tau_1"}, ("names", "list")),
    "no number": ({"skip": "two"}, ("skip", "'two'", "10000")),
    "negative": ({"skip": -1}, ("skip", "-1")),
    "the whole file": ({"skip": 999}, ("log.csv", "empty")),
    "into the numbers": ({"skip": 2}, ("log.csv", "no header", "line 3")),
}


@pytest.mark.parametrize("case", STATED)
def test_wrong_headings_are_refused(case: str, tmp_path: Path) -> None:
    columns, culprits = STATED[case]
    (tmp_path / "log.csv").write_text("t,q_1,tau_1\n" + lines(",", T, Q, TAU))
    with refusal(*culprits):
        read_recording(tmp_path / "log.csv", arm(), columns=columns)


def test_formats_with_names_of_their_own_need_no_heading(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=T, q_1=Q, tau_1=TAU)
    with pytest.raises(OptionError) as error:
        read_recording(tmp_path / "a.npz", arm(), columns={"skip": 1})
    sentence(str(error.value), "a.npz", "names its columns itself", "remove skip")


def test_every_command_takes_names_from_the_column_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    table = FORMATS["parquet"].open(Path(__file__).parents[1] / "robots/3r/recording.parquet")
    values = table.read(table.columns, 0, 600)
    np.savetxt("log.txt", values, header="logger 2", comments="", fmt="%.9g")
    assert run(["convert", "log.txt", "--robot", "3r"]) == 2
    sentence(capsys.readouterr().err.strip(), "log.txt", "no header", "--names")
    names = ",".join(table.columns)
    assert run(["convert", "log.txt", "--names", names, "--robot", "3r", "-o", "r.tsv"]) == 0
    Path("map.toml").write_text(draft_map("log.txt", load_robot("3r"), heading=Heading(0, table.columns)).text)
    np.testing.assert_allclose(FORMATS["csv"].open(Path("r.tsv")).read(["t"], 0, 9), values[:9, :1])
    capsys.readouterr()
    assert run(["check", "3r", "log.txt", "--columns", "map.toml"]) == run(["check", "3r", "r.tsv"])
    assert "log.txt" not in capsys.readouterr().err


def written(rows: list[str], header: str = "t,q_1,q_2,q_3,tau_1,tau_2,tau_3") -> str:
    return "\n".join([header, *rows]) + "\n"


ROBOT = load_robot("3r")
ROWS = [f"{0.01 * k:.2f},{0.1 * k:.1f},0,1,2,3,4" for k in range(120)]
STAMPS: dict[str, list[str]] = {
    "ISO dates": [f"{('2026-11-26 23:59:59', '2026-11-27 00:00:00')[k // 100]}.{k % 100:02d}" for k in range(120)],
    "ISO dates with a zone": [f"2026-11-26T12:00:{k // 100:02d}.{k % 100:02d}Z" for k in range(120)],
    "German dates": [f"26.11.2026 12:00:{k // 100:02d}.{k % 100:02d}" for k in range(120)],
    "times of day across midnight": [f"{('23:59:59', '00:00:00')[k // 100]}.{k % 100:02d}" for k in range(120)],
}


@pytest.mark.parametrize("name", STAMPS)
def test_dates_and_times_become_seconds(name: str, tmp_path: Path) -> None:
    rows = [stamp + row[row.index(",") :] for stamp, row in zip(STAMPS[name], ROWS, strict=True)]
    (tmp_path / "log.csv").write_text(written(rows), encoding="utf-8")
    found = read_recording(tmp_path / "log.csv", ROBOT)
    t = found.read().t
    np.testing.assert_allclose(t - t[0], 0.01 * np.arange(120), atol=1e-6)
    assert any("read as seconds" in note for note in found.notes)


def test_repeated_headers_and_text_below_are_left_out(tmp_path: Path) -> None:
    header = "t,q_1,q_2,q_3,tau_1,tau_2,tau_3"
    (tmp_path / "log.csv").write_text(written([*ROWS[:60], header, *ROWS[60:], "END OF FILE"]), encoding="utf-8")
    found = read_recording(tmp_path / "log.csv", ROBOT)
    np.testing.assert_allclose(found.read().t, 0.01 * np.arange(120), atol=1e-9)
    notes = ("lines that repeat the header left out: 1", "lines of text below the samples left out: 1")
    assert {*notes} <= {*found.notes}
    (tmp_path / "bad.csv").write_text(written([*ROWS[:60], "broken", *ROWS[60:]]), encoding="utf-8")
    with pytest.raises(RecordingError, match="holds 'broken' in row 61"):
        read_recording(tmp_path / "bad.csv", ROBOT)


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
def test_texts_of_windows_are_read(encoding: str, tmp_path: Path) -> None:
    header = "t,q_1 [°],q_2 [°],q_3 [°],tau_1,tau_2,tau_3"
    (tmp_path / "log.csv").write_bytes(written(ROWS, header).encode(encoding))
    q = read_recording(tmp_path / "log.csv", ROBOT).read().q
    np.testing.assert_allclose(q[:, 0], np.radians(0.1 * np.arange(120)), atol=1e-12)
