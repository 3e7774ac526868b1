"""Recovered signs as JSON, on the terminal, and as a table of torques."""

from __future__ import annotations

import csv
import io
import json
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_output_report import shown
from test_recording import arm

from signid.output.report import to_json
from signid.output.report.results.signs import proof_sentence, signed_csv, signs_document, signs_tables
from signid.recording import read_recording, with_signs
from signid.signs import Gain, SignProof, Signs, SignSegment, Trace

REPORT = sys.modules["signid.output.report.results.signs"]
JOINTS = ("shoulder", "<b>&elbow</b>", 'wrist"; alert(1)</script>')
FLAGS = ("shoulder & <elbow> cannot be distinguished; move the shoulder faster", "friction is missing")


def trace(path: str, t: np.ndarray, first: list[int]) -> Trace:
    torque = np.column_stack([3 * np.sin(2 * t), np.cos(3 * t), 0.2 + np.sin(t)])
    model = torque + 0.05 * np.sin(40 * t)[:, None]
    return Trace(path, t, np.array(first), np.abs(torque), np.where(torque < 0, -1.0, 1.0), model)


def stretches(part: int, one: Trace, joint: int, threshold: float) -> list[SignSegment]:
    """Stretches above a threshold, their confidence the lower the later."""
    high = one.magnitude[:, joint] >= threshold
    ends = np.flatnonzero(np.diff(np.concatenate([[0], high, [0]]))).reshape(-1, 2)
    return [
        SignSegment(part, joint, one.t[a], one.t[b - 1], int(one.signs[a, joint]), 1 - 0.002 * k)
        for k, (a, b) in enumerate(ends)
    ]


def found(recordings: int = 1, samples: int = 600, **changes: Any) -> Signs:
    """Joints 0 and 2 of three without a sign."""
    t = np.arange(samples) * 0.02
    traces = [trace(f"session_{k}.csv", t + 100 * k, [0, samples // 3]) for k in range(recordings)]
    level = np.array([0.4, 0.0, 0.2])
    some = [x for k, one in enumerate(traces) for j in (0, 2) for x in stretches(k, one, j, level[j])]
    known = Signs(
        joints=JOINTS,
        hidden=(0, 2),
        method="exact",
        segments=tuple(some),
        threshold=level,
        proof=SignProof(True, 0.0, 1454),
        flags=FLAGS,
        notes=("a note",),
        value=np.ones(5),
        noise=np.array([0.1, 0.2, 0.3]),
        inflation=np.array([4.0, 1.0, 2.0]),
        traces=tuple(traces),
    )
    return replace(known, **changes)


def test_the_document_is_the_contract() -> None:
    signs = found()
    document = json.loads(to_json(signs_document(signs)))
    assert {"proof", "flags", "segments"} <= set(document)
    assert document["proof"] == {"optimal": True, "gap": 0.0, "nodes": 1454, "certified": False}
    assert document["flags"] == list(FLAGS) and document["seed"] == 0 and document["method"] == "exact"
    assert len(document["segments"]) == len(signs.segments) > 5
    for segment, one in zip(document["segments"], signs.segments, strict=True):
        assert set(segment) == {"joint", "start", "end", "sign", "confidence"}
        assert segment["joint"] == JOINTS[one.joint] and segment["sign"] in (1, -1)
        assert (segment["start"], segment["end"], segment["confidence"]) == (one.start, one.end, one.confidence)
    per_joint = {"joints": [JOINTS[0], JOINTS[2]], "threshold": [0.4, 0.2], "noise": [0.1, 0.3], "inflation": [4, 2]}
    assert per_joint.items() <= document.items()


def test_segments_of_several_recordings_name_theirs() -> None:
    signs = found(2, gains=(Gain("shoulder", 2.5, 0.1), Gain("rail", 80.0, 4.0, "N/A")))
    document = json.loads(to_json(signs_document(signs)))
    assert {segment["recording"] for segment in document["segments"]} == {"session_0.csv", "session_1.csv"}
    assert document["gains"] == [
        {"joint": "shoulder", "torque_constant": 2.5, "std": 0.1, "unit": "N.m/A"},
        {"joint": "rail", "torque_constant": 80.0, "std": 4.0, "unit": "N/A"},
    ]
    nameless = replace(signs, traces=tuple(replace(one, path="") for one in signs.traces))
    document = signs_document(nameless)
    assert document and document["segments"][-1]["recording"] == "recording 2"


def test_the_terminal_shows_counts_and_uncertain_segments() -> None:
    signs = found()
    text = shown(signs_tables(signs), 120)
    line = next(line for line in text.splitlines() if line.startswith("shoulder"))
    own = signs.of(0)
    plus, uncertain = sum(x.sign > 0 for x in own), sum(x.confidence < 0.999 for x in own)
    assert line.split()[1:5] == [str(len(own)), str(plus), str(len(own) - plus), str(uncertain)]
    assert f"{min(x.confidence for x in own):.3f}" in line and " 600 " in line and "%" in line
    assert "<b>&elbow</b>" not in text and "1454 nodes" in text
    gained = shown(signs_tables(found(gains=(Gain("shoulder", 2.5, 0.1), Gain("rail", 1.0, np.inf, "N/A")))))
    assert "2.50" in gained and "N.m/A" in gained and " N/A" in gained
    assert shown(signs_tables(found(segments=())))


@pytest.mark.parametrize(
    ("proof", "words"),
    [
        (SignProof(True, 0.0, 0, True), "eigenvalues alone"),
        (SignProof(True, 0.0, 1), "a search of 1 node."),
        (SignProof(False, 0.031, 20000), "by at most 3 %"),
        (SignProof(False, 1.0, 122), "not proved optimal: the search visited 122 nodes"),
        (SignProof(False, np.inf, 122), "not proved optimal: the search visited 122 nodes"),
    ],
)
def test_proofs_are_one_sentence(proof: SignProof, words: str) -> None:
    text = proof_sentence(found(proof=proof))
    assert words in text and text.endswith(".") and text.count(". ") == 0


def signed_columns(rows: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    rng = np.random.default_rng(5)
    tau = rng.standard_normal((rows, 2)) * 10.0 ** rng.integers(-12, 9, (rows, 2))
    tau[3, 0], tau[20:32, 1] = 0.0, np.nan
    t = np.cumsum(rng.uniform(0.001, 0.02, rows))
    t[7] = t[6]
    q = rng.standard_normal((rows, 3))
    columns = {"t": t, **{f"q_{j + 1}": q[:, j] for j in range(3)}}
    return {**columns, "abs_tau_shoulder": np.abs(tau[:, 0]), "abs_current_2": np.abs(tau[:, 1])}, tau


@pytest.mark.parametrize("chunk", [65_536, 7])
def test_signed_torque_as_a_table_has_the_recordings_own_rows(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(REPORT, "ROWS_PER_WRITE", chunk)
    robot = arm("shoulder", "elbow, the second", "wrist", constants=[1.0, 0.7, 1.0])
    columns, tau = signed_columns(50)
    signs = np.column_stack([np.where(tau < 0, -1, 1), np.ones(50)]).astype(np.int8)
    signs[9, 0] = 0
    recording = with_signs(read_recording(columns, robot), signs)
    lines = list(csv.reader(io.StringIO("".join(signed_csv(recording, found(), 0)))))
    assert lines[0] == ["t", "tau_shoulder", "sure_shoulder", "tau_elbow, the second", "sure_elbow, the second"]
    assert len(lines) == 51 and lines[1 + 24][3] == "" and lines[1 + 9][1] == "" and lines[1 + 3][1] == "0.0"
    read = np.array([[float(cell or "nan") for cell in line] for line in lines[1:]])
    tau[9, 0] = np.nan
    np.testing.assert_array_equal(read[:, [0, 1, 3]], np.column_stack([columns["t"], tau[:, 0], 0.7 * tau[:, 1]]))


@pytest.mark.parametrize("chunk", [65_536, 7])
def test_rows_are_as_sure_as_their_segment(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(REPORT, "ROWS_PER_WRITE", chunk)
    t = 0.1 * np.arange(10)
    columns = {"t": t, "q": np.ones((10, 3)), "abs_tau": np.ones((10, 3))}
    signs = np.ones((10, 3), np.int8)
    signs[5:8] = -1
    recording = with_signs(read_recording(columns, arm()), signs)
    segments = (
        SignSegment(0, 0, t[5], t[8], -1, 0.75),
        SignSegment(0, 0, t[1], t[3], 1, 0.9995),
        SignSegment(1, 0, t[0], t[9], 1, 1.0),
    )
    rows = "".join(
        signed_csv(recording, found(segments=(*segments, SignSegment(0, 2, t[6], t[6], -1, 0.5))), 0)
    ).splitlines()
    cells = np.array([row.split(",") for row in rows[1:]])
    sure = cells[:, 2::2].astype(float).T
    assert rows[0] == "t,tau_shoulder,sure_shoulder,tau_elbow,sure_elbow,abs_tau_wrist,sure_wrist"
    assert cells[:, 1].tolist() == [*["1.0"] * 5, "", "", "", "1.0", "1.0"]  # 0.75 is no sign to write
    assert cells[:, 3].tolist() == [*["1.0"] * 5, *["-1.0"] * 3, "1.0", "1.0"]
    assert cells[:, 5].tolist() == ["1.0"] * 10  # no sign of the wrist is certain
    one = 0.9995
    assert sure[0].tolist() == [0, one, one, one, 0, 0.75, 0.75, 0.75, 0, 0]  # the last of a segment has turned round
    assert sure[1].tolist() == [1] * 10  # its torque had its sign
    assert sure[2].tolist() == [0] * 6 + [0.5] + [0] * 3
