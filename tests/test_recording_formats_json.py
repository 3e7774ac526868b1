"""JSON: lines, lists and objects of lists are the same recording; damaged and hostile files are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_recording import arm
from test_recording_formats import refusal, sentence

import signid
from signid.errors import OptionError, RecordingError
from signid.recording import is_recording, read_recording
from signid.recording.formats import FORMATS, base, find_format, json_
from signid.recording.formats.base import About
from signid.recording.formats.json_ import parse_row
from signid.watch.sources import Parser

T = np.arange(30) / 8
Q = np.sin(np.outer(T, [1.0, 2.0, 3.0]))
TAU = np.cos(np.outer(T, [2.0, 3.0, 1.0]))
ROWS = [{"t": t, "q": q, "tau": tau} for t, q, tau in zip(T.tolist(), Q.tolist(), TAU.tolist(), strict=True)]
PAIRS = (("q", "pos"), ("tau", "torque"))
LINES = "".join(json.dumps(row) + "\n" for row in ROWS)
COLUMNS: dict[str, Any] = {"t": T.tolist(), "q": Q.tolist(), "tau": TAU.tolist()}
TRANSPOSED = {"t": T.tolist(), "q": Q.T.tolist(), "tau": TAU.T.tolist(), "robot": "arm", "rate": 8}

FILES: dict[str, tuple[str, str]] = {
    "lines": ("a.jsonl", LINES),
    "lines, another suffix": ("a.NDJSON", LINES),
    "lines, CRLF and blank lines": ("a.jsonl", "\ufeff\n" + LINES.replace("\n", "\r\n\r\n")),
    "lines named .json": ("a.json", LINES),
    "a list": ("a.json", json.dumps(ROWS)),
    "a list, indented": ("a.json", json.dumps(ROWS, indent=1)),
    "a list named .jsonl": ("a.jsonl", json.dumps(ROWS)),
    "an object of lists": ("a.json", json.dumps(COLUMNS)),
    "an object of lists, indented": ("a.json", json.dumps({"by": {"me": 1}, **COLUMNS}, indent=1)),
    "an object of lists in columns": ("a.json", json.dumps(TRANSPOSED)),
    "a list in an object": ("a.json", json.dumps({"info": {"rate": 8}, "samples": ROWS})),
    "texts, truth and other objects": (
        "a.jsonl",
        "".join(json.dumps({"mode": "run", "ok": True, "imu": {"acc": [0, 0, 9]}, **row}) + "\n" for row in ROWS),
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_all_are_the_same_recording(case: str, tmp_path: Path) -> None:
    name, text = FILES[case]
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert [f for f in FORMATS.names if FORMATS[f].recognises(tmp_path / name)] == ["json"]
    assert is_recording(str(tmp_path / name))
    found = read_recording(tmp_path / name, arm()).read()
    np.testing.assert_array_equal(found.t, T)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.tau, TAU)


def test_a_watched_stream_has_the_names_of_a_file() -> None:
    given = [{"header": {"stamp": row["t"]}, "pos": row["q"], "torque": row["tau"], "mode": "run"} for row in ROWS]
    names = {"t": "header.stamp", **{f"{key}_{k}": f"{name}_{k}" for key, name in PAIRS for k in (1, 2, 3)}}
    found = Parser(arm(), names, "the stream").rows("".join(json.dumps(row) + "\n" for row in given))
    assert found is not None
    np.testing.assert_allclose(found.t, T, rtol=1e-12)
    np.testing.assert_allclose(found.q, Q, rtol=1e-12)
    np.testing.assert_allclose(found.tau, TAU, rtol=1e-12)


def test_names_of_lists_and_objects() -> None:
    row = parse_row('{"t": 1, "q": [2, null], "a": {"b": {"c": true}, "d": [[3], 4]}, "s": "on", "x": "NaN", "e": []}')
    assert parse_row(json.dumps({"scan": [0.0] * 1001})) == {"scan": "a list of 1001"}
    assert list(row) == ["t", "q_1", "q_2", "a.b.c", "a.d_1_1", "a.d_2", "s", "x"]
    assert (row["t"], row["q_1"], row["a.b.c"], row["a.d_1_1"], row["a.d_2"], row["s"]) == (1, 2, 1, 3, 4, "on")
    assert np.isnan(float(row["q_2"])) and np.isnan(float(row["x"]))


def test_values_that_are_missing_are_nan_and_texts_are_no_columns(tmp_path: Path) -> None:
    lines = ('{"t": 0, "q": [1, 2]}', '{"t": 1, "mode": "run"}', '{"t": 2, "q": [NaN, null, 7], "mode": 3}')
    (tmp_path / "a.jsonl").write_text("\n".join(lines) + "\n")
    table = FORMATS["json"].open(tmp_path / "a.jsonl")
    assert table.rows == 3 and set(table.columns) == {"t", "q_1", "q_2", "q_3", "mode"}
    wanted = [[0, 1, 2, np.nan], [1, *[np.nan] * 3], [2, np.nan, np.nan, 7]]
    np.testing.assert_array_equal(table.read(("t", "q_1", "q_2", "q_3"), 0, 3), wanted)
    with refusal("a.jsonl", "'mode'", "'run' in row 2"):
        table.read(("mode",), 0, 0)


def test_a_last_line_that_is_cut_short_is_left_out_with_a_note(tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_text(LINES[:-9])
    recording = read_recording(tmp_path / "a.jsonl", arm())
    assert len(recording) == len(T) - 1 and "line 30 is cut short and left out" in recording.notes
    assert About.of(FORMATS["json"].open(tmp_path / "a.jsonl")).notes == ("line 30 is cut short and left out",)


DEEP = '{"a":' * 5000 + "1" + "}" * 5000
LIST = "[" * 100_000
BAD: dict[str, tuple[str, str | bytes, tuple[str, ...]]] = {
    "empty": ("a.jsonl", "", ("empty",)),
    "empty .json": ("a.json", "", ("cut short",)),
    "blank lines": ("a.jsonl", "\n\n", ("empty",)),
    "an empty list": ("a.json", "[]", ("no list of objects",)),
    "text": ("a.jsonl", "t,q\n0,1\n", ("line 1", "expected a line such as")),
    "a broken line": ("a.jsonl", LINES + "{'t': 1}\n" + LINES, ("line 31", "character 2")),
    "a number": ("a.jsonl", LINES + "7\n", ("line 31", "no object")),
    "not UTF-8": ("a.jsonl", LINES.encode() + b'{"\xff": 1}\n', ("line 31", "UTF-8")),
    "a list cut short": ("a.json", json.dumps(ROWS)[:-20], ("cut short", "line 1")),
    "an object cut short": ("a.json", json.dumps(COLUMNS)[:-20], ("cut short",)),
    "a list of lists": ("a.json", json.dumps(Q.tolist()), ("no list of objects",)),
    "a list with a number": ("a.json", '[{"t": 1}, 2]', ("no list of objects",)),
    "binary": ("a.json", b"[\x89PNG\xff", ("UTF-8",)),
    "a key twice": ("a.jsonl", '{"t": 0, "q": 1, "q": 2}\n', ("line 1", "'q' twice")),
    "a column twice": ("a.jsonl", '{"q": [0, 1], "q_2": 2}\n', ("line 1", "'q_2' twice")),
    "deep objects": ("a.jsonl", DEEP + "\n", ("line 1", "nested too deeply")),
    "deep objects in a list": ("a.json", f"[{DEEP}]", ("nested too deeply",)),
    "deeper than any log": ("a.json", '{"t":[1,2],"a":' + '{"a":' * 30 + "1" + "}" * 31, ("nested too deeply",)),
    "deep lists": ("a.jsonl", LIST + "\n", ("nested too deeply",)),
    "deep lists in .json": ("a.json", LIST, ("nested too deeply",)),
    "a line without end": ("a.jsonl", '{"t": [' + "0," * 600_000, ("1 MB in line 1",)),
    "columns without end": (
        "a.jsonl",
        "".join(f'{{"a{k}": [{"0," * 999}0]}}\n' for k in range(21)),
        ("20000 columns",),
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_files_that_are_no_samples(case: str, tmp_path: Path) -> None:
    name, content, culprits = BAD[case]
    (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(RecordingError) as error:
        FORMATS["json"].open(tmp_path / name)
    sentence(str(error.value).replace(json_.EXAMPLE, ""), name, *culprits)


def test_huge_numbers_are_infinite(tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_text(f'{{"t": {"9" * 9000}, "q": -1e999, "x": 12}}\n')
    table = FORMATS["json"].open(tmp_path / "a.jsonl")
    np.testing.assert_array_equal(table.read(("t", "q", "x"), 0, 1), [[np.inf, -np.inf, 12]])


@pytest.mark.parametrize("name", ["a.json", "a.jsonl"])
def test_files_beyond_the_memory_are_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / name).write_text(LINES if name == "a.jsonl" else json.dumps(ROWS))
    monkeypatch.setattr(base, "free_memory", lambda: 100.0)
    with refusal(name, "memory"):
        FORMATS["json"].open(tmp_path / name)


def test_models_and_configurations_are_no_recordings(tmp_path: Path) -> None:
    model = signid.load_model("1r").save(tmp_path / "model.json")
    for name, text in (("settings.json", '{"rate": 5, "robot": {"name": "a"}}'), ("cut.json", '{"t": [')):
        (tmp_path / name).write_text(text)
        assert not is_recording(str(tmp_path / name))
    assert not is_recording(str(model)) and not is_recording(str(tmp_path / "none.json"))
    with refusal("model.json", "instead of samples", "give the recording here"):
        read_recording(model, "1r")
    with pytest.raises(OptionError, match="cannot be written; write .csv"):
        find_format(tmp_path / "none.json").encode({}, "none.json")
