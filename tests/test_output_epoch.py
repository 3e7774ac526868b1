"""Time stamps since 1970: reports, replay and terminal count from the start; JSON keeps the recording's own time."""

from __future__ import annotations

import json
import re
import shlex
from base64 import b64decode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from swing import npz, pristine, swing
from test_output_report_diagnosis import ROBOT, finding
from test_signs_report import found

import signid
from signid.cli import run
from signid.diagnose.data.locate import Location
from signid.output.replay.marks import ReplayFinding, ReplayFindings, marks
from signid.output.report.quantities import number_lines
from signid.output.report.results.diagnosis import diagnosis_document
from signid.output.report.results.signs import signs_page
from signid.recording import read_recording
from signid.recording.sampling import survey, time_origin

pytestmark = pytest.mark.slow

EPOCH = 1.7e9


def late(**changes: Any) -> dict[str, Any]:
    return swing(t=pristine()["t"] + EPOCH, **changes)


def axes(page: str) -> list[np.ndarray]:
    """The x of every plot, as numbers."""
    packed = re.findall(r'"x":\{"dtype":"f4","bdata":"([^"]+)"', page)
    plain = [json.loads(f"[{text}]") for text in re.findall(r'"x":\[([-\d.,e+]+)\]', page)]
    return [*(np.frombuffer(b64decode(text), "<f4") for text in packed), *map(np.array, plain)]


def test_the_origin_is_the_first_stamp_if_it_is_far_from_zero() -> None:
    robot = signid.load_robot("1r")
    t = pristine()["t"]
    for start, origin in ((0.0, 0.0), (-50.0, 0.0), (600.0, 0.0), (2.6e5, 2.6e5), (EPOCH, EPOCH)):
        assert time_origin(read_recording(swing(t=t + start), robot)) == origin
    lacking = t + EPOCH
    lacking[0] = np.nan
    assert time_origin(read_recording(swing(t=lacking), robot)) == lacking[1]


def test_gaps_are_named_from_the_start() -> None:
    robot, t = signid.load_robot("1r"), late()["t"].copy()
    t[600:] += 3
    notes = survey(read_recording(late() | {"t": t}, robot), robot).notes
    assert any("at t = 5.99 s since the start" in note for note in notes), notes


def test_pages_and_terminal_count_from_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("late.npz").write_bytes(npz(late()))
    Path("early.npz").write_bytes(npz(swing()))
    pages = {}
    for name in ("late", "early"):
        assert run(shlex.split(f"diagnose 1r {name}.npz -o {name}")) in (0, 3)
        assert run(shlex.split(f"validate 1r {name}.npz -o {name}_v")) in (0, 3)
        assert run(shlex.split(f"replay 1r {name}.npz --html {name}.html --duration 2")) == 0
        pages[name] = [axes(Path(folder, "report.html").read_text()) for folder in (name, f"{name}_v")]
    out = capfd.readouterr().out
    assert "e+09" not in out and "61 frames, 0 to 2 s since the start of the recording;" in out
    for mine, theirs in zip(pages["late"], pages["early"], strict=True):
        assert len(mine) == len(theirs) > 2
        for x, y in zip(mine, theirs, strict=True):
            assert x == pytest.approx(y, rel=0.02, abs=0.02), "the same plots"
    shown = [json.loads(Path(name, "diagnosis.json").read_text()) for name in ("late", "early")]
    assert [x["effect"] for x in shown[0]["findings"]] == [x["effect"] for x in shown[1]["findings"]] != []
    assert shown[0]["findings"][0]["where"]["time_origin"] == EPOCH and "time_origin" not in str(shown[1])


def test_pages_of_signs_count_from_the_start() -> None:
    signs = found()
    shift = EPOCH - 3
    moved = replace(
        signs,
        traces=tuple(replace(one, t=one.t + shift, origin=shift) for one in signs.traces),
        segments=tuple(one._replace(start=one.start + shift, end=one.end + shift) for one in signs.segments),
    )
    one, other = (axes(signs_page(each)) for each in (signs, moved))
    assert len(one) == len(other) > 4
    for x, y in zip(one, other, strict=True):
        assert x == pytest.approx(y, abs=1e-4)


def test_windows_are_named_from_the_start_and_kept_in_json() -> None:
    law = f"external_contact:force_x=3,force_y=0,force_z=1,start={EPOCH + 6},end={EPOCH + 7.5}"
    std = dict.fromkeys(("force_x", "force_y", "force_z", "start", "end"), 0.01)
    where = Location(1, "time", "6 to 7.5 s since the start", 0.9, 0.9, EPOCH)
    one = finding(law, std, where=where)
    lines = "; ".join(number_lines(ROBOT, one))
    assert "start 6.000 ± 0.020 s since the start" in lines and "end 7.500" in lines and "1700000" not in lines
    found = ReplayFindings("named", signid.load_model(ROBOT), (ReplayFinding(one.law, one.std, 0.9, True, {}),))
    [mark] = marks(found, 1.0, EPOCH)
    assert mark.time == (EPOCH + 6, EPOCH + 7.5) and any("start 6.000" in line for line in mark.lines), mark.lines
    from test_output_report_diagnosis import made

    [entry] = diagnosis_document(made(findings=(one,)))["findings"]
    assert entry["parameters"]["start"]["value"] == EPOCH + 6 and entry["where"]["time_origin"] == EPOCH
